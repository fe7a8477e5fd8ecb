"""Video files that were cut short or damaged, that name other files, or whose names FFmpeg would take for something."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.imagefiles import refused, video, written

from lava_vpr.errors import InputError
from lava_vpr.images import videos
from lava_vpr.images.containers import examine
from lava_vpr.images.windows import DamagedError, Film
from lava_vpr.traverse import open_traverse

KINDS = {
    "v.avi": "MJPG", "x.avi": "XVID", "v.mkv": "MJPG", "v.webm": "VP80", "v.mp4": "mp4v", "v.mov": "mp4v",
    "v.mpg": "MPG2",
}  # fmt: skip


def frames(path: Path) -> NDArray[np.uint8]:
    """All pictures of a video."""
    return np.stack(list(open_traverse(path, every=0.001).images()))


def looked_at(path: Path) -> Film:
    """What a video says of itself."""
    with path.open("rb") as file:
        return examine(file.fileno())


@pytest.fixture(scope="module", params=KINDS)
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A video of 30 frames in each kind of file."""
    return video(tmp_path_factory.mktemp("v") / request.param, 30, 25.0, codec=KINDS[request.param])


@pytest.mark.parametrize("given", [{}, {"OPENCV_FFMPEG_LOGLEVEL": "24", "OPENCV_FFMPEG_CAPTURE_OPTIONS": "threads;1"}])
def test_the_environment_stays_as_it_was(
    given: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also while a video is read: commands that follow would try OpenCV in a child because of its variables."""
    for name in [name for name in os.environ if name.startswith("OPENCV_")]:
        monkeypatch.delenv(name)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    before = dict(os.environ)
    images = open_traverse(video(tmp_path / "v.avi", 3), every=0.1).images()
    next(images)
    assert dict(os.environ) == before
    with pytest.raises(InputError):
        videos._opened("rtsp://127.0.0.1:1/none", "rtsp")
    assert dict(os.environ) == before


def endless(data: bytes) -> bytes:
    """A Matroska file as a live recording leaves it: the lengths of segment and clusters are unknown, none is given."""
    for number in (b"\x18\x53\x80\x67", b"\x1f\x43\xb6\x75"):
        parts = data.split(number)
        data = number.join([parts[0], *(_unknown_length(part) for part in parts[1:])])
    at = data.index(b"\x44\x89\x88")
    return data[:at] + b"\xec\x89" + data[at + 2 :]  # the duration becomes a void of equal length


def _unknown_length(part: bytes) -> bytes:
    length = 9 - part[0].bit_length()
    return bytes([(1 << (9 - length)) - 1]) + b"\xff" * (length - 1) + part[length:]


def faststart(data: bytes) -> bytes:
    """An MP4 file of one track with its table of contents moved before the media."""
    at = data.index(b"moov") - 4
    start = data.index(b"mdat") - 4
    contents, table = bytearray(data[at:]), data[at:].index(b"stco")
    (count,) = struct.unpack_from(">I", contents, table + 8)
    for k in range(count):
        (offset,) = struct.unpack_from(">I", contents, table + 12 + 4 * k)
        struct.pack_into(">I", contents, table + 12 + 4 * k, offset + len(contents))
    return data[:start] + bytes(contents) + data[start:at]


# ---------------------------------------------------------------- damage


def test_a_video_cut_short_anywhere_is_refused(tmp_path: Path, whole: Path) -> None:
    data = whole.read_bytes()
    for length in {1, 3, 7, 11, *range(40, len(data), len(data) // 80), len(data) - 1}:
        path = written(tmp_path / whole.name, data[:length])
        with pytest.raises((DamagedError, InputError)):
            looked_at(path)
    refused(lambda: open_traverse(path), f"{whole.name}: is damaged or cut short (", "copy it again, or if it plays")


def test_a_video_with_a_tail_of_zeros_is_refused_or_unchanged(tmp_path: Path, whole: Path) -> None:
    data, pictures, refusals = whole.read_bytes(), frames(whole), 0
    for length in range(40, len(data), len(data) // 25):
        path = written(tmp_path / whole.name, data[:length].ljust(len(data), b"\0"))
        try:
            got = frames(path)
        except InputError:
            refusals += 1
            continue
        np.testing.assert_array_equal(got, pictures)  # an index was lost, or what fills up the last packets
    assert refusals > 15


def test_what_the_container_says_of_a_whole_video(whole: Path) -> None:
    film = looked_at(whole)
    if whole.suffix == ".mpg":
        assert film == Film("mpeg")
        return
    assert film.sizes == ((64, 48),)
    assert film.span == pytest.approx(29 / 25)
    assert film.frames in (0, 30)


def test_a_live_recording_is_taken_and_its_cuts_are_seen(tmp_path: Path) -> None:
    data = endless(video(tmp_path / "v.mkv", 30, 25.0).read_bytes())
    live = written(tmp_path / "live.mkv", data)
    assert len(frames(live)) == 30
    end, refusals = data.rindex(b"\x1c\x53\xbb\x6b"), 0  # where the index follows the last block
    for length in range(end - 400, end, 7):
        path = written(tmp_path / "cut.mkv", data[:length])
        try:
            got = len(frames(path))
        except InputError:
            refusals += 1
            continue
        assert got >= 28  # cut between two blocks, of which nobody says how many there were
    assert refusals > 50


def test_a_recording_that_says_how_long_it_is_must_be_as_long(tmp_path: Path) -> None:
    avi = bytearray(video(tmp_path / "v.avi", 30).read_bytes())
    struct.pack_into("<I", avi, avi.index(b"strh") + 8 + 32, 31)
    refused(lambda: open_traverse(written(tmp_path / "a.avi", bytes(avi))), "(it holds 30 of 31 frames)")
    streamed = bytearray(video(tmp_path / "v.avi", 30).read_bytes())
    for at in (4, streamed.index(b"movi") - 4):
        struct.pack_into("<I", streamed, at, 0xFFFFFFFF)
    struct.pack_into("<I", streamed, streamed.index(b"strh") + 8 + 32, 1 << 30)
    assert len(frames(written(tmp_path / "b.avi", bytes(streamed)))) == 30


def test_frames_that_cannot_be_decoded_at_the_end_are_missed(tmp_path: Path) -> None:
    data = faststart(video(tmp_path / "v.mp4", 30, 25.0, codec="mp4v").read_bytes())
    assert len(frames(written(tmp_path / "fast.mp4", data))) == 30
    (start,) = struct.unpack_from(">I", data, data.index(b"stco") + 12)
    assert start > len(data) // 4
    damaged = written(tmp_path / "zero.mp4", data[: start + (len(data) - start) // 2].ljust(len(data), b"\0"))
    looked_at(damaged)
    refused(lambda: open_traverse(damaged), "zero.mp4: is damaged or cut short (", "of 1.16 seconds can be decoded)")
    refused(lambda: open_traverse(written(tmp_path / "cut.mp4", data[:-1])), "cut.mp4: is damaged or cut short")


def test_one_frame_that_cannot_be_decoded_is_missed(tmp_path: Path) -> None:
    data = bytearray(video(tmp_path / "v.mp4", 8, 25.0, codec="mp4v").read_bytes())
    assert looked_at(tmp_path / "v.mp4").least == 8
    frame = data.rindex(b"\0\0\1\xb6")
    data[frame : frame + 5] = bytes(5)
    lost = written(tmp_path / "lost.mp4", bytes(data))
    refused(lambda: open_traverse(lost), "lost.mp4: is damaged or cut short (7 of 8 frames can be decoded); copy it")
    told = bytearray((tmp_path / "v.mp4").read_bytes())
    told[told.index(b"stts") + 15] = 9
    counts = "(it has times of 9 frames, and sizes of 8)"
    refused(lambda: open_traverse(written(tmp_path / "told.mp4", bytes(told))), counts)


def test_frames_are_not_counted_by_compact_sizes_nor_moved_by_negative_counts(tmp_path: Path) -> None:
    data = bytearray(video(tmp_path / "v.mp4", 30, 25.0, codec="mp4v").read_bytes())
    struct.pack_into(">4sII", data, data.index(b"stsz"), b"stz2", 0, 16)
    assert looked_at(written(tmp_path / "compact.mp4", bytes(data))).least == 0
    struct.pack_into(">4sIIiI", data, data.index(b"stsc"), b"ctts", 0, 1, -1, 9)
    refused(lambda: open_traverse(written(tmp_path / "moved.mp4", bytes(data))), "'ctts' has a negative count")


def test_media_outside_the_file_s_parts_are_missed(tmp_path: Path) -> None:
    data = bytearray(video(tmp_path / "v.mp4", 30, 25.0, codec="mp4v").read_bytes())
    at = data.index(b"stco") + 12
    for offset in (0, struct.unpack_from(">I", data, at)[0] + 1, len(data), 2**32 - 1):
        struct.pack_into(">I", data, at, offset)
        refused(lambda: open_traverse(written(tmp_path / "o.mp4", bytes(data))), "cut short (frames are missing)")


@pytest.mark.parametrize("seed", range(4))
def test_damaged_headers_are_refused_or_taken_in_time(tmp_path: Path, seed: int, whole: Path) -> None:
    rng, data = np.random.default_rng(seed), whole.read_bytes()
    for _ in range(25):
        spoilt = bytearray(data)
        for at in rng.integers(0, rng.choice([64, 400, len(data)]), 3):
            spoilt[at % len(data)] = rng.choice([0, 255, 127, rng.integers(256)])
        try:
            film = looked_at(written(tmp_path / "s", bytes(spoilt)))
        except (DamagedError, InputError):
            continue
        assert film.span >= 0


# ---------------------------------------------------------------- cost


def test_large_frames_and_many_parts_are_refused_unseen(
    tmp_path: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LAVA_VPR_MAX_IMAGE_PIXELS", "3071")
    refused(
        lambda: open_traverse(whole),
        f"{whole.name}: has frames of 64 x 48, 3,072 pixels, more than the 3,071 allowed; if the file is sound, set "
        "LAVA_VPR_MAX_IMAGE_PIXELS",
    )
    monkeypatch.delenv("LAVA_VPR_MAX_IMAGE_PIXELS")
    monkeypatch.setenv("LAVA_VPR_MAX_VIDEO_PARTS", "4")
    refused(lambda: open_traverse(whole), "more than the 4 allowed; if the file is sound, set LAVA_VPR_MAX_VIDEO_PARTS")


@pytest.mark.timeout(20)
def test_a_pipe_in_place_of_a_video_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "v.avi")
    refused(lambda: open_traverse(tmp_path / "v.avi"), "v.avi: is neither a folder nor a file")
    refused(
        lambda: next(videos.video_samples(tmp_path / "v.avi")), "v.avi: cannot be read (is a named pipe, not a file)"
    )


# ---------------------------------------------------------------- other files


def playlists(canary: Path) -> dict[str, bytes]:
    """Texts that FFmpeg takes for something that plays ``canary`` or a stream."""
    name = canary.name.encode()
    return {
        "concat": b"ffconcat version 1.0\nfile " + name + b"\n",
        "hls": b"#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\n" + name + b"\n#EXT-X-ENDLIST\n",
        "sdp": b"v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 5004 RTP/AVP 96\n",
        "dash": b'<?xml version="1.0"?><MPD profiles="urn:mpeg:dash:profile:isoff-on-demand:2011"></MPD>',
        "image list": b"\x89PNG\r\n\x1a\n",
    }


@pytest.mark.parametrize("suffix", [".mp4", ".avi", ".mkv", ".webm", ".mpg"])
def test_a_text_that_plays_other_files_is_no_video(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    canary = video(tmp_path / "canary.avi", 5)
    for name, text in playlists(canary).items():
        path = written(tmp_path / f"{name}{suffix}", text)
        refused(lambda path=path: open_traverse(path), f"{name}{suffix}: is no AVI, MP4, QuickTime", "convert it")
    # Even if such a text got by: FFmpeg may not take it for anything but the format that was found.
    for demuxer in ("avi", "mov", "matroska,webm", "mpeg"):
        monkeypatch.setattr(videos, "examine", lambda _, demuxer=demuxer: Film(demuxer))
        for name in playlists(canary):
            refused(lambda name=name: open_traverse(tmp_path / f"{name}{suffix}"), name)


@pytest.mark.parametrize(
    "name", ["concat:a.avi|a.avi", "img%03d.avi", "pipe:0.avi", "file:a.avi", "%d.avi", "\udcff.avi"]
)
def test_a_name_is_nothing_but_a_name(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    video(Path("a.avi"), 5)
    video(Path("b.avi"), 7).rename(name)
    assert len(frames(Path(name))) == 7


def test_a_movie_that_refers_to_another_file_is_refused(tmp_path: Path) -> None:
    data = bytearray(video(tmp_path / "v.mp4", 5, codec="mp4v").read_bytes())
    at = data.index(b"url ") + 4
    assert data[at : at + 4] == b"\0\0\0\1"
    data[at + 3] = 0
    refused(lambda: open_traverse(written(tmp_path / "r.mp4", bytes(data))), "r.mp4: plays other files, which it names")
