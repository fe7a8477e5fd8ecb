"""The child of the host program in which rungs are tried: one that hangs or crashes costs one attempt."""

import argparse
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any, Dict, FrozenSet, Optional

from board_device import ATTEMPTS, START_SECONDS
from refusals import plain
from watchdog import GRACE

LOOK, KEPT = 0.01, 4000  # seconds; characters of output


def patience(options: argparse.Namespace, queries: int) -> float:
    """Seconds after which a child hangs that presents so many queries: those of all its own limits together."""
    batches = -(-max(1, queries) // options.batch)
    return (1 + ATTEMPTS) * (START_SECONDS + GRACE) + batches * (
        (options.timeout or 60.0 + 10.0 * options.batch) + GRACE
    )


class Attempts:
    """Tries rungs in a child; see `ladder.Attempt`. At the end of the block it has ended."""

    child: Any = None  # subprocess.Popen, while there is one

    def __init__(self, program: str, options: argparse.Namespace, queries: int) -> None:
        self.folder, self.number = tempfile.mkdtemp(prefix="kapoho-bay-"), 0
        self.patience = patience(options, queries)
        given = ["--attempts", self.folder, "--timeout", str(options.timeout), "--batch", str(options.batch)]
        given += ["--out", os.path.abspath(options.out)] if options.out else []
        self.command, self.log = [sys.executable, program, *given], os.path.join(self.folder, "log")

    def __enter__(self) -> "Attempts":
        return self

    def __call__(self, name: str, ways: FrozenSet[str]) -> dict:
        self.number += 1
        answer = os.path.join(self.folder, "{}.json".format(self.number))
        before = os.path.getsize(self.log) if os.path.exists(self.log) else 0
        if self.child is None:
            with open(self.log, "ab") as log:
                pipes: Dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": log, "stderr": log}
                self.child = subprocess.Popen(self.command, start_new_session=True, **pipes)
        error = self._wait(answer, json.dumps([self.number, name, sorted(ways)]) + "\n")
        with open(self.log, "rb") as file:
            file.seek(before)
            said = file.read().decode(errors="replace")
        if error is None:
            with open(answer, encoding="utf-8") as text:
                result = dict(json.load(text))
        else:
            last = "".join(said.strip().splitlines()[-1:]) or "it wrote nothing"
            result = {"error": plain(" ".join((error + last).split()))}
        return dict(result, output=(said + result.get("output", ""))[-KEPT:])

    def _wait(self, answer: str, line: str) -> Optional[str]:
        """Until the child has answered a line; what became of it if it does not."""
        child, end = self.child, time.monotonic() + self.patience
        try:
            child.stdin.write(line.encode())
            child.stdin.flush()
        except OSError:
            pass  # it has ended, which is seen below
        while not os.path.exists(answer):
            if child.poll() is not None and not os.path.exists(answer):
                self._end()
                return "" if child.returncode == 1 else "ended with code {}: ".format(child.returncode)
            if time.monotonic() > end:
                self._end()
                return "hung for {:g} s and was ended: ".format(self.patience)
            time.sleep(LOOK)
        return None

    def _end(self) -> None:
        """Let the child let go of the board; end it, and all that it started, if it does not."""
        if self.child is None:
            return
        with contextlib.suppress(OSError):  # what is left to be sent to one that has ended
            self.child.stdin.close()
        try:
            self.child.wait(2 * GRACE)
        except subprocess.TimeoutExpired:
            os.killpg(self.child.pid, signal.SIGKILL)
            self.child.wait()
        self.child = None

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None and self.child is not None:
            self.child.terminate()
        self._end()
        shutil.rmtree(self.folder, ignore_errors=True)
