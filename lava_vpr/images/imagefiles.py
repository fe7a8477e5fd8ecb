"""Image files as uint8 arrays, read from paths, or from a folder as they appear there; a damaged file is one clear
error.

OpenCV decodes, and `lava_vpr.images.heif` HEIC. Around them, this module walks over the file's structure, applies the
EXIF orientation, and catches what codecs print on standard error, so that the user sees only our line.

Formats: JPEG, PNG, BMP, TIFF, WebP, and HEIC where a package reads it, recognised by content and not by name; of
several pages or animation frames the first, of a HEIC file the main picture. Transparency is dropped: the colours below
it are used as they are stored, as OpenCV's own colour reading does.
16-bit samples become ``round(x / 257)``, which gives back exactly any image that was widened from 8 bits.
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
import re
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError, UnreadableError, shown
from lava_vpr.images.files import IMAGE_SUFFIXES, file_bytes, is_unread, natural_key, note_unread
from lava_vpr.images.formats import Header, orientation_of, walk
from lava_vpr.images.windows import DamagedError

_lock = threading.Lock()
# What libpng, libjpeg and ffmpeg print; anything else that was caught belongs to another thread and is passed on.
_CODEC_LINE = re.compile(
    rb"libpng |Corrupt JPEG|Premature end|Inconsistent progression|Invalid SOS|Unknown Adobe|Warning: unknown JFIF"
    rb"|Unsupported marker|TIFF|\[\w[^]]* @ 0x|OpenCV"
)


def _memory_file() -> io.FileIO | IO[bytes]:
    """An empty file without a name; in memory where the system can, since one is made for every image."""
    if hasattr(os, "memfd_create"):
        return io.FileIO(os.memfd_create("codec messages"), "r+")
    return tempfile.TemporaryFile(buffering=0)


@contextlib.contextmanager
def quiet() -> Iterator[list[bytes]]:
    """Catch what native code prints on standard error; at the end the list holds its codec messages."""
    messages: list[bytes] = []
    if _beside_others():
        yield messages
        return
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


SIDE_PIXELS, SIDE_BYTES = 1 << 24, 1 << 27
"""Largest image in pixels, and largest file in bytes, that is read while others are: each thread holds one."""
_thread = threading.local()


class AloneError(Exception):
    """Raised for an image that must be read alone, because it must be reported or is large."""


def _beside_others() -> bool:
    """Whether this thread reads an image while others do."""
    return getattr(_thread, "beside", False)


def _alone_if(needed: bool) -> None:
    """Raise `AloneError` if ``needed`` and other images are being read at the same time."""
    if needed and _beside_others():
        raise AloneError


def side_by_side(work: Callable[[int], object], numbers: Sequence[int], threads: int) -> bool:
    """Call ``work``, which reads an image, for all ``numbers`` on threads.

    Returns:
        Whether all work is done. If not, one of the images must be reported and none was: call ``work`` one by one, and
        the report comes in its order.
    """

    given_up = threading.Event()

    def share(k: int) -> None:
        _thread.beside = True
        image = None  # kept until the next is read: memory that is given back and taken again costs much
        for number in numbers[k::threads]:
            image = None if given_up.is_set() else work(number)
        del image

    try:
        with quiet() as messages, ThreadPoolExecutor(threads) as pool:
            try:
                list(pool.map(share, range(threads)))
            finally:
                given_up.set()
    except Exception:  # any error: it is raised again
        return False
    return not _damage_in(messages)


MIN_SIDE = 2  # an edge needs two pixels

# Whatever the colour and depth of the file, less transparency; turning is ours, so that it is the same for all formats.
_AS_STORED = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
_TOO_LARGE = re.compile("CV_IO_MAX_IMAGE_[A-Z]+")
_CODEC_DAMAGE = re.compile(rb"premature end|bad Huffman", re.IGNORECASE)


def _damage_in(messages: list[bytes]) -> bool:
    """Whether messages of codecs say that part of a picture is missing."""
    return any(_CODEC_DAMAGE.search(line) for line in messages)


def decode_image(data: bytes, where: str) -> NDArray[np.uint8]:
    """The bytes of an image file as uint8, (h, w, 3) BGR, or (h, w) for a grey file; see the module for the rules.

    Content that is ignored, or looks wrong, is logged.

    Args:
        data: The bytes.
        where: The beginning of messages.
    Raises:
        InputError: they are damaged or unsupported, or exceed a limit.
    """
    try:
        return _decoded_image(data, where)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _decoded_image(data: bytes, where: str) -> NDArray[np.uint8]:
    """As `decode_image`, but errors lack the beginning ``where``."""
    if not data:
        raise InputError("is empty (0 bytes); copy it again or remove it")
    try:
        header = walk(data)
        _alone_if(header.width * header.height > SIDE_PIXELS)
        image, messages = _decoded(header.data, header.picture)
        if image is None:
            raise DamagedError("its picture data cannot be decoded")
        if _damage_in(messages):
            raise DamagedError("part of its picture data is missing")
        if header.shortened and _decoded(header.shortened)[0] is not None:
            raise DamagedError("zeros stand where a picture was")
    except DamagedError as error:
        raise InputError(f"is damaged or cut short ({error}); copy it again or remove it") from None
    if min(image.shape[:2]) < MIN_SIDE:
        raise InputError(
            f"has {image.shape[1]} x {image.shape[0]} pixels, needs at least {MIN_SIDE} x {MIN_SIDE}; give a larger one"
        )
    _note(header, image, where)
    if image.dtype == np.uint16:
        image = _narrowed(image)
    if image.dtype != np.uint8 or not (image.ndim == 2 or image.shape[2] == 3):
        raise InputError(f"holds {image.dtype} samples, whose range is unknown; save it with 8 or 16 bits, unsigned")
    return _turned(image, 1 if header.picture else orientation_of(header.exif))


def read_image(path: Path) -> NDArray[np.uint8]:
    """The image in file ``path`` as uint8, (h, w, 3) BGR, or (h, w) for a grey file.

    Raises:
        UnreadableError: it cannot be read, is no image, is damaged, or holds samples of neither 8 nor 16 bits.
    """
    with contextlib.suppress(OSError):  # it is missed when it is read
        _alone_if(os.path.isfile(path) and os.path.getsize(path) > SIDE_BYTES)
    try:
        return decode_image(file_bytes(path), shown(path))
    except InputError as error:
        raise UnreadableError(str(error)) from None


_NOTES = logging.getLogger("lava_vpr")
_FEW_BITS = 12
"""Significant bits of 16-bit samples at or below which a picture comes out nearly black."""


def _note(header: Header, image: NDArray[Any], where: str) -> None:
    """Log that a picture is not read as its user may expect; commands show the first note of each kind."""
    bits = int(image.max()).bit_length() if image.dtype == np.uint16 else 0
    for sort, there, said in (
        ("pictures", header.pictures, "holds several pictures (pages or frames), of which the first is read"),
        (
            "bits",
            0 < bits <= _FEW_BITS,
            f"its values fill only {bits} of 16 bits and are read as nearly black; multiply all images by one number, "
            f"at most {1 << 16 - bits}",
        ),
        (
            "zeros",
            0 < header.zeros < image.shape[0],
            f"the last {header.zeros} rows of pixels in the file are 0; if they should not be, copy it again",
        ),
    ):
        if there:
            _alone_if(True)
            _NOTES.info(f"{where}: {said}", extra={"sort": sort})


def _decoded(data: bytes, picture: Callable[[], NDArray[Any]] | None = None) -> tuple[NDArray[Any] | None, list[bytes]]:
    """The picture in a file's bytes as OpenCV, or else ``picture``, has it, None if it has none, and what the codecs
    printed.

    Raises:
        DamagedError: as ``picture``.
        InputError: it is larger than OpenCV's own limits.
    """
    with quiet() as messages:
        try:
            image = picture() if picture else cv2.imdecode(np.frombuffer(data, dtype=np.uint8), _AS_STORED)
        except cv2.error as error:
            if beyond := _TOO_LARGE.search(str(error)):
                raise InputError(
                    f"is larger than OPEN{beyond[0]} lets OpenCV decode; raise or unset this variable"
                ) from None
            image = None
    return image, messages


def _narrowed(image: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """``round(x / 257)`` of 16-bit samples, row by row: all at once would need twice the picture's memory more."""
    narrow = np.empty(image.shape, np.uint8)
    for row, wide in zip(narrow, image, strict=True):
        row[...] = (wide.astype(np.uint32) + 128) // 257
    return narrow


