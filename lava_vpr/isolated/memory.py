"""How much memory processes hold, as Linux tells; None where the system does not."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

PROC = Path("/proc")
_KIBI = 1024


def _kibibytes(path: Path, name: str) -> int | None:
    """The value of the line ``name`` of a file of /proc, which are all in units of 1024 bytes."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in path.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith(f"{name}:"):
                return int(line.split()[1])
    return None


def own_peak() -> int | None:
    """Bytes that this process held at most since it began.

    ``VmHWM`` belongs to the program that runs; the maximum that `resource.getrusage` tells would begin with what the
    process that started it held.
    """
    held = _kibibytes(PROC / "self" / "status", "VmHWM")
    return None if held is None else held * _KIBI


def family() -> list[int]:
    """This process and all below it, by id."""
    below: dict[int, list[int]] = {}
    for path in PROC.glob("[0-9]*/stat"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            # The name, in brackets, may hold anything; after it come state and parent.
            parent = int(path.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()[1])
            below.setdefault(parent, []).append(int(path.parent.name))
    processes = [os.getpid()]
    for process in processes:  # grows while it is gone through
        processes += below.get(process, [])
    return processes


def held_by_family() -> int | None:
    """Bytes that this process and all below it hold now; pages that several of them share are counted once."""
    held = [_kibibytes(PROC / str(process) / "smaps_rollup", "Pss") for process in family()]
    known = [size for size in held if size is not None]
    return sum(known) * _KIBI if known else None
