"""Files that users name: their types, and image folders in natural order; each refusal is one clear line."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import NoReturn

from lava_vpr.errors import InputError
from lava_vpr.storage.text import shown

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
VIDEO_SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg")


def natural_key(name: str) -> tuple[list[str | tuple[int, str]], str]:
    """Sort key that reads digits as numbers and ignores case: img2 before img10. Equal ones: by plain text."""
    parts = re.split("([0-9]+)", name.casefold())  # text and numbers take turns, beginning with text
    return [_number(part) if k % 2 else part for k, part in enumerate(parts)], name


def _number(digits: str) -> tuple[int, str]:
    """What sorts as the number does; Python refuses to read one of thousands of digits."""
    significant = digits.lstrip("0")
    return len(significant), significant


def refuse_file(path: Path, where: str = "", remedy: str = "") -> NoReturn:
    """Say why ``path`` is no regular file: ``where`` precedes it, ``remedy`` follows the usual ones."""
    try:
        path.stat()
        cause = "is a folder, not an image" if path.is_dir() else "is not a regular file"
    except OSError as error:
        cause = f"cannot be opened ({error.strerror})"
    raise InputError(f"{where}{shown(path)}: {cause}; correct or remove it{remedy}")


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