def _turned(image: NDArray[np.uint8], orientation: int) -> NDArray[np.uint8]:
    """``image`` set upright. Source: EXIF 2.32, tag Orientation."""
    if orientation >= 5:
        image = image.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    return np.ascontiguousarray(image)


PAUSE_S = 0.05
"""Seconds between two checks of the folder: a file whose size and time are equal in both may be complete."""
PATIENCE_S, LONGEST_S = 5.0, 30.0
"""Seconds after which a file that cannot be read is reported: since its last change, and since it was first seen."""
_TICK_NS = 2_000_000_000  # seconds without a change after which a folder's list is taken to be current


def appearing(
    folder: Path,
    *,
    existing: bool = True,
    now: Callable[[], float] = time.monotonic,
    pause: Callable[[float], object] = time.sleep,
) -> Iterator[tuple[str, float, NDArray[np.uint8] | InputError]]:
    """The images in ``folder``, as they appear, each name once; those that appear together by natural sort.

    A file that is still being written, and with it those after it, waits until its size and time are equal in two
    checks and its picture can be decoded, at most `PATIENCE_S` after its last change and `LONGEST_S` in all. So the
    order is kept. Hidden files, other types and folders are ignored.

    Args:
        folder: The folder.
        existing: Also yield the images that are there at the first check.
        now: Another clock, in seconds, which never goes back.
        pause: Called to wait this many seconds until the next check.
    Yields:
        Path, seconds since 1970 of the file's last change (NaN if it is gone), and the image or why it cannot be read.
    Raises:
        InputError: the folder cannot be read, or not any more.
    """
    listing = _Listing(folder)
    taken = set() if existing else set(listing.names() or ())
    waiting: list[_File] = []
    while True:
        names = listing.names()
        if names is not None:
            taken &= names  # forget files that are gone
            new = sorted(names - taken, key=natural_key)
            taken |= names
            waiting += [_File(str(folder / name), now()) for name in new]
        for file in waiting:
            file.look(now())
        while waiting:
            image = waiting[0].image(now())
            if image is None:
                break
            file = waiting.pop(0)
            yield file.path, file.written, image
        pause(PAUSE_S)


