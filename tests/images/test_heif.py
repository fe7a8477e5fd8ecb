"""HEIC photos, drawn by pillow-heif 1.8: without pi-heif, with a stand-in for it, and with it where it is installed.

The files in tests/images/heic are `DRAWN` in colour (to be turned, with position and time), in grey, and with alpha.
"""

from __future__ import annotations

import logging
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.imagefiles import (
    image_bytes,
    refused,
    smooth_picture,
    stand_in_heif,
    upright,
    watched,
    without_heif,
    written,
)

from lava_vpr.images.exif import Taken, taken
from lava_vpr.images.files import folder_images
from lava_vpr.images.formats import walk
from lava_vpr.images.heif import decoder
from lava_vpr.images.imagefiles import decode_image, read_image
from lava_vpr.traverse import open_traverse

FILES = Path(__file__).parent / "heic"
TURNED = (FILES / "turned.heic").read_bytes()
_Y, _X = np.mgrid[:48, :64]
DRAWN = np.stack([255 - 2 * (_X + _Y), 5 * _Y, 4 * _X], -1).clip(0, 255).astype(np.uint8)
"""Blue, green and red before the picture is turned by 90 degrees, as its EXIF orientation, 6, and the file say."""
UPRIGHT = upright(DRAWN, 6)
HERE = Taken((63.4, 10.4), 1714557610.5, True)


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> None:
    """An environment that cannot decode HEIC."""
    without_heif(monkeypatch)


