"""Pictures, and image and video files made by hand.

Used by bench, cli, core, events, images, positions, support, training, vectors and watch.
"""

from __future__ import annotations

import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import settings
from numpy.typing import NDArray
from PIL import Image

from lava_vpr.errors import InputError
from lava_vpr.images.heif import PACKAGES
from lava_vpr.readers import Frame, open_source

QUICK = settings(deadline=None, derandomize=True, max_examples=25)


def smooth_picture(seed: int = 0, shape: tuple[int, ...] = (24, 36, 3)) -> NDArray[np.uint8]:
    """A smooth random picture with all pixels different enough to see any turn of it."""
    noise = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 2)


def blocky_picture(seed: int, shape: tuple[int, int] = (24, 48)) -> NDArray[np.uint8]:
    """A colour picture of 6 x 9 blocks."""
    small = np.random.default_rng(seed).integers(0, 256, (6, 9, 3)).astype(np.uint8)
    return np.asarray(cv2.resize(small, shape[::-1], interpolation=cv2.INTER_NEAREST))


def write_images(folder: Path, n: int = 6, seed: int = 0, shape: tuple[int, int] = (24, 48)) -> Path:
    """Writes ``n`` blocky colour images, img0.png on."""
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(n):
        cv2.imwrite(str(folder / f"img{i}.png"), blocky_picture(1000 * seed + i, shape))
    return folder


def image_bytes(suffix: str, image: NDArray[np.generic], *options: int) -> bytes:
    """The file that OpenCV writes of ``image``, by the suffix of its name."""
    good, data = cv2.imencode(suffix, image, options)
    assert good
    return bytes(data)


def written(path: Path, data: bytes) -> Path:
    """Writes a file and the folders that it stands in."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


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


def without_heif(monkeypatch: pytest.MonkeyPatch) -> None:
    """An environment that cannot decode HEIC."""
    for name in PACKAGES:
        monkeypatch.setitem(sys.modules, name, None)


def stand_in_heif(monkeypatch: pytest.MonkeyPatch, picture: Callable[[bytes], Any], name: str = "pi_heif") -> None:
    """Puts ``picture``, a function of a HEIC file's bytes, in the place of the only decoder, the module ``name``."""
    without_heif(monkeypatch)
    module: Any = ModuleType(name)
    module.libheif_version = lambda: "1.23.4"
    module.open_heif = lambda data, bgr_mode: picture(data) if bgr_mode else None
    monkeypatch.setitem(sys.modules, name, module)


def png_chunk(kind: bytes, data: bytes) -> bytes:
    """A chunk of a PNG file with its length and checksum."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width: int, height: int, depth: int, colour: int, rows: bytes, *chunks: bytes) -> bytes:
    """A PNG file of unfiltered ``rows``, with ``chunks`` between its header and its pixels."""
    header = png_chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0))
    body = header + b"".join(chunks) + png_chunk(b"IDAT", zlib.compress(rows)) + png_chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def video(
    path: Path,
    frames: int,
    fps: float = 10.0,
    size: tuple[int, int] = (64, 48),
    codec: str = "MJPG",
    *,
    marked: bool = False,
) -> Path:
    """A video, MJPG unless told otherwise, whose frame k is grey of level 3 k, ``marked`` with a disk of its own."""
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), fps, size)
    assert writer.isOpened()
    for k in range(frames):
        picture = np.full((size[1], size[0], 3), 3 * k % 256, dtype=np.uint8)
        if marked:
            cv2.circle(picture, (7 * k % size[0], 11 * k % size[1]), 8, (255, 255, 255), -1)
        writer.write(picture)
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


def watched(source: str | Path, **options: Any) -> Iterator[Frame]:
    """The images of a source as they come, as `lava-vpr watch` takes them."""
    return open_source(str(source), live=True, **options).frames()


def exif(orientation: int, order: str = ">") -> bytes:
    """An EXIF block that holds nothing but an orientation."""
    magic = {">": b"MM\0*", "<": b"II*\0"}[order]
    return magic + struct.pack(order + "IHHHIHHI", 8, 1, 0x0112, 3, 1, orientation, 0, 0)


def tiff(strip: bytes, shape: tuple[int, ...], tags: dict[int, int]) -> bytes:
    """A grey TIFF of one strip, which stands at its end, unless the ``tags`` say otherwise."""
    h, w = shape[:2]
    whole = {256: w, 257: h, 258: 8, 259: 1, 262: 1, 273: 0, 277: 1, 278: h, 279: len(strip)} | tags
    whole[273] = 14 + 12 * len(whole)
    rows = (struct.pack("<HHII", tag, 4 if tag in (273, 279) else 3, 1, whole[tag]) for tag in sorted(whole))
    return b"II*\0" + struct.pack("<IH", 8, len(whole)) + b"".join(rows) + b"\0\0\0\0" + strip


def webp_with_exif(image: NDArray[np.uint8], block: bytes) -> bytes:
    """A lossless WebP file with an EXIF block."""
    size = struct.pack("<I", image.shape[1] - 1)[:3] + struct.pack("<I", image.shape[0] - 1)[:3]
    extended = b"VP8X" + struct.pack("<I", 10) + bytes([8, 0, 0, 0]) + size
    body = b"WEBP" + extended + image_bytes(".webp", image, cv2.IMWRITE_WEBP_QUALITY, 101)[12:]
    body += b"EXIF" + struct.pack("<I", len(block)) + block + b"\0" * (len(block) % 2)
    return b"RIFF" + struct.pack("<I", len(body)) + body


def photo(
    path: Path,
    image: NDArray[np.uint8],
    receiver: dict[int, Any],
    camera: dict[int, Any] | None = None,
    orientation: int = 1,
) -> Path:
    """A photo written by Pillow, with the tags of its receiver of satellites and of its camera, by their numbers."""
    block = Image.Exif()
    block[0x0112] = orientation
    block.get_ifd(0x8825).update(receiver)
    block.get_ifd(0x8769).update(camera or {})
    Image.fromarray(np.ascontiguousarray(image[:, :, ::-1])).save(path, exif=block)
    return path
