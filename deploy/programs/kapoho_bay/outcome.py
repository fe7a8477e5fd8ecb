"""Results, the watch over NxSDK's time, and what is said and kept when anything goes wrong."""

import contextlib
import os
import sys
import tempfile
import threading
from typing import Callable, Optional

import numpy as np

from refusals import Refused
from result_files import ResultFiles

FAILURE = "failure.txt"
GRACE = 10.0


class Results(ResultFiles):
    """Counts, and which are answered; those of the newest are kept when anything goes wrong."""

    current: Optional["Results"] = None

    def __init__(self, n: int, neurons: int, folder: str = "") -> None:
        super().__init__(n, neurons, folder)
        Results.current = self
        if folder:
            with contextlib.suppress(FileNotFoundError):
                os.remove(os.path.join(folder, FAILURE))
        self.save()

    def put(self, number: int, row: np.ndarray) -> None:
        """Counts of a query that was answered."""
        if (row < 0).any():
            raise Refused("run", f"query {number}: no chip counts neuron {int(np.argmax(row < 0))}")
        self.counts[number], self.done[number] = row, True


class Watchdog:
    """Ends this process if the block takes longer: NxSDK's calls have no time limits, and cannot be interrupted."""

    let_go: Optional[Callable[[], None]] = None  # of the board, if there is one

    def __init__(self, seconds: float, stage: str, text: str) -> None:
        self.over = threading.Event()
        self.seconds, self.stage, self.text = seconds, stage, text

    def __enter__(self) -> None:
        threading.Thread(target=self._watch, daemon=True).start()

    def __exit__(self, *_: object) -> None:
        self.over.set()

    def _watch(self) -> None:
        if self.over.wait(self.seconds):
            return
        fail(self.stage, self.text)
        if Watchdog.let_go is not None:
            Watchdog.let_go()
        os._exit(1)


def fail(stage: str, text: str, details: str = "") -> None:
    """Keep what there is, and say why there is no more."""
    results = Results.current
    line = text
    if results is not None:
        with contextlib.suppress(OSError):
            results.save(stage, text)
        if stage in ("run", "start"):
            line += results.answered()
    if details:
        folder = results.folder if results is not None else ""
        path = os.path.join(folder, FAILURE) if folder else tempfile.mkstemp("." + FAILURE, "kapoho-bay-")[1]
        with contextlib.suppress(OSError), open(path, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(details)
            line += "; traceback: " + path
    sys.stderr.write(line + "\n")
    sys.stderr.flush()
