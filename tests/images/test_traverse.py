"""Folders, lists and videos as traverses."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import sys
import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, strategies as st
from support.common import children
from support.common.imagefiles import QUICK, image_bytes, refused, smooth_picture, video, written

from lava_vpr.images import videos
from lava_vpr.images.files import natural_key
from lava_vpr.images.imagefiles import read_image
from lava_vpr.images.sampling import every_so_often
from lava_vpr.images.windows import Film
from lava_vpr.traverse import open_traverse

# ---------------------------------------------------------------- folders


def folder(path: Path, *names: str) -> Path:
    for k, name in enumerate(names):
        written(path / name, image_bytes(".png", np.full((2, 2), k, dtype=np.uint8)))
    return path


def test_folder_is_sorted_naturally_and_filtered(tmp_path: Path) -> None:
    names = ["img10.png", "img2.png", "IMG3.PNG", "img1.jpg", ".hidden.png", "._img1.png", "notes.md", "a.tiff"]
    folder(tmp_path / "run", *names)
    (tmp_path / "run" / "sub.png").mkdir()
    traverse = open_traverse(str(tmp_path / "run"))
    assert traverse.names == ("a.tiff", "img1.jpg", "img2.png", "IMG3.PNG", "img10.png")
    assert traverse.source == str(tmp_path / "run")
    assert traverse.indices.tolist() == [0, 1, 2, 3, 4]
    assert traverse.indices.dtype == np.int64
    assert [int(image[0, 0]) for image in traverse.images()] == [7, 3, 1, 2, 0]
    assert int(traverse.load(2)[0, 0]) == 1
    with pytest.raises(IndexError, match="image 5 of a traverse of 5"):
        traverse.load(5)


@QUICK
@given(st.lists(st.text(alphabet="abAB019-_.", min_size=1, max_size=8), max_size=8), st.randoms(use_true_random=False))
def test_natural_sort_does_not_depend_on_the_order_of_the_folder(names: list[str], random: object) -> None:
    shuffled = list(names)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    assert sorted(names, key=natural_key) == sorted(shuffled, key=natural_key)


@QUICK
@given(st.lists(st.integers(0, 10**12), min_size=1, max_size=20, unique=True))
def test_natural_sort_is_numeric(numbers: list[int]) -> None:
    names = [f"run7_{n}.png" for n in numbers]
    assert sorted(names, key=natural_key) == [f"run7_{n}.png" for n in sorted(numbers)]


def test_natural_sort_takes_numbers_of_any_length() -> None:
    names = ["a" + "9" * 9_999, "a1" + "0" * 9_999, "a0" + "9" * 9_999, "a007", "a7", "a08"]
    assert sorted(names, key=natural_key) == ["a007", "a7", "a08", "a0" + "9" * 9_999, "a" + "9" * 9_999, names[1]]


def test_places_keep_absolute_indices(tmp_path: Path) -> None:
    folder(tmp_path, *(f"{k}.png" for k in range(12)))
    traverse = open_traverse(tmp_path, places=(9, 12))
    assert traverse.indices.tolist() == [9, 10, 11]
    assert traverse.names == ("9.png", "10.png", "11.png")
    assert [int(i[0, 0]) for i in traverse.images()] == [9, 10, 11]
    assert len(open_traverse(tmp_path, places=(0, 12))) == 12
    refused(lambda: open_traverse(tmp_path, places=(5, 13)), "has 12 images; places 5:13 go beyond, use at most 0:12")
    for wrong in ((3, 3), (4, 3), (-1, 3)):
        refused(lambda wrong=wrong: open_traverse(tmp_path, places=wrong), f"places {wrong[0]}:{wrong[1]} are no range")
    taken = traverse.take([2, 0])
    assert (taken.names, taken.indices.tolist()) == (("11.png", "9.png"), [11, 9])
    assert len(traverse.take([])) == 0


def test_one_image_is_a_traverse_of_one(tmp_path: Path) -> None:
    path = written(tmp_path / "one.jpg", image_bytes(".jpg", smooth_picture()))
    traverse = open_traverse(path)
    assert (traverse.names, len(traverse)) == (("one.jpg",), 1)
    assert traverse.load(0).shape == (24, 36, 3)


def test_sources_that_cannot_be_opened(tmp_path: Path) -> None:
    refused(lambda: open_traverse(tmp_path / "no"), "no: cannot be opened (No such file or directory); check the path")
    refused(lambda: open_traverse(""), "'' is not a path")
    refused(lambda: open_traverse("a\0b"), "is not a path")
    (tmp_path / "empty").mkdir()
    refused(lambda: open_traverse(tmp_path / "empty"), "empty: holds no images (jpg jpeg png", "give a folder that")
    folder(tmp_path / "parent" / "summer", "1.png")
    refused(lambda: open_traverse(tmp_path / "parent"), "holds no images", "one of its subfolders, such as summer")
    refused(lambda: open_traverse(written(tmp_path / "x.dat", b"")), "x.dat: is of no known type; give a folder")
    (tmp_path / "loop.png").symlink_to(tmp_path / "loop.png")
    refused(lambda: open_traverse(tmp_path / "loop.png"), "loop.png: cannot be opened (Too many levels of symbolic")
    refused(lambda: open_traverse(tmp_path), "loop.png: cannot be ", "Too many levels of symbolic links")
    (tmp_path / "parent" / "dead.png").symlink_to(tmp_path / "nothing")
    refused(lambda: open_traverse(tmp_path / "parent"), "dead.png: cannot be opened (No such file or directory)")
    os.mkfifo(tmp_path / "pipe.png")
    refused(lambda: open_traverse(tmp_path / "pipe.png"), "pipe.png: is neither a folder nor a file")
    (tmp_path / "fifo").mkdir()
    os.mkfifo(tmp_path / "fifo" / "1.png")
    refused(lambda: open_traverse(tmp_path / "fifo"), "1.png: is not a regular file; correct or remove it")


def test_odd_file_names(tmp_path: Path) -> None:
    data = image_bytes(".png", smooth_picture())
    written(tmp_path / "Straße 1.png", data)
    with open(os.fsencode(tmp_path) + b"/\xff.png", "wb") as file:
        file.write(data)
    traverse = open_traverse(tmp_path)
    assert "Straße 1.png" in traverse.names
    json.dumps(traverse.names).encode()
    "".join(traverse.names).encode("utf-8")
    assert all(image.shape == (24, 36, 3) for image in traverse.images())
    broken = written(tmp_path / "two\nlines.png", b"")
    refused(lambda: read_image(broken), r"two\nlines.png': is empty").encode()


def test_a_damaged_image_is_named_when_it_is_reached(tmp_path: Path) -> None:
    folder(tmp_path, "1.png", "3.png")
    written(tmp_path / "2.png", image_bytes(".png", smooth_picture(10, (90, 120, 3)))[:200])
    images = open_traverse(tmp_path).images()
    next(images)
    refused(lambda: next(images), str(tmp_path / "2.png"), "damaged or cut short", "copy it again or remove it")


def test_memory_does_not_grow_with_the_number_of_images(tmp_path: Path) -> None:
    def peak(count: int) -> int:
        for k in range(count):
            written(tmp_path / str(count) / f"{k}.png", data)
        traverse = open_traverse(tmp_path / str(count))
        tracemalloc.start()
        for _ in traverse.images():
            pass
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    image = np.zeros((200, 300, 3), dtype=np.uint8)
    data = image_bytes(".png", image)
    few, many = peak(3), peak(40)
    assert image.nbytes <= few  # the pixels are seen by the measurement at all
    assert many < few + image.nbytes // 2


# ---------------------------------------------------------------- lists


def test_text_list(tmp_path: Path) -> None:
    folder(tmp_path / "a", "1.png", "2.png")
    text = "\ufeff# the run\r\n\r\na/2.png\r\n  a/1.png  \r\n" + str(tmp_path / "a" / "2.png")
    traverse = open_traverse(written(tmp_path / "list.txt", text.encode()), places=(1, 3))
    assert (traverse.names, traverse.indices.tolist()) == (("1.png", "2.png"), [1, 2])
    assert [int(i[0, 0]) for i in traverse.images()] == [0, 1]
    assert len(open_traverse(written(tmp_path / "l.LST", b"a/1.png"))) == 1


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("id,filename\n7,2.png\n8,1.png\n", ("2.png", "1.png")),
        ("# c\nPath ;x\n2.png;1\n\n1.png;2\n", ("2.png", "1.png")),
        ("2.png,5\n1.png,6\n", ("2.png", "1.png")),
        ("Image,image number\n2.png,5\n,\n,\n", ("2.png",)),
        ('"a, b.png";x\n2.png;y\n', ("a, b.png", "2.png")),
        ("x\timage\n3\t1.png\n", ("1.png",)),
        ('"a, b.png"\n1.png\n', ("a, b.png", "1.png")),
        ("noext\n1.png\n", ("noext", "1.png")),
    ],
)
def test_csv_list(tmp_path: Path, text: str, names: tuple[str, ...]) -> None:
    folder(tmp_path, "1.png", "2.png", "a, b.png", "noext")
    assert open_traverse(written(tmp_path / "l.csv", text.encode())).names == names


def test_lists_that_cannot_be_used(tmp_path: Path) -> None:
    folder(tmp_path, "1.png")
    (tmp_path / "d.png").mkdir()

    def listing(name: str, text: bytes, *parts: str) -> None:
        path = written(tmp_path / name, text)
        refused(lambda: open_traverse(path), name, *parts)

    listing("l.txt", b"", "l.txt: names no images; write one path a line")
    listing("l.csv", b"image\n", "l.csv: names no images")
    missing = f"l.txt line 3: {tmp_path}/9.png: cannot be opened (No such file or directory); correct or remove"
    listing("l.txt", b"1.png\n#\n9.png\n", missing)
    listing("l.csv", b"image\n1.png\n9.png\n", f"l.csv line 3: {tmp_path}/9.png: cannot be opened")
    listing("l.txt", b"1.png\nd.png\n", "l.txt line 2", "d.png: is a folder, not an image")
    listing("l.csv", b"x,image\n1,1.png\n2,\n", "l.csv line 3: names no file")
    listing("l.txt", b"1.png\n\xff\n", "l.txt line 2: is not UTF-8 text; save the file as UTF-8")
    listing("l.csv", b"1.png\n1\0.png\n", "l.csv line 2")
    listing("l.txt", b"1.png\n1\0.png\n", "l.txt line 2: names no file")


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (b"image,x\na, b.png,5\n1.png,6\n", "l.csv line 2: has 3 cells, but line 1 has 2; write a cell that holds ','"),
        (b"image\n1.png\na, b.png\n", "l.csv line 3: has 2 cells, but line 1 has 1"),
        (b"x,image\n1,1.png\n2\n", "l.csv line 3: has 1 cells, but line 1 has 2"),
        (b"image,x\n1.png,1\n,\n1.png,2\n", "l.csv line 3: names no file"),
        (b"first\n1.png\n", "first: cannot be opened (No such file or directory); correct or remove it, or name its"),
        (b"first.jp2,5\n1.png,6\n", "first.jp2: cannot be opened"),
        (b"image,x,image\n1.png,1,1.png\n", "l.csv line 1: has 2 columns 'image'; rename all but one"),
        (b"path\n1.png\n", "l.csv line 1: 'path' may be a header or the file of that name; add a header, or write ./"),
        (b'image,x\n1.png,"1\n1.png,2\n1.png,3\n', "l.csv line 2: is not CSV (the quote that it opens is not closed)"),
        (b'image,x\n"1.png"2,1\n', "l.csv line 2: is not CSV"),
        (b"image\n\xef\xbb\xbf1.png\n", "l.csv line 2"),
        (b"image\n" + b"x" * 200_000 + b"\n", "l.csv line 2: is not CSV (field larger than field limit"),
    ],
)
def test_csv_lists_that_would_lose_or_change_an_image_are_refused(tmp_path: Path, text: bytes, cause: str) -> None:
    folder(tmp_path, "1.png", "a, b.png", "a", "path")
    refused(lambda: open_traverse(written(tmp_path / "l.csv", text)), cause)


def test_a_list_names_files_with_any_character_but_line_ends(tmp_path: Path) -> None:
    names = [f"a{chr(c)}b.png" for c in (0x0B, 0x0C, 0x1C, 0x1D, 0x1E, 0x85, 0x2028, 0x2029)] + ["\x85", "\xa0c"]
    folder(tmp_path, *names)
    for name, header in (("l.txt", ""), ("l.csv", "image\n")):
        listing = written(tmp_path / name, (header + "\r".join(names)).encode())
        assert list(open_traverse(listing).names) == names


def test_a_list_of_too_many_lines_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder(tmp_path, "1.png")
    monkeypatch.setenv("LAVA_VPR_MAX_ROWS", "10")
    for name in ("l.txt", "l.csv"):
        refused(
            lambda name=name: open_traverse(written(tmp_path / name, b"1.png\n" * 11)),
            f"{name}: has 11 lines, more than the 10 allowed; if the file is sound, set LAVA_VPR_MAX_ROWS",
        )


@pytest.mark.timeout(20)
def test_lists_are_no_pipes(tmp_path: Path) -> None:
    for name in ("l.txt", "l.csv"):
        os.mkfifo(tmp_path / name)
        refused(lambda name=name: open_traverse(tmp_path / name), f"{name}: is neither a folder nor a file; give")


# ---------------------------------------------------------------- video


def levels(traverse: object) -> list[int]:
    return [round(float(image.mean()) / 3) for image in traverse.images()]  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["v.avi", "v.mkv", "v.MP4", "v.mov"])
def test_video_gives_one_frame_every_so_many_seconds(tmp_path: Path, name: str) -> None:
    path = video(tmp_path / name, 35)
    traverse = open_traverse(path)
    assert traverse.names == ("frame 000000", "frame 000010", "frame 000020", "frame 000030")
    assert traverse.indices.tolist() == [0, 1, 2, 3]
    assert levels(traverse) == [0, 10, 20, 30]
    first = next(traverse.images())
    assert (first.shape, first.dtype) == ((48, 64, 3), np.dtype(np.uint8))
    assert round(float(traverse.load(3).mean()) / 3) == 30


def test_video_sampling_rates_and_places(tmp_path: Path) -> None:
    path = video(tmp_path / "v.avi", 35)
    assert levels(open_traverse(path, every=0.5)) == [0, 5, 10, 15, 20, 25, 30]
    assert levels(open_traverse(path, every=0.25)) == [0, 3, 5, 8, 10, 13, 15, 18, 20, 23, 25, 28, 30, 33]
    assert levels(open_traverse(path, every=0.001)) == list(range(35))  # no frame twice
    assert levels(open_traverse(path, every=100.0)) == [0]
    part = open_traverse(path, every=0.5, places=(2, 5))
    assert part.indices.tolist() == [2, 3, 4]
    assert levels(part) == [10, 15, 20]
    assert levels(part.take([2, 0, 0, 1])) == [20, 10, 10, 15]
    text = "v.avi: has 4 frames at this --every; places 1:9 go beyond, use at most 0:4"
    refused(lambda: open_traverse(path, places=(1, 9)), text)


def test_video_of_an_odd_frame_rate(tmp_path: Path) -> None:
    path = video(tmp_path / "v.mkv", 70, fps=29.97)
    assert open_traverse(path).frames.tolist() == [0, 30, 60]  # type: ignore[union-attr]


def test_videos_that_cannot_be_used(tmp_path: Path) -> None:
    good = video(tmp_path / "v.mp4", 20)
    for name, data, why in (
        ("zero.avi", b"", "is empty (0 bytes); copy it again or remove it"),
        ("text.mp4", b"hello" * 99, "is no AVI, MP4, QuickTime, Matroska, WebM or MPEG program stream video, whatever"),
        ("cut.mp4", good.read_bytes()[:2000], "is damaged or cut short (it has 2,000 of"),
    ):
        path = written(tmp_path / name, data)
        refused(lambda path=path: open_traverse(path), f"{name}: {why}")
    empty = written(tmp_path / "head.avi", video(tmp_path / "w.avi", 20).read_bytes()[:5700])
    refused(lambda: open_traverse(empty), "head.avi: ", "video")
    for every in (0.0, -1.0, float("nan"), float("inf")):
        refused(lambda every=every: open_traverse(good, every=every), f"--every is {every}, but must be")
    traverse = open_traverse(good, every=0.1)
    video(good, 5)
    refused(lambda: list(traverse.images()), "v.mp4: has no frame 5 any more; was the file changed?")


def test_damaged_videos_print_nothing(tmp_path: Path) -> None:
    # In a process of its own: ffmpeg takes its log level once, here from the videos that other tests write.
    whole = video(tmp_path / "w.avi", 20).read_bytes()
    files = [written(tmp_path / "head.avi", whole[:5700]), written(tmp_path / "text.mp4", b"hello" * 99)]
    files.append(written(tmp_path / "noise.avi", whole[:8000] + bytes(3000) + whole[11000:]))
    code = (
        "import sys\n"
        "from lava_vpr.errors import InputError\n"
        "from lava_vpr.traverse import open_traverse\n"
        "for path in sys.argv[1:]:\n"
        "    try:\n"
        "        print(len(list(open_traverse(path, every=0.1).images())))\n"
        "    except InputError as error:\n"
        "        print(error)\n"
    )
    environment = {k: v for k, v in os.environ.items() if k != "OPENCV_FFMPEG_LOGLEVEL"}
    done = children.run(
        [sys.executable, "-c", code, *map(str, files)], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert "video" in lines[0]
    assert "text.mp4: is no AVI, MP4" in lines[1]
    assert len(lines) == 3


def test_video_is_decoded_in_one_pass(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = video(tmp_path / "v.avi", 30)
    traverse = open_traverse(path, every=0.2)
    opened = []
    original = videos._capture
    monkeypatch.setattr(videos, "_capture", lambda p: opened.append(p) or original(p))
    assert levels(traverse) == list(range(0, 30, 2))
    assert len(opened) == 1


class FakeCapture:
    """A video with these time stamps, in ms."""

    def __init__(self, stamps: list[float]) -> None:
        self.stamps, self.at = stamps, -1

    def grab(self) -> bool:
        self.at += 1
        return self.at < len(self.stamps)

    def get(self, what: int) -> float:
        return 10.0 if what == cv2.CAP_PROP_FPS else self.stamps[self.at]


def test_time_stamps_decide_which_frames_are_used(monkeypatch: pytest.MonkeyPatch) -> None:
    def sampled(stamps: list[float], every: float, stop: int | None = None) -> list[int]:
        fake = FakeCapture(stamps)
        monkeypatch.setattr(videos, "_capture", lambda _: contextlib.nullcontext((fake, Film("none"))))
        samples = itertools.islice(every_so_often(videos.video_samples(Path("v.mkv")), every), stop)
        frames = [sample.number for sample in samples]
        assert stop is None or fake.at == frames[-1]  # nothing is decoded in vain
        return frames

    assert sampled([0, 333, 667, 1000, 1333, 1667, 1999.6], 1.0) == [0, 3, 6]  # rounded to ms
    assert sampled([500, 900, 1500, 1600], 1.0) == [0, 2]  # a video need not begin at 0
    assert sampled([0, 50, 2700, 2750, 3050], 1.0) == [0, 2, 4]  # a long pause: no frame twice
    assert sampled([0, 900, 0], 1.0) == [0, 2]  # without a time: one period after the one before
    assert sampled([0, 0, 0, 0, 0], 0.2) == [0, 2, 4]
    assert sampled([0, 1000, 2000, 3000, 4000], 1.0, stop=2) == [0, 1]


# ---------------------------------------------------------------- real images


@pytest.mark.data
def test_real_traverse(data_root: Path) -> None:
    traverse = open_traverse(data_root / "data" / "nordland" / "summer", places=(100, 103))
    assert traverse.indices.tolist() == [100, 101, 102]
    for image, path in zip(traverse.images(), traverse.paths, strict=True):
        np.testing.assert_array_equal(image, cv2.imread(str(path), cv2.IMREAD_ANYCOLOR))
