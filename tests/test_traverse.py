"""Traverses: every source, every image format, damage, positions, ground truth; each error by its text."""

from __future__ import annotations

import json
import os
import re
import struct
import subprocess
import sys
import threading
import tracemalloc
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lava_vpr import imageio
from lava_vpr.errors import InputError
from lava_vpr.imageio import natural_key, read_image
from lava_vpr.traverse import (
    EARTH_RADIUS_M,
    open_traverse,
    read_ground_truth,
    read_positions,
    read_positions_pair,
)

QUICK = settings(deadline=None, derandomize=True, max_examples=25)


def picture(seed: int = 0, shape: tuple[int, ...] = (24, 36, 3)) -> NDArray[np.uint8]:
    """A smooth random picture, all pixels different enough to see any turn of it."""
    noise = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 2)


def encoded(suffix: str, image: NDArray[np.generic], *options: int) -> bytes:
    good, data = cv2.imencode(suffix, image, options)
    assert good
    return bytes(data)


def written(path: Path, data: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def exif(orientation: int, order: str = ">") -> bytes:
    magic = {">": b"MM\0*", "<": b"II*\0"}[order]
    return magic + struct.pack(order + "IHHHIHHI", 8, 1, 0x0112, 3, 1, orientation, 0, 0)


def upright(image: NDArray[np.uint8], orientation: int) -> NDArray[np.uint8]:
    """The literal EXIF table: where row 0 and column 0 of the stored picture are on the upright one."""
    return {
        1: image,
        2: np.fliplr(image),
        3: np.rot90(image, 2),
        4: np.flipud(image),
        5: image.swapaxes(0, 1),
        6: np.rot90(image, -1),
        7: np.rot90(image.swapaxes(0, 1), 2),
        8: np.rot90(image, 1),
    }[orientation]


def png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width: int, height: int, depth: int, colour: int, rows: bytes, *chunks: bytes) -> bytes:
    header = png_chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0))
    body = header + b"".join(chunks) + png_chunk(b"IDAT", zlib.compress(rows)) + png_chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def tiff(image: NDArray[np.uint8], orientation: int) -> bytes:
    """An uncompressed grey TIFF with an orientation tag."""
    h, w = image.shape
    tags = [(256, w), (257, h), (258, 8), (259, 1), (262, 1), (273, 134), (274, orientation), (277, 1), (278, h)]
    tags.append((279, w * h))
    directory = b"".join(struct.pack("<HHII", tag, 4 if tag in (273, 279) else 3, 1, value) for tag, value in tags)
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + directory + b"\0\0\0\0" + image.tobytes()


def webp_with_exif(image: NDArray[np.uint8], block: bytes) -> bytes:
    size = struct.pack("<I", image.shape[1] - 1)[:3] + struct.pack("<I", image.shape[0] - 1)[:3]
    extended = b"VP8X" + struct.pack("<I", 10) + bytes([8, 0, 0, 0]) + size
    body = b"WEBP" + extended + encoded(".webp", image, cv2.IMWRITE_WEBP_QUALITY, 101)[12:]
    body += b"EXIF" + struct.pack("<I", len(block)) + block + b"\0" * (len(block) % 2)
    return b"RIFF" + struct.pack("<I", len(body)) + body


