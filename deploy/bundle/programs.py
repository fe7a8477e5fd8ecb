"""The host programs that this version of lava-vpr ships, as they stand in a bundle's folder ``program``."""

from __future__ import annotations

from pathlib import Path

from lava_vpr.isolated import lifetime

PROGRAMS = Path(__file__).parents[1] / "programs"
FOLDER = "program"
OURS = {"loihi2": ("first_failure.py", "job_folder.py", "lifetime.py")}
"""Files of `lava_vpr.isolated` that a host program has copies of, by its folder; they import nothing of lava_vpr."""


def program_files(folder: str) -> dict[str, bytes]:
    """The host program ``run.py`` of a board and the files that it needs beside it, by their names in a bundle.

    Args:
        folder: Its folder in ``deploy/programs``.
    """
    isolated = Path(lifetime.__file__).parent
    folders = (PROGRAMS / "common", PROGRAMS / folder)
    files = [path for holder in folders for path in holder.iterdir() if path.is_file()]
    files += [isolated / name for name in OURS.get(folder, ())]
    return {f"{FOLDER}/{path.name}": path.read_bytes() for path in sorted(files, key=lambda path: path.name)}