class _Listing:
    """The names of the images in a folder, listed again when it may have changed."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._changed, self._noted = folder, -1, False

    def names(self) -> set[str] | None:
        """The names; None: unchanged."""
        try:
            changed = os.stat(self._folder).st_mtime_ns
            if changed == self._changed and time.time_ns() - changed > _TICK_NS:
                return None
            self._changed = changed
            with os.scandir(self._folder) as found:
                entries = list(found)
        except OSError as error:
            raise InputError(
                f"{shown(self._folder)}: cannot be watched ({error.strerror}); check it and its permissions"
            ) from None
        if not self._noted:
            self._noted = note_unread(self._folder, (entry.name for entry in entries if is_unread(entry.name)))
        return {entry.name for entry in entries if _is_image(entry)}


def _is_image(entry: os.DirEntry[str]) -> bool:
    """Whether an entry of a folder counts as an image; a broken link does."""
    if entry.name.startswith(".") or Path(entry.name).suffix.lower() not in IMAGE_SUFFIXES or is_unread(entry.name):
        return False
    try:
        return not entry.is_dir()
    except OSError:  # links in a circle, or into a folder that is closed to us
        return True


class _File:
    """A file that may not be complete yet.

    Args:
        path: The file.
        now: When it was seen first.
    """

    def __init__(self, path: str, now: float) -> None:
        self.path, self.written, self._first = path, float("nan"), now
        self._status: tuple[int, int] | None = None
        self._since, self._settled = float("-inf"), False
        self._refused: InputError | None = None

    def look(self, now: float) -> None:
        """Check whether it has changed."""
        try:
            found = os.stat(self.path)
            status, self.written = (found.st_size, found.st_mtime_ns), found.st_mtime
        except OSError:
            status, self.written = (-1, -1), float("nan")
        self._settled = status == self._status
        if not self._settled:
            self._status, self._since, self._refused = status, now, None

    def image(self, now: float) -> NDArray[np.uint8] | InputError | None:
        """The picture, or why there is none; None: not known yet."""
        if self._status == (-1, -1):
            if os.path.islink(self.path):
                return InputError(f"{shown(self.path)}: is a link that leads to no file; correct or remove it")
            return InputError(f"{shown(self.path)}: went away before it was read; leave files until they are answered")
        if not self._settled:
            if now - self._first < LONGEST_S:
                return None
            return InputError(
                f"{shown(self.path)}: is still being written after {LONGEST_S:g} s; write each image to its own file"
            )
        if self._refused is None:
            try:
                return read_image(Path(self.path))
            except InputError as error:
                self._refused = error
        if now - self._since < PATIENCE_S:
            return None
        return InputError(f"{self._refused} (after {PATIENCE_S:g} s without a change)")
