"""Image files: formats, orientation, damage."""

from __future__ import annotations

import io
import logging
import os
import re
import struct
import threading
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, strategies as st
from support.common.imagefiles import (
    QUICK,
    exif,
    image_bytes,
    png,
    png_chunk,
    refused,
    smooth_picture,
    tiff,
    upright,
    webp_with_exif,
    written,
)

from lava_vpr.cli import group
from lava_vpr.errors import InputError
from lava_vpr.images import formats
from lava_vpr.images.formats import orientation_of, walk
from lava_vpr.images.imagefiles import decode_image, quiet, read_image
from lava_vpr.images.windows import DamagedError, Window
from lava_vpr.positions.track import read_track
from lava_vpr.traverse import open_traverse

# ---------------------------------------------------------------- image formats


COLOUR = {262: 2, 277: 3, 339: 1}
"""Tags of a TIFF."""


def lzw(data: bytes) -> bytes:
    """LZW codes of 9 bits for TIFF, none of them for more than one byte."""
    codes = [code for k, byte in enumerate(data) for code in ((256, byte) if k % 250 == 0 else (byte,))]
    bits = "".join(f"{code:09b}" for code in [*codes, 257])
    return int(bits.ljust(-(-len(bits) // 8) * 8, "0"), 2).to_bytes(-(-len(bits) // 8), "big")


def bmp_of_runs(width: int, height: int) -> bytes:
    """A run-length coded BMP: every row is one run of its own colour."""
    runs = b"".join(bytes([width, row, 0, 0]) for row in range(height)) + b"\0\1"
    palette = b"".join(bytes([k, k, k, 0]) for k in range(256))
    header = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 8, 1, len(runs), 0, 0, 256, 0)
    start = 14 + len(header) + len(palette)
    return b"BM" + struct.pack("<IHHI", start + len(runs), 0, 0, start) + header + palette + runs


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif", ".tiff", ".PNG", ".Bmp"])
@pytest.mark.parametrize("shape", [(24, 36, 3), (24, 36)])
def test_lossless_formats_come_back_exactly(tmp_path: Path, suffix: str, shape: tuple[int, ...]) -> None:
    image = smooth_picture(1, shape)
    got = read_image(written(tmp_path / f"a{suffix}", image_bytes(suffix, image)))
    assert got.dtype == np.uint8
    np.testing.assert_array_equal(got, image)


@pytest.mark.parametrize("suffix", [".jpg", ".jpeg", ".JPG", ".webp"])
def test_lossy_formats_come_back_nearly(tmp_path: Path, suffix: str) -> None:
    image = smooth_picture(2)
    got = read_image(written(tmp_path / f"a{suffix}", image_bytes(suffix, image)))
    assert got.shape == image.shape
    assert np.abs(got.astype(int) - image).mean() < 8


def test_grey_jpeg_stays_grey(tmp_path: Path) -> None:
    assert read_image(written(tmp_path / "g.jpg", image_bytes(".jpg", smooth_picture(3, (24, 36))))).shape == (24, 36)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".webp"])
def test_alpha_is_dropped_and_colours_stay_as_stored(tmp_path: Path, suffix: str) -> None:
    image, alpha = smooth_picture(4), smooth_picture(5, (24, 36)) | 1
    options = (cv2.IMWRITE_WEBP_QUALITY, 101) if suffix == ".webp" else ()
    data = image_bytes(suffix, np.dstack([image, alpha]), *options)
    np.testing.assert_array_equal(read_image(written(tmp_path / f"a{suffix}", data)), image)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_16_bits_become_the_nearest_8(tmp_path: Path, suffix: str) -> None:
    deep = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    got = read_image(written(tmp_path / f"a{suffix}", image_bytes(suffix, deep)))
    np.testing.assert_array_equal(got, np.floor(deep / 257 + 0.5).astype(np.uint8))
    image = smooth_picture(6)
    got = read_image(written(tmp_path / f"b{suffix}", image_bytes(suffix, image.astype(np.uint16) * 257)))
    np.testing.assert_array_equal(got, image)


