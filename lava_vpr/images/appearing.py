"""Images that appear in a folder, each once it is whole."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.images.files import IMAGE_SUFFIXES, natural_key
from lava_vpr.images.imagefiles import read_image
from lava_vpr.storage.text import shown

PAUSE_S = 0.05
"""Seconds between two looks at the folder: a file whose size and time have not changed between them may be whole."""
PATIENCE_S = 5.0
"""Seconds after its last change until a file that cannot be read is given up."""
_TICK_NS = 2_000_000_000  # a folder that has not changed for so long lists what it listed


class Clock:
    """Time as the system has it."""

    def now(self) -> float:
        """Seconds, which never go back."""
        return time.monotonic()

    def pause(self) -> None:
        """Wait until it is time to look again."""
        time.sleep(PAUSE_S)


def appearing(
    folder: Path, *, existing: bool = True, clock: Clock | None = None
) -> Iterator[tuple[str, float, NDArray[np.uint8] | InputError]]:
    """The images in ``folder``, as they appear, each name once; those that appear together by natural sort.

    A file that is being written is waited for, and with it those behind it, so that the order is kept: until its size
    and time stay as they are from one look to the next and its picture can be decoded, at most `PATIENCE_S` after its
    last change. Hidden files, other types and folders are ignored.

    Args:
        folder: The folder.
        existing: Take what is there at the first look, too.
        clock: Another clock.
    Yields:
        Path, seconds since 1970 of the file's last change (NaN if it is gone), and the image or why it cannot be read.
    Raises:
        InputError: the folder cannot be read, or not any more.
    """
    clock = Clock() if clock is None else clock
    listing = _Listing(folder)
    taken = set() if existing else set(listing.names() or ())
    waiting: list[_File] = []
    while True:
        names = listing.names()
        if names is not None:
            taken &= names  # who goes away is forgotten
            new = sorted(names - taken, key=natural_key)
            taken |= names
            waiting += [_File(str(folder / name)) for name in new]
        for file in waiting:
            file.look(clock.now())
        while waiting:
            image = waiting[0].image(clock.now())
            if image is None:
                break
            file = waiting.pop(0)
            yield file.path, file.written, image
        clock.pause()


class _Listing:
    """The names of the images in a folder, listed anew where it may have changed."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._changed = folder, -1

    def names(self) -> set[str] | None:
        """The names; None: they are as they were."""
        try:
            changed = os.stat(self._folder).st_mtime_ns
            if changed == self._changed and time.time_ns() - changed > _TICK_NS:
                return None
            self._changed = changed
            with os.scandir(self._folder) as entries:
                return {entry.name for entry in entries if _is_image(entry)}
        except OSError as error:
            raise InputError(
                f"{shown(self._folder)}: cannot be watched ({error.strerror}); check it and its permissions"
            ) from None


def _is_image(entry: os.DirEntry[str]) -> bool:
    """Whether an entry of a folder is to be taken for an image."""
    return not entry.name.startswith(".") and Path(entry.name).suffix.lower() in IMAGE_SUFFIXES and not entry.is_dir()


class _File:
    """A file that is waited for."""

    def __init__(self, path: str) -> None:
        self.path, self.written = path, float("nan")
        self._status: tuple[int, int] | None = None
        self._since, self._settled = float("-inf"), False
        self._refused: InputError | None = None

    def look(self, now: float) -> None:
        """See whether it has changed."""
        try:
            found = os.stat(self.path)
            status, self.written = (found.st_size, found.st_mtime_ns), found.st_mtime
        except OSError:
            status, self.written = (-1, -1), float("nan")
        self._settled = status == self._status
        if not self._settled:
            self._status, self._since, self._refused = status, now, None

    def image(self, now: float) -> NDArray[np.uint8] | InputError | None:
        """The picture, or why there is none; None: that is not known yet."""
        if self._status == (-1, -1):
            return InputError(f"{shown(self.path)}: went away before it was read; leave files until they are answered")
        if not self._settled:
            return None
        if self._refused is None:
            try:
                return read_image(Path(self.path))
            except InputError as error:
                self._refused = error
        if now - self._since < PATIENCE_S:
            return None
        return InputError(f"{self._refused} (after {PATIENCE_S:g} s without a change)")
