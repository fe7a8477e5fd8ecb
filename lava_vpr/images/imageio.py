"""Files on disk: image folders in natural order, images and videos as uint8 arrays, text; damage is one clear error.

OpenCV decodes. Around it: a walk over the file's own structure (some OpenCV versions return half a picture for a file
that was cut short), the EXIF orientation (OpenCV ignores that of WebP), and silence: the codecs' own messages on
standard error are caught, so that the user sees our line and no other.

Formats: JPEG, PNG, BMP, TIFF, WebP, recognised by content and not by name; of several pages or animation frames the
first. Transparency is dropped: the colours below it are used as they are stored, as OpenCV's own colour reading does.
16-bit samples become ``round(x / 257)``, which gives back exactly any image that was widened from 8 bits.
"""

from __future__ import annotations

import contextlib
import csv
import io
import os
import re
import struct
import tempfile
import threading
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, NoReturn

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
VIDEO_SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg")
MIN_SIDE = 2  # an edge needs two pixels

# Whatever the colour and depth of the file, less transparency; turning is ours, so that it is the same for all formats.
_AS_STORED = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
_TIMESTAMP_SLACK_S = 1e-3  # containers round times to milliseconds

_lock = threading.Lock()
# What libpng, libjpeg and ffmpeg print; anything else that was caught belongs to another thread and is passed on.
_CODEC_LINE = re.compile(
    rb"libpng |Corrupt JPEG|Premature end|Inconsistent progression|Invalid SOS|Unknown Adobe|Warning: unknown JFIF"
    rb"|Unsupported marker|TIFF|\[\w[^]]* @ 0x|OpenCV"
)
_CODEC_DAMAGE = re.compile(rb"premature end|bad Huffman", re.IGNORECASE)


class _DamagedError(Exception):
    """The file's structure is incomplete; the text says how."""


def shown(path: str | Path) -> str:
    """``path`` for a one-line message: characters that would break the line or the terminal are escaped."""
    text = str(path)
    return text if text.isprintable() else repr(text)


def natural_key(name: str) -> tuple[list[str | int], str]:
    """Sort key that reads digits as numbers and ignores case: img2 before img10. Equal ones: by plain text."""
    parts = re.split("([0-9]+)", name.casefold())  # text and numbers take turns, beginning with text
    return [int(part) if k % 2 else part for k, part in enumerate(parts)], name


def refuse_file(path: Path, where: str = "") -> NoReturn:
    """Say why ``path`` is no regular file."""
    try:
        path.stat()
        cause = "is a folder, not an image" if path.is_dir() else "is not a regular file"
    except OSError as error:
        cause = f"cannot be opened ({error.strerror})"
    raise InputError(f"{where}{shown(path)}: {cause}; correct or remove it")


def folder_images(folder: Path) -> list[Path]:
    """The image files directly in ``folder``, naturally sorted."""
    names, subfolders = [], []
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.name.startswith("."):
                    continue
                if entry.is_dir():
                    subfolders.append(entry.name)
                elif Path(entry.name).suffix.lower() in IMAGE_SUFFIXES:
                    # Leaving one out would silently shift the index of all that follow.
                    if not entry.is_file():
                        refuse_file(folder / entry.name)
                    names.append(entry.name)
    except OSError as error:
        where = folder if error.filename is None else error.filename
        raise InputError(f"{shown(where)}: cannot be read ({error.strerror}); check it and its permissions") from None
    if not names:
        hint = "give a folder that holds images directly"
        if subfolders:
            hint = "give one of its subfolders, such as " + shown(min(subfolders, key=natural_key))
        raise InputError(f"{shown(folder)}: holds no images ({' '.join(s[1:] for s in IMAGE_SUFFIXES)}); {hint}")
    return [folder / name for name in sorted(names, key=natural_key)]


def file_text(path: Path) -> str:
    """The text of a list or table."""
    try:
        return path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{shown(path)}: cannot be read ({error.strerror}); check path and permissions") from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(f"{shown(path)} line {line}: is not UTF-8 text; save the file as UTF-8") from None


def csv_rows(path: Path) -> list[tuple[int, list[str]]]:
    """Line number and stripped cells of a CSV file's rows, without empty and # lines. Separator: , or ; or tab."""
    text = file_text(path)
    first = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=next((d for d in ";\t" if d in first), ","))
    rows = []
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if any(cells) and not cells[0].startswith("#"):
                rows.append((reader.line_num, cells))
    except csv.Error as error:
        raise InputError(f"{shown(path)} line {reader.line_num}: is not CSV ({error}); correct the line") from None
    return rows


def _memory_file() -> io.FileIO | IO[bytes]:
    """An empty file without a name; in memory where the system can, since one is made for every image."""
    if hasattr(os, "memfd_create"):
        return io.FileIO(os.memfd_create("codec messages"), "r+")
    return tempfile.TemporaryFile(buffering=0)