def test_bilevel_palette_and_grey_alpha_png(tmp_path: Path) -> None:
    bits = png(8, 2, 1, 0, b"\0\xaa\0\x0f")
    expected = np.array([[1, 0, 1, 0, 1, 0, 1, 0], [0, 0, 0, 0, 1, 1, 1, 1]], dtype=np.uint8) * 255
    np.testing.assert_array_equal(read_image(written(tmp_path / "bits.png", bits)), expected)
    palette = png(2, 2, 8, 3, b"\0\0\1\0\1\0", png_chunk(b"PLTE", bytes([10, 20, 30, 40, 50, 60])))
    got = read_image(written(tmp_path / "palette.png", palette))
    np.testing.assert_array_equal(got, [[[30, 20, 10], [60, 50, 40]], [[60, 50, 40], [30, 20, 10]]])
    grey_alpha = png(2, 2, 8, 4, b"\0\7\0\x08\xff\0\x09\1\x0a\2")
    got = read_image(written(tmp_path / "ga.png", grey_alpha))
    np.testing.assert_array_equal(got, np.repeat(np.array([[7, 8], [9, 10]])[:, :, None], 3, axis=2))


@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_is_honoured_in_all_formats(tmp_path: Path, orientation: int) -> None:
    image = smooth_picture(7)
    for order in "<>":
        block = exif(orientation, order)
        plain = image_bytes(".jpg", image)
        app1 = b"\xff\xe1" + struct.pack(">H", len(block) + 8) + b"Exif\0\0" + block
        jpeg = written(tmp_path / f"{ord(order)}.jpg", plain[:2] + app1 + plain[2:])
        stored = cv2.imdecode(np.frombuffer(plain, dtype=np.uint8), cv2.IMREAD_COLOR)
        np.testing.assert_array_equal(read_image(jpeg), upright(stored, orientation))
        np.testing.assert_array_equal(read_image(jpeg), cv2.imread(str(jpeg)))  # OpenCV's own reading agrees
        plain = image_bytes(".png", image)
        path = written(tmp_path / f"{ord(order)}.png", plain[:33] + png_chunk(b"eXIf", block) + plain[33:])
        np.testing.assert_array_equal(read_image(path), upright(image, orientation))
        path = written(tmp_path / f"{ord(order)}.webp", webp_with_exif(image, block))
        np.testing.assert_array_equal(read_image(path), upright(image, orientation))
        written(path, webp_with_exif(image, b"Exif\0\0" + block))  # some writers copy JPEG's prefix
        np.testing.assert_array_equal(read_image(path), upright(image, orientation))
    path = written(tmp_path / "a.tif", tiff(image[:, :, 0].tobytes(), image.shape, {274: orientation}))
    np.testing.assert_array_equal(read_image(path), upright(image[:, :, 0], orientation))


@QUICK
@given(st.binary(max_size=60), st.sampled_from([b"", b"MM\0*\0\0\0\x08", b"II*\0\x08\0\0\0"]))
def test_any_exif_block_gives_an_orientation(block: bytes, start: bytes) -> None:
    assert 1 <= orientation_of(start + block) <= 8
    assert orientation_of(exif(9)) == 1


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int16, np.int32])
def test_samples_of_unknown_range_are_refused(tmp_path: Path, kind: type) -> None:
    image = smooth_picture(8).astype(kind)
    if kind is np.float32:
        image[0, 0, 0] = np.nan
    path = written(tmp_path / "f.tif", image_bytes(".tif", image))
    refused(lambda: read_image(path), "f.tif: holds", np.dtype(kind).name, "save it with 8 or 16 bits")


def test_smallest_image(tmp_path: Path) -> None:
    assert read_image(written(tmp_path / "2.png", image_bytes(".png", smooth_picture(9, (2, 2))))).shape == (2, 2)
    path = written(tmp_path / "1.png", image_bytes(".png", np.zeros((1, 5), dtype=np.uint8)))
    refused(lambda: read_image(path), "1.png: has 5 x 1 pixels, needs at least 2 x 2")


# ---------------------------------------------------------------- damage

