"""Counts of the queries that were answered, in files that are whole at any time, also when anything goes wrong."""

import contextlib
import json
import os
import sys
import tempfile
import threading
from typing import Optional, Union

import numpy as np

from refusals import Refused, plain

FAILURE = "failure.txt"


def put(path: str, content: Union[np.ndarray, dict]) -> None:
    """Write an array, or JSON; the file is complete or the old one."""
    temporary = path + ".part"
    with open(temporary, "wb") as file:
        if isinstance(content, dict):
            file.write((json.dumps(content) + "\n").encode())
        else:
            np.lib.format.write_array(file, np.ascontiguousarray(content), version=(1, 0), allow_pickle=False)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)


class Results:
    """Counts, and which are answered: in files, if there is a folder. `fail` keeps those made last.

    Raises:
        Refused: they cannot be written.
    """

    current: Optional["Results"] = None

    def __init__(self, n: int, neurons: int, folder: str = "") -> None:
        self.counts, self.done = np.full((n, neurons), -1, np.int32), np.zeros(n, bool)
        self.folder, self.lock = folder, threading.Lock()
        Results.current = self
        if folder:
            with contextlib.suppress(OSError):
                os.remove(os.path.join(folder, FAILURE))
        self.save()

    def put(self, number: int, row: np.ndarray) -> None:
        """Counts of a query that was answered.

        Raises:
            Refused: they are none.
        """
        if row.shape != self.counts.shape[1:] or (row < 0).any():
            raise Refused("run", f"query {number}: impossible spike counts {row.tolist()}; present it again")
        self.counts[number], self.done[number] = row, True

    def save(self, stage: str = "", error: str = "") -> None:
        """Replace the files, the counts first: what is said to be done is there."""
        if not self.folder:
            return
        done = int(self.done.sum())
        status = {"done": done, "of": len(self.done), "stage": stage or None, "error": error or None}
        try:
            with self.lock:
                os.makedirs(self.folder, exist_ok=True)
                put(os.path.join(self.folder, "counts.npy"), self.counts)
                put(os.path.join(self.folder, "done.npy"), self.done)
                put(os.path.join(self.folder, "status.json"), status)
        except OSError as problem:
            raise Refused("input", f"{self.folder}: cannot be written ({problem.strerror}); name another") from None


def fail(stage: str, text: str, details: str = "") -> None:
    """Keep what there is, and say why there is no more."""
    results, line = Results.current, text
    if results is not None:
        with contextlib.suppress(Refused):
            results.save(stage, text)
        if stage in ("run", "start"):
            line += f" ({int(results.done.sum())} of {len(results.done)} queries answered)"
    if details:
        folder = results.folder if results is not None else ""
        path = os.path.join(folder, FAILURE) if folder else tempfile.mkstemp("." + FAILURE, "lava-vpr-")[1]
        with contextlib.suppress(OSError), open(path, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(details)
            line += "; traceback: " + path
    sys.stderr.write(plain(line) + "\n")
    sys.stderr.flush()
