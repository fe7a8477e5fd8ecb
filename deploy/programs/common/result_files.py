"""Counts of the queries that were answered, and how far it went: in files that are whole at any time."""

import json
import os
import threading
from typing import Union

import numpy as np


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


class ResultFiles:
    """Counts, and which are answered; in files, if there is a folder."""

    def __init__(self, n: int, neurons: int, folder: str = "") -> None:
        self.counts, self.done = np.full((n, neurons), -1, np.int32), np.zeros(n, bool)
        self.folder, self.lock = folder, threading.Lock()

    def save(self, stage: str = "", error: str = "") -> None:
        """Replace the files, the counts first: what is said to be done is there.

        Raises:
            OSError: they cannot be written.
        """
        if not self.folder:
            return
        with self.lock:
            os.makedirs(self.folder, exist_ok=True)
            put(os.path.join(self.folder, "counts.npy"), self.counts)
            put(os.path.join(self.folder, "done.npy"), self.done)
            done = int(self.done.sum())
            status = {"done": done, "of": len(self.done), "stage": stage or None, "error": error or None}
            put(os.path.join(self.folder, "status.json"), status)

    def answered(self) -> str:
        """How many, for a message."""
        return f" ({int(self.done.sum())} of {len(self.done)} queries answered)"
