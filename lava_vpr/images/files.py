"""Files that users name: image folders in natural order, lists and tables as text; each refusal is one clear line."""

from __future__ import annotations

import csv
import io
import os
import re
from pathlib import Path
from typing import NoReturn

from lava_vpr.errors import InputError
from lava_vpr.storage.text import shown

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
VIDEO_SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg")


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


def folder_images(folder: Path) -> list[str]:
    """The paths of the image files directly in ``folder``, naturally sorted."""
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
    return [str(folder / name) for name in sorted(names, key=natural_key)]


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