_BIG = smooth_picture(10, (90, 120, 3))
_WHOLE = {
    "jpg": image_bytes(".jpg", _BIG),
    "progressive.jpg": image_bytes(".jpg", _BIG, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "restart.jpg": image_bytes(".jpg", _BIG, cv2.IMWRITE_JPEG_RST_INTERVAL, 2),
    "png": image_bytes(".png", _BIG),
    "bmp": image_bytes(".bmp", _BIG),
    "lzw.tif": image_bytes(".tif", _BIG),
    "raw.tif": image_bytes(".tif", _BIG, cv2.IMWRITE_TIFF_COMPRESSION, 1),
    "webp": image_bytes(".webp", _BIG),
    "lossless.webp": image_bytes(".webp", _BIG, cv2.IMWRITE_WEBP_QUALITY, 101),
}


@pytest.mark.parametrize("kind", _WHOLE)
def test_a_file_cut_short_anywhere_is_refused_in_one_line(
    tmp_path: Path, kind: str, capfd: pytest.CaptureFixture[str]
) -> None:
    data = _WHOLE[kind]
    read_image(written(tmp_path / f"x.{kind}", data))
    lengths = {1, 2, 3, 5, 9, 13, 21, 33, 40, len(data) - 2, len(data) - 1, *range(50, len(data), len(data) // 12)}
    for length in sorted(lengths):
        path = written(tmp_path / f"x.{kind}", data[:length])
        text = refused(lambda path=path: read_image(path), f"x.{kind}: is ")
        assert "damaged or cut short" in text or (length < 13 and "is not a JPEG" in text), text
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("kind", ["jpg", "progressive.jpg", "restart.jpg", "png", "webp", "bmp"])
def test_our_own_walk_finds_every_cut(kind: str) -> None:
    # Some OpenCV versions return half a picture and no error.
    data = _WHOLE[kind]
    for length in range(60, len(data), len(data) // 40):
        with pytest.raises(DamagedError):
            walk(data[:length])


_TAILED = {
    **{kind: data for kind, data in _WHOLE.items() if kind not in ("bmp", "raw.tif", "lzw.tif")},
    "alpha.webp": image_bytes(".webp", np.dstack([_BIG, _BIG[:, :, 0]]), cv2.IMWRITE_WEBP_QUALITY, 80),
    "16.png": image_bytes(".png", _BIG.astype(np.uint16) * 257),
    "first.lzw.tif": tiff(lzw(_BIG[:, :, ::-1].tobytes()), (90, 120), COLOUR | {259: 5}),
    "first.deflate.tif": tiff(zlib.compress(_BIG[:, :, ::-1].tobytes()), (90, 120), COLOUR | {259: 8}),
    "runs.bmp": bmp_of_runs(40, 30),
}


@pytest.mark.parametrize("kind", _TAILED)
def test_a_tail_of_zeros_is_refused_or_changes_nothing(kind: str) -> None:
    data = _TAILED[kind]
    whole = decode_image(data, "a")
    for length in [*range(40, len(data) - 128, len(data) // 40), len(data) - 128]:
        try:
            got = decode_image(data[:length].ljust(len(data), b"\0"), "a")
        except InputError as error:
            assert re.search("damaged or cut short|needs at least", str(error))  # noqa: PT017
        else:
            np.testing.assert_array_equal(got, whole)


@pytest.mark.parametrize("level", [0, 77, 255])
@pytest.mark.parametrize("quality", [1, 75, 101])
def test_an_honest_webp_that_ends_in_zeros_is_taken(level: int, quality: int) -> None:
    flat = np.full((400, 700, 3), level, np.uint8)
    flat[:100] = cv2.resize(_BIG, (700, 100))
    for image in (flat, flat[100:]):
        data = image_bytes(".webp", image, cv2.IMWRITE_WEBP_QUALITY, quality)
        assert decode_image(data, "a").shape == image.shape
    assert quality == 101 or walk(data).shortened  # it does end in zeros


# ---------------------------------------------------------------- cost


@pytest.mark.parametrize("kind", [*_WHOLE, *_TAILED])
def test_a_picture_beyond_the_limit_is_not_decoded(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    data = {**_WHOLE, **_TAILED}[kind]
    height, width = decode_image(data, "a").shape[:2]
    monkeypatch.setattr(cv2, "imdecode", None)
    monkeypatch.setenv("LAVA_VPR_MAX_IMAGE_PIXELS", str(width * height - 1))
    refused(lambda: decode_image(data, "a"), f"has {width} x {height} = {width * height:,} pixels, more than the ")


def test_what_a_small_file_claims_is_refused_before_it_is_paid(tmp_path: Path) -> None:
    wide = png(30_000, 30_000, 8, 2, b"\0" * 90_001)
    refused(
        lambda: read_image(written(tmp_path / "a.png", wide)), "a.png: has 30000 x 30000 = 900,000,000 pixels, more"
    )
    wider = image_bytes(".bmp", np.ones((2, (1 << 20) + 1), np.uint8))
    refused(lambda: decode_image(wider, "a"), "a: is larger than OPENCV_IO_MAX_IMAGE_WIDTH lets OpenCV decode; raise")
    samples = bytearray(image_bytes(".tif", smooth_picture(8).astype(np.float64)))
    refused(lambda: decode_image(bytes(samples), "a"), "holds float64 samples")
    scans = _WHOLE["progressive.jpg"]
    scan = scans.rindex(b"\xff\xda")
    refused(
        lambda: decode_image(scans[:scan] + scans[scan:-2] * 120 + b"\xff\xd9", "a"), "has 101 scans, more than the 100"
    )
    texts = [png_chunk(kind, b"k\0\0" + zlib.compress(bytes(7_000_000), 9)) for kind in (b"zTXt", b"iCCP")]
    data = png(2, 2, 8, 0, b"\0\1\2\0\3\4", *texts * 50)
    assert len(walk(data).data) < 100  # each would take 80 ms to unpack
    np.testing.assert_array_equal(decode_image(data, "a"), [[1, 2], [3, 4]])


def test_many_parts_of_an_image_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LAVA_VPR_MAX_IMAGE_PARTS", "3")
    chunk = png_chunk(b"ruNk", b"")
    refused(
        lambda: decode_image(png(2, 2, 8, 0, bytes(6), chunk, chunk, chunk), "a"),
        "has 4 parts, more than the 3 allowed",
    )
    whole, one = tiff(bytes(12), (2, 2), COLOUR), struct.pack("<HHII", 279, 4, 1, 12)
    assert decode_image(whole, "a").shape == (2, 2, 3)
    refused(
        lambda: decode_image(whole.replace(one, struct.pack("<HHII", 279, 4, 4, 12)), "a"), "has 4 parts, more than"
    )
    doubled = b"II*\0" + struct.pack("<IH", 8, 9) + 9 * struct.pack("<HHII", 273, 4, 3, 0)
    assert [tag for tag, _ in formats.entries(Window(doubled, "image_parts"), {273})] == [273]


@pytest.mark.timeout(20)
def test_a_pipe_in_place_of_an_image_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "p.png")
    refused(lambda: read_image(tmp_path / "p.png"), "p.png: cannot be read (is a named pipe, not a file)")


def _animated(kind: str) -> bytes:
    """Two frames or pages, by Pillow."""
    pillow, data = pytest.importorskip("PIL.Image"), io.BytesIO()
    first, second = (pillow.fromarray(smooth_picture(seed)) for seed in (0, 1))
    first.save(data, kind, save_all=True, append_images=[second])
    return data.getvalue()


_FLAT = np.vstack([np.zeros((8, 30, 3), np.uint8), smooth_picture(3, (16, 30, 3))])
_NOTED: dict[str, tuple[Callable[[], bytes], str]] = {
    "apng": (lambda: _animated("png"), "holds several pictures (pages or frames), of which the first is read"),
    "webp": (lambda: _animated("webp"), "holds several pictures"),
    "tiff": (lambda: _animated("tiff"), "holds several pictures"),
    "12.png": (lambda: image_bytes(".png", _BIG.astype(np.uint16) * 16), "fill only 12 of 16 bits and are read as"),
    "10.tif": (
        lambda: image_bytes(".tif", _BIG.astype(np.uint16) * 4),
        "only 10 of 16 bits.*; multiply all images by one number, at most 64",
    ),
    "zeros.bmp": (lambda: image_bytes(".bmp", _FLAT), "the last 8 rows of pixels in the file are 0"),
    "zeros.tif": (lambda: image_bytes(".tif", _FLAT[::-1], 259, 1), "the last 8 rows of pixels in the file are 0"),
    "16.png": (lambda: image_bytes(".png", _BIG.astype(np.uint16) * 257), ""),
    "black.bmp": (lambda: image_bytes(".bmp", np.zeros((9, 9), np.uint8)), ""),
    **{kind: (lambda data=data: data, "") for kind, data in _WHOLE.items()},  # type: ignore[misc]
}
"""Files, and what is logged of them."""


@pytest.mark.parametrize("kind", _NOTED)
def test_what_is_read_otherwise_than_its_user_may_think_is_noted(kind: str, caplog: pytest.LogCaptureFixture) -> None:
    make, text = _NOTED[kind]
    with caplog.at_level(logging.INFO, "lava_vpr"):
        decode_image(make(), "a.png")
    assert len(caplog.messages) == bool(text)
    assert all(re.match(f"a.png: .*{text.replace('(', '[(]').replace(')', '[)]')}", said) for said in caplog.messages)


def test_a_command_tells_the_first_of_each_sort(capsys: pytest.CaptureFixture[str]) -> None:
    for _ in range(2):  # each command tells it
        capsys.readouterr()
        notes = group._Notes()
        for name in "ab":
            for text, sort in (("dark", "bits"), ("two", "pictures"), ("once more", None)):
                record = logging.LogRecord("lava_vpr", logging.INFO, "", 0, f"{name}: {text}", None, None)
                record.__dict__ |= {} if sort is None else {"sort": sort}
                notes.emit(record)
        told = capsys.readouterr().err.splitlines()
        assert told == ["note: a: dark", "note: a: two", "note: a: once more", "note: b: once more"]


def test_trailing_bytes_do_no_harm(tmp_path: Path) -> None:
    for kind, data in _WHOLE.items():
        whole = read_image(written(tmp_path / f"a.{kind}", data))
        np.testing.assert_array_equal(read_image(written(tmp_path / f"b.{kind}", data + b"\0tail\xff\xd8")), whole)


@QUICK
@given(st.sampled_from(sorted(_WHOLE)), st.integers(0, 10**6), st.binary(min_size=1, max_size=4))
def test_damaged_bytes_give_a_picture_or_a_clear_error(kind: str, at: int, garbage: bytes) -> None:
    data = bytearray(_WHOLE[kind])
    at %= len(data)
    data[at : at + len(garbage)] = garbage
    cause = ""
    try:
        assert decode_image(bytes(data), "a").dtype == np.uint8
    except InputError as error:
        cause = str(error)
    assert not cause or re.match("a: (is|has|holds) ", cause)


def test_damaged_files_print_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    raw = bytearray(_WHOLE["png"])
    raw[len(raw) // 2] ^= 0xFF
    refused(lambda: read_image(written(tmp_path / "a.png", bytes(raw))), "a.png", "checksum of its 'IDAT' chunk")
    idat = png(4, 4, 8, 0, b"\0\0", png_chunk(b"tEXt", b"no zero byte"))  # far too few rows
    refused(lambda: read_image(written(tmp_path / "b.png", idat)), "b.png: is damaged")
    jpeg = _WHOLE["jpg"]
    broken = written(tmp_path / "c.jpg", jpeg[: len(jpeg) // 2] + b"\xff\xd9")
    refused(lambda: read_image(broken), "c.jpg: is damaged or cut short (part of its picture data is missing)")
    assert capfd.readouterr() == ("", "")


def test_what_other_threads_print_meanwhile_is_kept(capfd: pytest.CaptureFixture[str]) -> None:
    with quiet() as messages:
        other = threading.Thread(target=os.write, args=(2, b"progress 50 %\n"))
        other.start()
        other.join(60)
        os.write(2, b"libpng warning: iCCP: known incorrect sRGB profile\n")
    assert capfd.readouterr().err == "progress 50 %\n"
    assert messages == [b"libpng warning: iCCP: known incorrect sRGB profile\n"]


def test_files_that_are_no_images(tmp_path: Path) -> None:
    refused(lambda: read_image(written(tmp_path / "zero.png", b"")), "zero.png: is empty (0 bytes); copy it again")
    text = written(tmp_path / "text.png", b"hello, this is text\n" * 9)
    refused(lambda: read_image(text), "text.png: is not a JPEG, PNG, BMP, TIFF or WebP image", "replace or remove")
    refused(lambda: read_image(tmp_path / "no.png"), "no.png: cannot be read (No such file or directory); check path")
    jpeg_named_png = written(tmp_path / "j.png", image_bytes(".jpg", smooth_picture()))
    assert read_image(jpeg_named_png).shape == (24, 36, 3)


def test_unreadable_file_and_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path / "secret.png", image_bytes(".png", smooth_picture()))

    def denied(*_: object) -> bytes:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", denied)
    refused(lambda: open_traverse(tmp_path).load(0), "secret.png: cannot be read (Permission denied); check")
    refused(lambda: read_track(path), "secret.png: cannot be read (Permission denied); check")
    monkeypatch.setattr(os, "scandir", denied)
    refused(lambda: open_traverse(tmp_path), f"{tmp_path}: cannot be read (Permission denied)")