@pytest.fixture(params=["stand-in", "pi-heif"])
def package(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """pi-heif, or a stand-in that has the picture of turned.heic in every file."""
    if request.param == "stand-in":
        stand_in_heif(monkeypatch, lambda data: UPRIGHT)
    else:
        real()
    return str(request.param)


def real() -> None:
    """Skip a test where no package decodes HEIC."""
    if decoder() is None:
        pytest.skip("needs pi-heif: pip install 'lava-vpr[heic]'")


def near(image: NDArray[np.uint8], wanted: NDArray[np.uint8]) -> None:
    """Check that a decoded picture is a drawn one, as far as HEVC keeps it."""
    assert (image.shape, image.dtype) == (wanted.shape, np.uint8)
    assert np.abs(image.astype(int) - wanted).mean() < 3


# ---------------------------------------------------------------- without the package


@pytest.mark.usefixtures("without")
def test_without_the_package_one_line_says_what_to_install(tmp_path: Path) -> None:
    path = written(tmp_path / "a.jpg", TURNED)
    for call in (lambda: read_image(path), lambda: taken(path)):
        text = refused(call, "a.jpg: is a HEIC, HEIF or AVIF image, which cannot be read")
        assert "; install what reads HEIC and HEIF (pip install 'lava-vpr[heic]'), or convert such images to" in text
    path = written(tmp_path / "a.HEIC", TURNED)
    refused(lambda: open_traverse(path), "a.HEIC: is in a format that cannot be read; install what reads HEIC")
    alone = written(tmp_path / "alone" / "a.heif", TURNED).parent
    refused(
        lambda: folder_images(alone), "holds only 1 image in a format that cannot be read", "install what reads HEIC"
    )
    written(alone / "b.png", image_bytes(".png", smooth_picture()))
    assert Path(str(next(watched(alone)).name)).name == "b.png"


def test_a_package_that_cannot_be_loaded_counts_as_none(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in_heif(monkeypatch, lambda data: UPRIGHT)

    def broken() -> None:
        raise ImportError("libheif.so: cannot open shared object file")

    monkeypatch.setattr(sys.modules["pi_heif"], "libheif_version", broken)
    refused(lambda: decode_image(TURNED, "a"), "which cannot be read", "pip install 'lava-vpr[heic]'")


def test_the_package_that_is_maintained_decodes_before_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in_heif(monkeypatch, lambda data: UPRIGHT, "pillow_heif")
    maintained = sys.modules["pillow_heif"]
    assert decoder() is maintained
    stand_in_heif(monkeypatch, lambda data: pytest.fail("the other decodes"))
    assert decoder() is sys.modules["pi_heif"]
    monkeypatch.setitem(sys.modules, "pillow_heif", maintained)
    assert np.array_equal(decode_image(TURNED, "a"), UPRIGHT)


def test_avif_is_to_be_converted_with_the_package_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in_heif(monkeypatch, lambda data: pytest.fail("AVIF is handed on"))
    data = TURNED.replace(b"ftypheic", b"ftypavif")
    text = refused(lambda: decode_image(data, "a"), "is a HEIC, HEIF or AVIF image, which cannot be read")
    assert "; convert such images to JPEG" in text
    text = refused(lambda: folder_images(written(tmp_path / "f" / "a.avif", data).parent), "holds only 1 image")
    assert "; convert such images to JPEG" in text


# ---------------------------------------------------------------- with it, or a stand-in


def test_a_photo_is_read_upright_and_turned_once(package: str, tmp_path: Path) -> None:
    for name in ("a.heic", "a.HEIF", "a.hif", "a.jpg"):
        path = written(tmp_path / name, TURNED)
        image = read_image(path)
        near(image, UPRIGHT)
        assert image.flags.writeable
        assert image.flags.c_contiguous
        assert taken(path) == HERE


@pytest.mark.usefixtures("package")
def test_folders_have_heic_among_their_images(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for name in ("img10.heic", "img9.HEIC", "img8.heif", "img1.hif"):
        written(tmp_path / name, TURNED)
    written(tmp_path / "img2.png", image_bytes(".png", smooth_picture()))
    with caplog.at_level(logging.INFO, "lava_vpr"):
        names = ["img1.hif", "img2.png", "img8.heif", "img9.HEIC", "img10.heic"]
        assert [Path(path).name for path in folder_images(tmp_path)] == names
        frames = watched(tmp_path)
        assert [Path(str(next(frames).name)).name for _ in names] == names
    assert not caplog.messages
    near(open_traverse(tmp_path / "img9.HEIC").load(0), UPRIGHT)


@pytest.mark.usefixtures("package")
def test_a_picture_beyond_the_limit_is_not_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoder(), "open_heif", None)
    monkeypatch.setenv("LAVA_VPR_MAX_IMAGE_PIXELS", str(64 * 64 - 1))  # HEVC codes 64 rows, of which 48 are shown
    refused(lambda: decode_image(TURNED, "a"), "a: has 64 x 64 = 4,096 pixels, more than the 4,095 allowed")
    monkeypatch.setenv("LAVA_VPR_MAX_IMAGE_PIXELS", str(64 * 64))
    monkeypatch.setenv("LAVA_VPR_MAX_IMAGE_PARTS", "5")
    refused(lambda: decode_image(TURNED, "a"), "a: has 6 parts, more than the 5 allowed")


@pytest.mark.usefixtures("package")
def test_every_cut_and_every_tail_of_zeros_is_refused_before_it_is_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoder(), "open_heif", None)
    for length in range(12, len(TURNED)):
        refused(lambda length=length: decode_image(TURNED[:length], "a"), "a: is damaged or cut short (")
    picture = TURNED.index(b"mdat") + 4
    for length in range(picture, len(TURNED) - 300, 7):
        data = TURNED[:length].ljust(len(TURNED), b"\0")
        refused(
            lambda data=data: decode_image(data, "a"), "a: is damaged or cut short (zeros stand where a picture was)"
        )


@pytest.mark.usefixtures("package")
@pytest.mark.parametrize("kind", [b"unci", b"av01", b"mski"])
def test_pictures_in_other_formats_are_not_handed_on(kind: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoder(), "open_heif", None)
    data = TURNED.replace(b"hvc1", kind)
    refused(lambda: decode_image(data, "a"), f"a: holds a picture of kind '{kind.decode()}', but only HEVC is read")
    data = TURNED.replace(b"ispe", b"free")
    refused(lambda: decode_image(data, "a"), "a: is damaged or cut short (it holds no picture); copy it again")


# ---------------------------------------------------------------- a stand-in alone


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ValueError("Invalid input:\n no 'meta' \x1b[2J box\n"), r"Invalid input: no 'meta' \x1b[2J box"),
        (MemoryError(), "MemoryError"),
        (IndexError("list index out of range"), "list index out of range"),
    ],
)
def test_what_a_decoder_raises_is_one_line(
    error: Exception, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def picture(data: bytes) -> None:
        raise error

    stand_in_heif(monkeypatch, picture)
    path = written(tmp_path / "a.heic", TURNED)
    end = f"a.heic: is damaged or cut short (its picture data cannot be decoded: {said}); copy it again or remove it"
    assert refused(lambda: read_image(path)).endswith(end)


def test_alpha_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    alpha = np.full((64, 48, 1), 9, np.uint8)
    for picture, wanted in (
        (np.dstack([UPRIGHT, alpha]), UPRIGHT),
        (UPRIGHT[..., 0], UPRIGHT[..., 0]),
        (np.dstack([UPRIGHT[..., :1], alpha]), UPRIGHT[..., 0]),
    ):
        stand_in_heif(monkeypatch, lambda data, picture=picture: picture)
        np.testing.assert_array_equal(decode_image(TURNED, "a"), wanted)


def box(kind: bytes, content: bytes) -> bytes:
    """A box of a HEIC file."""
    return struct.pack(">I4s", 8 + len(content), kind) + content


@pytest.mark.parametrize("head", [b"\0\0\0\0Exif\0\0", b"\0\0\0\6Exif\0\0", b"\0\0\0\3abc", b"\0\0\0\0"])
def test_items_may_be_placed_by_wide_numbers(head: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    """Boxes of the newest versions, with numbers of 4 bytes; a grid's item, whose content is elsewhere; EXIF blocks."""
    stand_in_heif(monkeypatch, lambda data: UPRIGHT)
    exif = head + TURNED[TURNED.index(b"MM\0*") :]

    def file(base: int, many: int = 1) -> bytes:
        grid = struct.pack(">IHHQHII", 9, 1, 0, 1 << 60, 1, 0, 8)
        place = struct.pack(">IHHQH", 70000, 0, 0, base, many) + struct.pack(">II", 4, len(exif)) * many
        inside = box(b"iloc", b"\2\0\0\0" + struct.pack(">HI", 0x4480, 2) + grid + place)
        entry = box(b"infe", b"\3\0\0\0" + struct.pack(">IH4s", 70000, 0, b"Exif") + b"\0")
        inside += box(b"iinf", b"\1\0\0\0\0\0\0\1" + entry)
        inside += box(b"iprp", box(b"ipco", box(b"ispe", struct.pack(">III", 0, 48, 64))))
        return TURNED[:28] + box(b"meta", b"\0\0\0\0" + inside) + box(b"mdat", b"\0\0\0\0" + exif)

    start = len(file(0)) - len(exif) - 4
    assert walk(file(start)).exif == TURNED[TURNED.index(b"MM\0*") :]
    np.testing.assert_array_equal(decode_image(file(start), "a"), UPRIGHT)
    long = f"it has {len(file(0)):,} of {len(file(0)) + 1:,} bytes"
    refused(lambda: decode_image(file(start + 1), "a"), f"a: is damaged or cut short ({long}); copy it again")
    monkeypatch.setenv("LAVA_VPR_MAX_IMAGE_PARTS", "20")
    refused(lambda: decode_image(file(0, 30), "a"), "a: has 21 parts, more than the 20 allowed")


# ---------------------------------------------------------------- the package alone


def test_grey_alpha_and_colour_are_decoded() -> None:
    real()
    near(read_image(FILES / "grey.heic"), DRAWN[..., 1])
    near(read_image(FILES / "alpha.heic"), DRAWN)
    near(read_image(FILES / "turned.heic"), UPRIGHT)


def test_a_size_that_is_not_that_of_the_picture_is_refused() -> None:
    real()
    size = TURNED.index(b"ispe") + 8
    for width, height in ((8, 8), (64, 47), (9000, 9000)):
        data = TURNED[:size] + struct.pack(">II", width, height) + TURNED[size + 8 :]
        refused(lambda data=data: decode_image(data, "a"), "a: is damaged or cut short (its picture data cannot be")