@contextlib.contextmanager
def _quiet() -> Iterator[list[bytes]]:
    """Catch what native code prints on standard error; the list is filled with its codec messages at the end."""
    messages: list[bytes] = []
    with _lock, _memory_file() as caught:
        level = cv2.getLogLevel()
        try:
            saved = os.dup(2)
        except OSError:  # standard error is closed: nothing to keep quiet
            yield messages
            return
        cv2.setLogLevel(0)
        os.dup2(caught.fileno(), 2)
        try:
            yield messages
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            cv2.setLogLevel(level)
            caught.seek(0)
            lines = (caught.read() or b"").splitlines(keepends=True)
            messages.extend(line for line in lines if _CODEC_LINE.match(line))
            for line in lines:
                if not _CODEC_LINE.match(line):
                    os.write(2, line)


def _walk_jpeg(data: bytes) -> bytes:
    """The EXIF block (TIFF structure, or empty); the walk must meet a scan and the end-of-image marker."""
    exif, position, scans = b"", 2, 0
    marker = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
    while True:
        found = marker.search(data, position)
        if found is None:
            raise _DamagedError("it ends before its end-of-image marker")
        code, position = data[found.start() + 1], found.end()
        if code == 0xD9:
            if not scans:
                raise _DamagedError("it holds no picture data")
            return exif
        if code == 0x01:
            continue
        if position + 2 > len(data):
            raise _DamagedError("it ends within a header")
        length = struct.unpack_from(">H", data, position)[0]
        if code == 0xE1 and not exif and data[position + 2 : position + 8] == b"Exif\0\0":
            exif = data[position + 8 : position + length]
        scans += code == 0xDA
        position += length


def _walk_png(data: bytes) -> bytes:
    """The eXIf chunk (or empty); all chunks up to IEND must be there, and the critical ones intact."""
    exif, position = b"", 8
    while True:
        if position + 12 > len(data):
            raise _DamagedError("it ends before its IEND chunk")
        length, kind = struct.unpack_from(">I4s", data, position)
        end = position + 12 + length
        if end > len(data):
            raise _DamagedError("it ends within a chunk")
        critical = not kind[0] & 0x20
        if critical and zlib.crc32(data[position + 4 : end - 4]) != struct.unpack_from(">I", data, end - 4)[0]:
            raise _DamagedError(f"the checksum of its {kind.decode('latin-1')!r} chunk is wrong")
        if kind == b"eXIf":
            exif = data[position + 8 : end - 4]
        if kind == b"IEND":
            return exif
        position = end


def _walk_webp(data: bytes) -> bytes:
    """The EXIF chunk (or empty); the file must be as long as its RIFF header says."""
    end = 8 + struct.unpack_from("<I", data, 4)[0]
    if end > len(data):
        raise _DamagedError(f"it has {len(data)} of {end} bytes")
    exif, position = b"", 12
    while position + 8 <= end:
        kind, length = struct.unpack_from("<4sI", data, position)
        if kind == b"EXIF":
            exif = data[position + 8 : position + 8 + length].removeprefix(b"Exif\0\0")
        position += 8 + length + length % 2
    return exif


def _walk_bmp(data: bytes) -> bytes:
    """No EXIF in BMP; an uncompressed one must have all its rows."""
    if len(data) < 34:
        raise _DamagedError("it ends within its header")
    offset, header = struct.unpack_from("<II", data, 10)
    if header >= 40:
        width, height, _, depth, compression = struct.unpack_from("<iiHHI", data, 18)
        needed = offset + (abs(width) * depth + 31) // 32 * 4 * abs(height)
        if compression in (0, 3) and needed > len(data):
            raise _DamagedError(f"it has {len(data)} of {needed} bytes")
    return b""