def video(path: Path, frames: int, fps: float = 10.0, size: tuple[int, int] = (64, 48)) -> Path:
    """An MJPG video whose frame k is grey of level 3 k."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, size)
    assert writer.isOpened()
    for k in range(frames):
        writer.write(np.full((size[1], size[0], 3), 3 * k % 256, dtype=np.uint8))
    writer.release()
    return path


def refused(call: object, *parts: str) -> str:
    """The text of the InputError that ``call`` raises: one line that holds all ``parts``."""
    with pytest.raises(InputError) as caught:
        call()  # type: ignore[operator]
    text = str(caught.value)
    assert "\n" not in text
    for part in parts:
        assert part in text, text
    return text


# ---------------------------------------------------------------- image formats


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif", ".tiff", ".PNG", ".Bmp"])
@pytest.mark.parametrize("shape", [(24, 36, 3), (24, 36)])
def test_lossless_formats_come_back_exactly(tmp_path: Path, suffix: str, shape: tuple[int, ...]) -> None:
    image = picture(1, shape)
    got = read_image(written(tmp_path / f"a{suffix}", encoded(suffix, image)))
    assert got.dtype == np.uint8
    np.testing.assert_array_equal(got, image)


@pytest.mark.parametrize("suffix", [".jpg", ".jpeg", ".JPG", ".webp"])
def test_lossy_formats_come_back_nearly(tmp_path: Path, suffix: str) -> None:
    image = picture(2)
    got = read_image(written(tmp_path / f"a{suffix}", encoded(suffix, image)))
    assert got.shape == image.shape
    assert np.abs(got.astype(int) - image).mean() < 8


def test_grey_jpeg_stays_grey(tmp_path: Path) -> None:
    assert read_image(written(tmp_path / "g.jpg", encoded(".jpg", picture(3, (24, 36))))).shape == (24, 36)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".webp"])
def test_alpha_is_dropped_and_colours_stay_as_stored(tmp_path: Path, suffix: str) -> None:
    image, alpha = picture(4), picture(5, (24, 36)) | 1
    options = (cv2.IMWRITE_WEBP_QUALITY, 101) if suffix == ".webp" else ()
    data = encoded(suffix, np.dstack([image, alpha]), *options)
    np.testing.assert_array_equal(read_image(written(tmp_path / f"a{suffix}", data)), image)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_16_bits_become_the_nearest_8(tmp_path: Path, suffix: str) -> None:
    deep = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    got = read_image(written(tmp_path / f"a{suffix}", encoded(suffix, deep)))
    np.testing.assert_array_equal(got, np.floor(deep / 257 + 0.5).astype(np.uint8))
    image = picture(6)
    got = read_image(written(tmp_path / f"b{suffix}", encoded(suffix, image.astype(np.uint16) * 257)))
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
    image = picture(7)
    for order in "<>":
        block = exif(orientation, order)
        plain = encoded(".jpg", image)
        app1 = b"\xff\xe1" + struct.pack(">H", len(block) + 8) + b"Exif\0\0" + block
        jpeg = written(tmp_path / f"{ord(order)}.jpg", plain[:2] + app1 + plain[2:])
        stored = cv2.imdecode(np.frombuffer(plain, dtype=np.uint8), cv2.IMREAD_COLOR)
        np.testing.assert_array_equal(read_image(jpeg), upright(stored, orientation))
        np.testing.assert_array_equal(read_image(jpeg), cv2.imread(str(jpeg)))  # OpenCV's own reading agrees
        plain = encoded(".png", image)
        path = written(tmp_path / f"{ord(order)}.png", plain[:33] + png_chunk(b"eXIf", block) + plain[33:])
        np.testing.assert_array_equal(read_image(path), upright(image, orientation))
        path = written(tmp_path / f"{ord(order)}.webp", webp_with_exif(image, block))
        np.testing.assert_array_equal(read_image(path), upright(image, orientation))
    path = written(tmp_path / "a.tif", tiff(image[:, :, 0], orientation))
    np.testing.assert_array_equal(read_image(path), upright(image[:, :, 0], orientation))


@QUICK
@given(st.binary(max_size=60), st.sampled_from([b"", b"MM\0*\0\0\0\x08", b"II*\0\x08\0\0\0"]))
def test_any_exif_block_gives_an_orientation(block: bytes, start: bytes) -> None:
    assert 1 <= imageio._orientation(start + block) <= 8
    assert imageio._orientation(exif(9)) == 1


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int16, np.int32])
def test_samples_of_unknown_range_are_refused(tmp_path: Path, kind: type) -> None:
    image = picture(8).astype(kind)
    if kind is np.float32:
        image[0, 0, 0] = np.nan
    path = written(tmp_path / "f.tif", encoded(".tif", image))
    refused(lambda: read_image(path), "f.tif: holds", np.dtype(kind).name, "save it with 8 or 16 bits")


def test_smallest_image(tmp_path: Path) -> None:
    assert read_image(written(tmp_path / "2.png", encoded(".png", picture(9, (2, 2))))).shape == (2, 2)
    path = written(tmp_path / "1.png", encoded(".png", np.zeros((1, 5), dtype=np.uint8)))
    refused(lambda: read_image(path), "1.png: has 5 x 1 pixels, needs at least 2 x 2")


# ---------------------------------------------------------------- damage

_BIG = picture(10, (90, 120, 3))
_WHOLE = {
    "jpg": encoded(".jpg", _BIG),
    "progressive.jpg": encoded(".jpg", _BIG, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "restart.jpg": encoded(".jpg", _BIG, cv2.IMWRITE_JPEG_RST_INTERVAL, 2),
    "png": encoded(".png", _BIG),
    "bmp": encoded(".bmp", _BIG),
    "lzw.tif": encoded(".tif", _BIG),
    "raw.tif": encoded(".tif", _BIG, cv2.IMWRITE_TIFF_COMPRESSION, 1),
    "webp": encoded(".webp", _BIG),
    "lossless.webp": encoded(".webp", _BIG, cv2.IMWRITE_WEBP_QUALITY, 101),
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
        with pytest.raises((imageio._DamagedError, struct.error)):
            imageio._walk(data[:length])


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
        assert imageio.decode_image(bytes(data)).dtype == np.uint8
    except InputError as error:
        cause = str(error)
    assert not cause or re.match("is |has |holds ", cause)


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
    with imageio._quiet() as messages:
        other = threading.Thread(target=os.write, args=(2, b"progress 50 %\n"))
        other.start()
        other.join()
        os.write(2, b"libpng warning: iCCP: known incorrect sRGB profile\n")
    assert capfd.readouterr().err == "progress 50 %\n"
    assert messages == [b"libpng warning: iCCP: known incorrect sRGB profile\n"]


def test_files_that_are_no_images(tmp_path: Path) -> None:
    refused(lambda: read_image(written(tmp_path / "zero.png", b"")), "zero.png: is empty (0 bytes); copy it again")
    text = written(tmp_path / "text.png", b"hello, this is text\n" * 9)
    refused(lambda: read_image(text), "text.png: is not a JPEG, PNG, BMP, TIFF or WebP image", "replace or remove")
    refused(lambda: read_image(tmp_path / "no.png"), "no.png: cannot be read (No such file or directory); check path")
    jpeg_named_png = written(tmp_path / "j.png", encoded(".jpg", picture()))
    assert read_image(jpeg_named_png).shape == (24, 36, 3)


def test_unreadable_file_and_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path / "secret.png", encoded(".png", picture()))

    def denied(*_: object) -> bytes:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", denied)
    refused(lambda: open_traverse(tmp_path).load(0), "secret.png: cannot be read (Permission denied); check")
    refused(lambda: read_positions(path), "secret.png: cannot be read (Permission denied); check")
    monkeypatch.setattr(os, "scandir", denied)
    refused(lambda: open_traverse(tmp_path), f"{tmp_path}: cannot be read (Permission denied)")


# ---------------------------------------------------------------- folders


def folder(path: Path, *names: str) -> Path:
    for k, name in enumerate(names):
        written(path / name, encoded(".png", np.full((2, 2), k, dtype=np.uint8)))
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
    path = written(tmp_path / "one.jpg", encoded(".jpg", picture()))
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
    refused(lambda: open_traverse(written(tmp_path / "x.npy", b"")), "x.npy: is of no known type; give a folder")
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
    data = encoded(".png", picture())
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
    written(tmp_path / "2.png", _WHOLE["png"][:200])
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
    data = encoded(".png", image)
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
        ("picture,x\n2.png,5\n", ("2.png",)),
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
    listing("l.csv", b"x,image\n1,1.png\n2\n", "l.csv line 3: names no file")
    listing("l.txt", b"1.png\n\xff\n", "l.txt line 2: is not UTF-8 text; save the file as UTF-8")
    listing("l.csv", b"1.png\n1\0.png\n", "l.csv line 2")
    listing("l.txt", b"1.png\n1\0.png\n", "l.txt line 2: names no file")


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
    text = "v.avi: has 4 frames, one every 1 s; places 1:9 go beyond, use at most 0:4"
    refused(lambda: open_traverse(path, places=(1, 9)), text)


def test_video_of_an_odd_frame_rate(tmp_path: Path) -> None:
    path = video(tmp_path / "v.mkv", 70, fps=29.97)
    assert open_traverse(path).frames.tolist() == [0, 30, 60]  # type: ignore[union-attr]


def test_videos_that_cannot_be_used(tmp_path: Path) -> None:
    good = video(tmp_path / "v.mp4", 20)
    for name, data in (("zero.avi", b""), ("text.mp4", b"hello" * 99), ("cut.mp4", good.read_bytes()[:2000])):
        path = written(tmp_path / name, data)
        refused(lambda path=path: open_traverse(path), f"{name}: cannot be decoded as a video; convert it")
    empty = written(tmp_path / "head.avi", video(tmp_path / "w.avi", 20).read_bytes()[:5700])
    refused(lambda: open_traverse(empty), "head.avi: ", "video")
    for every in (0.0, -1.0, float("nan"), float("inf")):
        refused(lambda every=every: open_traverse(good, every=every), f"--every is {every}, but must be")
    traverse = open_traverse(good, every=0.1)
    video(good, 5)
    refused(lambda: list(traverse.images()), "v.mp4: frame 5 cannot be decoded; was the file changed?")


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
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, files)], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert "video" in lines[0]
    assert "text.mp4: cannot be decoded as a video" in lines[1]
    assert len(lines) == 3


def test_video_is_decoded_in_one_pass(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = video(tmp_path / "v.avi", 30)
    traverse = open_traverse(path, every=0.2)
    opened = []
    original = imageio._capture
    monkeypatch.setattr(imageio, "_capture", lambda p: opened.append(p) or original(p))
    assert levels(traverse) == list(range(0, 30, 2))
    assert len(opened) == 1


# ---------------------------------------------------------------- positions


def positions(path: Path, text: str) -> Path:
    return written(path, text.encode())


@pytest.mark.parametrize(
    "text", ["x,y\n1,2\n3.5,-4e1\n", "1,2\n3.5,-4e1", "n,Y,X\n0,2,1\n\n# c\n1,-40,3.5\n", "1;2\n3.5;-40"]
)
def test_positions_in_metres(tmp_path: Path, text: str) -> None:
    got = read_positions(positions(tmp_path / "p.csv", text))
    assert got.dtype == np.float64
    np.testing.assert_array_equal(got, [[1, 2], [3.5, -40]])


def haversine(a: tuple[float, float], b: tuple[float, float]) -> float:
    (la, oa), (lb, ob) = np.radians(a), np.radians(b)
    h = np.sin((lb - la) / 2) ** 2 + np.cos(la) * np.cos(lb) * np.sin((ob - oa) / 2) ** 2
    return float(2 * EARTH_RADIUS_M * np.arcsin(np.sqrt(h)))


@QUICK
@given(
    st.floats(-60, 60),
    st.floats(-180, 180),
    st.lists(st.tuples(st.floats(-0.09, 0.09), st.floats(-0.09, 0.09)), min_size=2, max_size=5),
)
def test_degrees_become_metres(
    tmp_path_factory: pytest.TempPathFactory, lat: float, lon: float, steps: list[tuple[float, float]]
) -> None:
    base = tmp_path_factory.mktemp("p")
    points = [(lat, lon)] + [(lat + a, (lon + b + 180) % 360 - 180) for a, b in steps]
    reference = "latitude,longitude\n" + "".join(f"{a!r},{b!r}\n" for a, b in points)
    query = "lon,lat\n" + "".join(f"{b!r},{a!r}\n" for a, b in reversed(points))
    ours, theirs = read_positions_pair(positions(base / "r.csv", reference), positions(base / "q.csv", query))
    np.testing.assert_allclose(theirs, ours[::-1], atol=1e-6)
    np.testing.assert_array_equal(ours[0], [0, 0])
    for k in range(1, len(points)):
        assert abs(np.hypot(*(ours[k] - ours[k - 1])) - haversine(points[k], points[k - 1])) <= 1e-3 + 0.01 * haversine(
            points[k], points[k - 1]
        )


def test_directions_of_the_projection(tmp_path: Path) -> None:
    got = read_positions(positions(tmp_path / "p.csv", "lat,lon\n60,10\n60.001,10\n60,10.001\n"))
    north = EARTH_RADIUS_M * np.radians(0.001)
    np.testing.assert_allclose(got, [[0, 0], [0, north], [north / 2, 0]], atol=1e-5)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ["p.csv: holds no positions; write one row an image"]),
        ("x,y\n", ["p.csv: holds no positions"]),
        ("a,b\n1,2\n", ["p.csv line 1: no columns x,y or lat,lon among a, b; name them"]),
        ("1,2,3\n", ["p.csv line 1: has 3 columns and no header; add one: x,y"]),
        ("x,y\n1,2\n3\n", ["p.csv line 3: y is ''"]),
        ("x,y\n\n1,2\n3,nan\n", ["p.csv line 4: y is 'nan'; give a number"]),
        ("x,y\ninf,2\n", ["p.csv line 2: x is 'inf'"]),
        ("1,2\n3,four\n", ["p.csv line 2: y is 'four'"]),
        ("lat,lon\n91,2\n", ["p.csv line 2: latitude is '91'; give a number in its range"]),
        ("lat,lon\n9,400\n", ["p.csv line 2: longitude is '400'"]),
    ],
)
def test_positions_that_cannot_be_used(tmp_path: Path, text: str, parts: list[str]) -> None:
    path = positions(tmp_path / "p.csv", text)
    refused(lambda: read_positions(path), *parts)


def test_positions_of_two_kinds_do_not_mix(tmp_path: Path) -> None:
    metres, degrees = positions(tmp_path / "r.csv", "x,y\n1,2\n"), positions(tmp_path / "q.csv", "lat,lon\n1,2\n")
    refused(lambda: read_positions_pair(metres, degrees), "q.csv: only one of it and", "r.csv holds lat,lon; give both")
    ours, theirs = read_positions_pair(metres, metres)
    np.testing.assert_array_equal(ours, theirs)
    refused(lambda: read_positions(tmp_path / "no.csv"), "no.csv: cannot be read (No such file or directory)")


# ---------------------------------------------------------------- ground truth

QUERIES, PLACES = np.array([10, 11, 12], dtype=np.int64), np.array([20, 21, 22, 23], dtype=np.int64)
#: Query 10 is at 20 and 21, query 11 nowhere, query 12 at 23.
TRUTH = np.array([[1, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]], dtype=bool)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("t.txt", "# truth\n10: 20 21\n11:\n12: 23 99\n"),
        ("t.txt", "12 23\n10 21 # not 22\n10 20\n5 1\n"),
        ("t.csv", "query,places\n10,20;21\n12,23\n"),
        ("t.csv", "10,20,21\r\n11\r\n12,23\r\n"),
        ("t.json", '{"10": [20, 21], "11": [], "12": 23, "77": [1]}'),
        ("t.json", '{"10": [20], "10": 21, "12": [23]}'),
        ("t.json", "[[20, 21], [], [23, 5]]"),
        ("t.json", json.dumps([[]] * 10 + [[20, 21], [], 23])),
    ],
)
def test_ground_truth_as_text(tmp_path: Path, name: str, text: str) -> None:
    got = read_ground_truth(written(tmp_path / name, text.encode()), QUERIES, PLACES)
    assert got.dtype == np.bool_
    np.testing.assert_array_equal(got, TRUTH)


def _wide() -> NDArray[np.bool_]:
    wide = np.zeros((13, 24), dtype=bool)
    wide[10:13, 20:24] = TRUTH
    wide[3, 3] = True
    return wide


@pytest.mark.parametrize(
    "array",
    [
        np.array([[10, 20], [12, 23], [10, 21], [3, 4]]),
        np.array([[12, 23], [10, 20], [10, 21]], dtype=np.uint16),
        TRUTH,
        TRUTH.astype(np.uint8),
        TRUTH.astype(np.float64),
        _wide(),
        _wide()[:, :24].astype(np.int64),
    ],
)
def test_ground_truth_as_array(tmp_path: Path, array: NDArray[np.generic]) -> None:
    np.save(tmp_path / "t.npy", array)
    np.testing.assert_array_equal(read_ground_truth(tmp_path / "t.npy", QUERIES, PLACES), TRUTH)


def test_ground_truth_as_one_place_a_query(tmp_path: Path) -> None:
    expected = np.array([[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]], dtype=bool)
    for array in ([21, -1, 23], [0] * 10 + [21, -1, 23, 7]):
        np.save(tmp_path / "t.npy", np.array(array))
        np.testing.assert_array_equal(read_ground_truth(tmp_path / "t.npy", QUERIES, PLACES), expected)


@QUICK
@given(st.lists(st.lists(st.integers(0, 30), max_size=4), min_size=1, max_size=8), st.integers(0, 20))
def test_all_formats_say_the_same(tmp_path_factory: pytest.TempPathFactory, sets: list[list[int]], offset: int) -> None:
    base = tmp_path_factory.mktemp("t")
    queries = np.arange(offset, offset + len(sets), dtype=np.int64)
    places = np.arange(31, dtype=np.int64)
    literal = np.array([[int(p) in places_of for p in places] for places_of in sets])
    text = "".join(f"{q}: {' '.join(map(str, s))}\n" for q, s in zip(queries, sets, strict=True))
    mapping = {str(q): s for q, s in zip(queries, sets, strict=True)}
    written(base / "a.txt", text.encode())
    written(base / "a.csv", text.replace(": ", ",").replace(" ", ";").encode())
    written(base / "a.json", json.dumps(mapping).encode())
    written(base / "b.json", json.dumps(sets).encode())
    np.save(base / "a.npy", literal)
    for name in ("a.txt", "a.csv", "a.json", "b.json", "a.npy"):
        np.testing.assert_array_equal(read_ground_truth(base / name, queries, places), literal)


@pytest.mark.parametrize(
    ("name", "text", "parts"),
    [
        ("t.txt", "", ["t.txt: holds no ground truth; write lines such as 7: 6 7 8"]),
        ("t.txt", "10: 20\n11: x\n", ["t.txt line 2: 'x' is no index"]),
        ("t.txt", "10: 20\n\n11: -4\n", ["t.txt line 3: '-4' is no index"]),
        ("t.txt", "10: 20.5\n", ["t.txt line 1: '20.5' is no index"]),
        ("t.csv", "q,p\nq,p\n10,20\n", ["t.csv line 2: 'q' is no index"]),
        ("t.txt", "10: 20\n,;\n", ["t.txt line 2: ',;' is no index"]),
        ("t.txt", "10: " + "9" * 5000, ["t.txt line 1"]),
        ("t.txt", "0: 20\n1: 21\n", ["t.txt: names no query of this run (10..12); use absolute indices"]),
        ("t.txt", "10: 1\n11: 2\n", ["t.txt: names no place of this run (20..23); use absolute indices"]),
        ("t.json", '{"10": [20],\n "11": ]}', ["t.json line 2: is not JSON"]),
        ("t.json", "3", ["t.json: holds a single value; write"]),
        ("t.json", '{"ten": [20]}', ["t.json: key 'ten' is no index of a query"]),
        ("t.json", '{"10": [20.0]}', ["t.json: query 10 has a place that is no index"]),
        ("t.json", '{"10": [true]}', ["t.json: query 10 has a place that is no index"]),
        ("t.json", '{"10": {"20": 1}}', ["t.json: query 10 has a place"]),
        ("t.json", "[[20], [21]]", ["t.json: has 2 entries for 3 queries (10..12); give one for each of this run"]),
        ("t.json", "[" * 100_000, ["t.json: is not JSON"]),
        ("t.npy", "not numpy", ["t.npy: is no NumPy file of numbers; save integers (n,)"]),
        ("t.mat", "", ["t.mat: is no known type of ground truth; give a .txt, .csv, .json or .npy file"]),
    ],
)
def test_ground_truth_that_cannot_be_used(tmp_path: Path, name: str, text: str, parts: list[str]) -> None:
    path = written(tmp_path / name, text.encode())
    refused(lambda: read_ground_truth(path, QUERIES, PLACES), *parts)


@pytest.mark.parametrize(
    ("array", "part"),
    [
        (np.array([{"a": 1}], dtype=object), "is no NumPy file of numbers"),
        (np.array(["a"]), "is no NumPy file of numbers"),
        (np.zeros((2, 2, 2)), "is no NumPy file of numbers"),
        (np.arange(3.0), "holds float64 (3,)"),
        (np.full((3, 4), 2), "holds int64 (3, 4)"),
        (np.zeros((4, 3), dtype=bool), "has 4 entries for 3 queries"),
        (np.zeros((3, 5), dtype=bool), "has 5 entries for 4 places (20..23)"),
        (np.array([1, 2]), "has 2 entries for 3 queries"),
    ],
)
def test_arrays_that_are_no_ground_truth(tmp_path: Path, array: NDArray[np.generic], part: str) -> None:
    np.save(tmp_path / "t.npy", array, allow_pickle=True)
    refused(lambda: read_ground_truth(tmp_path / "t.npy", QUERIES, PLACES), "t.npy: ", part)


def test_queries_without_any_place_are_allowed(tmp_path: Path) -> None:
    path = written(tmp_path / "t.txt", b"10:\n11:\n")
    assert not read_ground_truth(path, QUERIES, PLACES).any()
    refused(lambda: read_ground_truth(tmp_path / "no.npy", QUERIES, PLACES), "no.npy: cannot be read (No such file")
    refused(lambda: read_ground_truth(tmp_path / "no.txt", QUERIES, PLACES), "no.txt: cannot be read (No such file")


# ---------------------------------------------------------------- real images


@pytest.mark.data
def test_real_traverse(data_root: Path) -> None:
    traverse = open_traverse(data_root / "data" / "nordland" / "summer", places=(100, 103))
    assert traverse.indices.tolist() == [100, 101, 102]
    for image, path in zip(traverse.images(), traverse.paths, strict=True):
        np.testing.assert_array_equal(image, cv2.imread(str(path), cv2.IMREAD_ANYCOLOR))
