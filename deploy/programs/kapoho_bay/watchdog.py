"""The watch over the time that NxSDK takes."""

import os
import threading
from typing import Callable, Optional

from result_files import fail

GRACE = 10.0


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