def _walk(data: bytes) -> bytes:
    """Check that a whole image is there, by its format's own structure; returns its EXIF block, if any."""
    if data[:3] == b"\xff\xd8\xff":
        return _walk_jpeg(data)
    if data[:8] == b"\x89PNG\r\n\x1a\n":
        return _walk_png(data)
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return _walk_webp(data)
    if data[:2] == b"BM":
        return _walk_bmp(data)
    if data[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return b""  # its decoder turns the picture itself and misses no strip
    raise InputError("is not a JPEG, PNG, BMP, TIFF or WebP image, whatever its name says; replace or remove it")


def _orientation(exif: bytes) -> int:
    """The EXIF orientation 1..8; 1 (upright) where there is none or it makes no sense."""
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(exif[:4])
    if order is None or len(exif) < 8:
        return 1
    start = struct.unpack_from(order + "I", exif, 4)[0]
    if start + 2 > len(exif):
        return 1
    for k in range(struct.unpack_from(order + "H", exif, start)[0]):
        entry = start + 2 + 12 * k
        if entry + 12 > len(exif):
            return 1
        tag, kind, count, value = struct.unpack_from(order + "HHIH", exif, entry)
        if tag == 0x0112:
            return int(value) if kind == 3 and count == 1 and 1 <= value <= 8 else 1
    return 1


def _turned(image: NDArray[np.uint8], orientation: int) -> NDArray[np.uint8]:
    """``image`` set upright. Source: EXIF 2.32, tag Orientation."""
    if orientation >= 5:
        image = image.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    return np.ascontiguousarray(image)


def decode_image(data: bytes) -> NDArray[np.uint8]:
    """The bytes of an image file as uint8, (h, w, 3) BGR, or (h, w) for a grey file; see the module for the rules.

    Raises:
        InputError: what is wrong with them, without the file's name (`read_image` puts that in front).
    """
    if not data:
        raise InputError("is empty (0 bytes); copy it again or remove it")
    try:
        exif = _walk(data)
        with _quiet() as messages:
            try:
                image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), _AS_STORED)
            except cv2.error:
                image = None
        if image is None:
            raise _DamagedError("its picture data cannot be decoded")
        if any(_CODEC_DAMAGE.search(line) for line in messages):
            raise _DamagedError("part of its picture data is missing")
    except (_DamagedError, struct.error) as error:
        why = str(error) if isinstance(error, _DamagedError) else "it ends within its header"
        raise InputError(f"is damaged or cut short ({why}); copy it again or remove it") from None
    if min(image.shape[:2]) < MIN_SIDE:
        raise InputError(f"has {image.shape[1]} x {image.shape[0]} pixels, needs at least {MIN_SIDE} x {MIN_SIDE}")
    if image.dtype == np.uint16:
        image = ((image.astype(np.uint32) + 128) // 257).astype(np.uint8)
    if image.dtype != np.uint8 or not (image.ndim == 2 or image.shape[2] == 3):
        raise InputError(f"holds {image.dtype} samples, whose range is unknown; save it with 8 or 16 bits, unsigned")
    return _turned(image, _orientation(exif))


def read_image(path: Path) -> NDArray[np.uint8]:
    """The image in file ``path`` as uint8, (h, w, 3) BGR, or (h, w) for a grey file.

    Raises:
        InputError: the file cannot be read, is no image, is damaged, or holds samples that are neither 8 nor 16 bits.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{shown(path)}: cannot be read ({error.strerror}); check path and permissions") from None
    try:
        return decode_image(data)
    except InputError as error:
        raise InputError(f"{shown(path)}: {error}") from None


@contextlib.contextmanager
def _capture(path: Path) -> Iterator[cv2.VideoCapture]:
    """The opened video, released at the end."""
    # ffmpeg reads this once, at the first video; it prints damage on standard error otherwise.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    with _quiet():
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        if not capture.isOpened():
            raise InputError(f"{shown(path)}: cannot be decoded as a video; convert it to MP4 (H.264) or to images")
        yield capture
    finally:
        capture.release()


def sample_video(path: Path, every: float, stop: int | None = None) -> NDArray[np.int64]:
    """Which frames of a video to use: the first one at or after each multiple of ``every`` seconds, each once.

    All frames are decoded to find out, since headers are often wrong about their number and times; ``stop`` ends the
    search after that many samples.

    Returns:
        Frame numbers, int64 (n,), increasing from 0.
    """
    frames: list[int] = []
    due, number, time, first = 0, 0, 0.0, 0.0
    with _capture(path) as capture:
        rate = capture.get(cv2.CAP_PROP_FPS)
        period = 1 / rate if rate > 0 else 0.04
        while capture.grab():
            stamp = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
            first = stamp if number == 0 else first
            # A frame without a time of its own (some containers give 0 for the last) follows after one period.
            time = stamp - first if number == 0 or stamp - first > time else time + period
            if time >= due * every - _TIMESTAMP_SLACK_S:
                frames.append(number)
                if len(frames) == stop:
                    break
                due = int((time + _TIMESTAMP_SLACK_S) // every) + 1
            number += 1
    if not frames:
        raise InputError(f"{shown(path)}: holds no video frame that can be decoded; convert it to MP4 (H.264)")
    return np.array(frames, dtype=np.int64)


def video_frames(path: Path, numbers: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
    """The frames of these numbers, uint8 (h, w, 3) BGR: one pass if they increase, a new pass at each step back."""
    k = 0
    while k < len(numbers):
        at = -1
        with _capture(path) as capture:
            while k < len(numbers) and numbers[k] > at:
                while at < numbers[k] and capture.grab():
                    at += 1
                good, image = capture.retrieve() if at == numbers[k] else (False, None)
                if not good or image is None:
                    raise InputError(f"{shown(path)}: frame {numbers[k]} cannot be decoded; was the file changed?")
                k += 1
                yield image
