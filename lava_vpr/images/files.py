"""Files that users name: their types, folders of images in natural order, and lists of images, as text or CSV.

Each refusal is one clear line.
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn

from lava_vpr.errors import InputError, UnreadableError, brief, shown
from lava_vpr.images.heif import HEIF_SUFFIXES, INSTALL, decoder
from lava_vpr.storage.reading import read_bytes
from lava_vpr.storage.tables import csv_rows, text_lines

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", *HEIF_SUFFIXES)
_CONVERT = (
    "convert such images to JPEG (magick mogrify -format jpg *.heic, or heif-convert), or let the phone take JPEG "
    "(iPhone: Camera, Formats, Most Compatible)"
)
VIDEO_SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg")


_NOTES = logging.getLogger("lava_vpr")


def natural_key(name: str) -> tuple[list[str | tuple[int, str]], str]:
    """Sort key that reads digits as numbers and ignores case: img2 before img10. Equal names sort as plain text."""
    parts = re.split("([0-9]+)", name.casefold())  # text and numbers take turns, beginning with text
    return [_number(part) if k % 2 else part for k, part in enumerate(parts)], name


def _number(digits: str) -> tuple[int, str]:
    """A key that sorts like the number; Python refuses to parse numbers of thousands of digits."""
    significant = digits.lstrip("0")
    return len(significant), significant


def refuse_file(path: Path, where: str = "", remedy: str = "") -> NoReturn:
    """Raise an error that says why ``path`` is no regular file: ``where`` precedes the path, ``remedy`` follows the
    usual remedies."""
    try:
        path.stat()
        cause = "is a folder, not an image" if path.is_dir() else "is not a regular file"
    except OSError as error:
        cause = f"cannot be opened ({error.strerror})"
    raise InputError(f"{where}{shown(path)}: {cause}; correct or remove it{remedy}")


def file_bytes(path: Path) -> bytes:
    """The content of an image file.

    Raises:
        UnreadableError: it cannot be read, or is longer than allowed.
    """
    try:
        return read_bytes(path, "image_bytes")
    except OSError as error:
        raise UnreadableError(f"{shown(path)}: cannot be read ({error.strerror}); check path and permissions") from None


def folder_images(folder: Path) -> list[str]:
    """The paths of the image files directly in ``folder``, naturally sorted."""
    names, subfolders, unread = [], [], []
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.name.startswith("."):
                    continue
                if entry.is_dir():
                    subfolders.append(entry.name)
                elif is_unread(entry.name):
                    unread.append(entry.name)
                elif Path(entry.name).suffix.lower() in IMAGE_SUFFIXES:
                    # Leaving one out would silently shift the index of all that follow.
                    if not entry.is_file():
                        refuse_file(folder / entry.name)
                    names.append(entry.name)
    except OSError as error:
        where = folder if error.filename is None else error.filename
        raise InputError(f"{shown(where)}: cannot be read ({error.strerror}); check it and its permissions") from None
    if not names and unread:
        raise InputError(f"{shown(folder)}: holds only {_unread(unread)}; {advice()}")
    note_unread(folder, unread)
    if not names:
        hint = "give a folder that holds images directly"
        if subfolders:
            hint = "give one of its subfolders, such as " + shown(min(subfolders, key=natural_key))
        raise InputError(f"{shown(folder)}: holds no images ({' '.join(s[1:] for s in IMAGE_SUFFIXES)}); {hint}")
    return [str(folder / name) for name in sorted(names, key=natural_key)]


def is_unread(name: str) -> bool:
    """Whether a file's name is that of an image in a format that no decoder here reads."""
    suffix = Path(name).suffix.lower()
    return suffix == ".avif" or (suffix in HEIF_SUFFIXES and decoder() is None)


def advice() -> str:
    """The remedy for images in the formats of phones that no decoder here reads."""
    return _CONVERT if decoder() else f"install what reads HEIC and HEIF ({INSTALL}), or {_CONVERT}"


def _unread(names: list[str]) -> str:
    """The number of images of such formats, and the first, for a message."""
    many = f"{len(names)} image{'s' if len(names) > 1 else ''}"
    return f"{many} in a format that cannot be read (first: {shown(min(names, key=natural_key))})"


def note_unread(folder: Path, names: Iterable[str]) -> bool:
    """Log which images of ``folder`` are left out because no decoder here reads their format; returns whether any
    are."""
    unread = list(names)
    if unread:
        _NOTES.warning(f"{shown(folder)}: holds {_unread(unread)}, left out here; {advice()}")
    return bool(unread)


LIST_SUFFIXES = (".txt", ".lst", ".csv")
PATH_COLUMNS = ("image", "file", "filename", "path", "name")
_LONGEST_NAME = 255
"""Bytes of a file's name (NAME_MAX in linux/limits.h)."""
_BLANK = " \t"  # str.strip takes other characters, too, with which a file name may begin or end


def listed_images(path: Path) -> list[str]:
    """The files that a text or CSV list names, in its order; paths relative to the list's folder.

    The first row of a CSV list is a header if one of its cells is in `PATH_COLUMNS` (in any letter case); the first of
    these names gives the column. Otherwise all rows are images, and their first cells are the paths.

    Raises:
        InputError: the list cannot be read, names no image, or names one that is no regular file.
    """
    entries, hint = _csv_entries(path) if path.suffix.lower() == ".csv" else (_text_entries(path), "")
    files = []
    for number, entry in entries:
        where = f"{shown(path)} line {number}: "
        if not entry or "\0" in entry:
            raise InputError(f"{where}names no file; complete or remove the line")
        if max(len(os.fsencode(name)) for name in entry.split("/")) > _LONGEST_NAME:
            raise InputError(f"{where}{brief(entry)} has a name longer than {_LONGEST_NAME} bytes; correct the line")
        file = path.parent / entry
        if not os.path.isfile(file):
            refuse_file(file, where, hint if number == entries[0][0] else "")
        files.append(str(file))
    if not files:
        raise InputError(f"{shown(path)}: names no images; write one path a line")
    return files


def _text_entries(path: Path) -> list[tuple[int, str]]:
    """Line number and path of each line that is neither blank nor a comment."""
    lines = ((number, line.strip(_BLANK)) for number, line in enumerate(text_lines(path), start=1))
    return [(number, line) for number, line in lines if line and not line.startswith("#")]


def _csv_entries(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Line number and path of each row below the header, and the hint for a first row that names no file."""
    rows = csv_rows(path)
    header = [cell.lower() for cell in rows[0][1]] if rows else []
    column = next((name for name in PATH_COLUMNS if name in header), None)
    if column is None:
        return [(line, cells[0]) for line, cells in rows], f", or name its column {PATH_COLUMNS[0]!r} if it is a header"
    line = rows[0][0]
    if header.count(column) > 1:
        raise InputError(
            f"{shown(path)} line {line}: has {header.count(column)} columns {column!r}; rename all but one"
        )
    if os.path.isfile(path.parent / rows[0][1][header.index(column)]):
        cause = f"{column!r} may be a header or the file of that name"
        raise InputError(f"{shown(path)} line {line}: {cause}; add a header, or write ./{column}")
    return [(line, cells[header.index(column)]) for line, cells in rows[1:]], ""
