"""What a run and its worker tell each other: files in one folder, never pickles.

``job.json`` (target and options), ``given/`` and ``results/`` (arrays), ``group`` (the process group of the work),
``progress`` (eight bytes a report), ``error.json`` (the first failure), ``stacks-*`` (where processes stood), ``log``.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

LOOK = 0.01  # seconds between two looks for a job


def save_arrays(folder: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write named arrays of numbers, booleans or text as ``folder``, which appears when all are written.

    Raises:
        OSError: the disk is full or cannot be written.
        ValueError: an array holds Python objects.
    """
    part = folder.with_name(folder.name + ".part")
    part.mkdir()
    for number, array in enumerate(arrays.values()):
        np.save(part / f"{number}.npy", np.asarray(array), allow_pickle=False)
    (part / "names.json").write_text(json.dumps(list(arrays)), encoding="utf-8")
    part.rename(folder)


def load_arrays(folder: Path) -> dict[str, NDArray[Any]]:
    """Read the arrays that `save_arrays` wrote as ``folder``, by name."""
    names = json.loads((folder / "names.json").read_text(encoding="utf-8"))
    return {name: np.load(folder / f"{number}.npy", allow_pickle=False) for number, name in enumerate(names)}


def save_job(folder: Path, target: str, options: str) -> None:
    """Write what is to be done, after the arrays; ``options`` is JSON."""
    part = folder / "job.part"
    part.write_text(json.dumps([target, options]), encoding="utf-8")
    part.replace(folder / "job.json")


def load_job(folder: Path) -> tuple[str, dict[str, Any], dict[str, NDArray[Any]]]:
    """Wait until there is something to do: target, options and arrays."""
    while not (folder / "job.json").exists():
        time.sleep(LOOK)
    target, options = json.loads((folder / "job.json").read_text(encoding="utf-8"))
    return target, json.loads(options), load_arrays(folder / "given")


class ProgressReader:
    """Sums the reports in ``folder`` that came since the last look."""

    def __init__(self, folder: Path) -> None:
        self._path, self._seen = folder / "progress", 0
        self._path.touch()

    def new(self) -> int:
        """Units of work reported since the last call."""
        with self._path.open("rb") as file:
            file.seek(self._seen)
            data = file.read()
        self._seen += len(data)
        return int(np.frombuffer(data, np.int64).sum())


class ProgressWriter:
    """Appends reports; any process may, at the same time as others (a short append is one step)."""

    def __init__(self, folder: Path) -> None:
        self._file = os.open(folder / "progress", os.O_WRONLY | os.O_APPEND)

    def add(self, done: int) -> None:
        """Report ``done`` further units of work."""
        os.write(self._file, np.int64(done).tobytes())
