"""The host programs that this version of lava-vpr ships, as they stand in a bundle's folder ``program``."""

from __future__ import annotations

from pathlib import Path

PROGRAMS = Path(__file__).parents[1] / "programs"
FOLDER = "program"


def program_files(folder: str) -> dict[str, bytes]:
    """The host program ``run.py`` of a board and the files that it needs beside it, by their names in a bundle.

    Args:
        folder: Its folder in ``deploy/programs``.
    """
    folders = (PROGRAMS / "common", PROGRAMS / folder)
    files = sorted(path for holder in folders for path in holder.iterdir() if path.is_file())
    return {f"{FOLDER}/{path.name}": path.read_bytes() for path in files}
