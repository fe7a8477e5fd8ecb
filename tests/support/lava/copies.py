"""Workers of `run_isolated` as copies (fork) of a process that has imported Lava, instead of freshly started Pythons.

All else is the worker's own: the keeper, its group and session, what it watches and what it ends. The first worker of
each environment, search path included, is a freshly started Python, and so is every one of tests/isolated.

Used by conftest.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from support.common import children

from lava_vpr.interrupts import held
from lava_vpr.isolated import child, lifetime, worker

IMPORTED = (
    "lava.magma.compiler.compiler",
    "lava.magma.runtime.runtime",
    *(f"lava_vpr.isolated.{part}" for part in ("first_failure", "job_folder")),
    *(f"lava_vpr.processes.jobs.{job}" for job in ("conductance", "inference", "learning")),
)
NOT_COMPARED = ("PYTEST_CURRENT_TEST", "TMPDIR")
LONGEST = 60.0  # seconds; reached only when something hangs
_SUBREAPER = 36  # <linux/prctl.h>
_prctl = getattr(ctypes.CDLL(None), "prctl", None)  # Linux


class Copy(subprocess.Popen[Any]):
    """A copy that has become a child of this process, as `subprocess.Popen` would have started it."""

    def __init__(self, words: Sequence[str], pid: int) -> None:
        self.args, self.pid, self.returncode = words, pid, None
        self.stdin = self.stdout = self.stderr = None
        vars(self).update(_waitpid_lock=threading.Lock(), _child_created=True, _sigint_wait_secs=0.25)


class Original:
    """The process that has imported Lava: asked through a socket, it makes copies, and ends when the socket does."""

    def __init__(self, environment: dict[str, str]) -> None:
        self._asked, its = socket.socketpair()
        self._lock = threading.Lock()
        with its:
            command = [sys.executable, "-m", __name__, its.fileno()]
            self.process = children.Child(command, env=environment, pass_fds=[its.fileno()])
        children.STARTED.discard(self.process)  # it serves all tests that come

    def copy(self, words: Sequence[str], folder: Path, environment: dict[str, str], log: int) -> Copy:
        """A copy that runs the worker."""
        with self._lock:
            _adopt(True)
            try:
                asked = json.dumps([words, str(folder), environment]).encode()
                socket.send_fds(self._asked, [len(asked).to_bytes(8, "little")], [log])
                self._asked.sendall(asked)
                pid = int.from_bytes(_received(self._asked, 8), "little")
                assert pid, "the process that is copied has ended"
                assert children.until(lambda: _parent(pid) == os.getpid(), LONGEST)
            finally:
                _adopt(False)
        return Copy(words, pid)

    def end(self) -> None:
        self._asked.close()
        self.process.wait(timeout=LONGEST)
        self.process.end()


def _adopt(so: bool) -> None:
    """Whether processes below this one become its children when their own parent ends."""
    assert _prctl is not None
    _prctl(_SUBREAPER, ctypes.c_ulong(so), *[ctypes.c_ulong(0)] * 3)


def _parent(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def _received(connection: socket.socket, count: int) -> bytes:
    """So many bytes; fewer if the other side has gone."""
    got = b""
    while len(got) < count and (more := connection.recv(count - len(got))):
        got += more
    return got


_originals: dict[frozenset[tuple[str, str]], Original | None] = {}
"""By their environments; None: one Python has been started with it, and nothing to be copied."""


@contextmanager
def started(words: Sequence[str | Path], grace: float = 0.0, **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """As `lava_vpr.isolated.child.started`; from the second worker of an environment on, a worker is a copy."""
    environment = options["env"]
    key = frozenset(item for item in environment.items() if item[0] not in NOT_COMPARED)
    again = key in _originals
    original = _originals.setdefault(key, None)
    if again and original is None and _prctl is not None and threading.current_thread() is threading.main_thread():
        original = _originals[key] = Original(environment)
    if original is None:
        with child.started(words, grace, **options) as process:
            yield process
        return
    with held():
        made = original.copy([str(word) for word in words], options["cwd"], environment, options["stdout"].fileno())
    try:
        yield made
    finally:
        with made:
            child.end(made, grace)


def end() -> None:
    """End the processes that are copied."""
    for original in filter(None, _originals.values()):
        original.end()
    _originals.clear()


def _run(words: Sequence[str], folder: str, environment: dict[str, str], log: int) -> int:
    """Run the worker in this process, which is a copy, once its caller has become its parent."""
    given, caller = Path(words[-2]), int(words[-1])
    os.setsid()
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for stream in (1, 2):
        os.dup2(log, stream)
    while os.getppid() != caller:
        time.sleep(0.001)
    return lifetime.keep(given, caller, partial(worker.work, given))


def serve(connection: socket.socket) -> None:
    """Make a copy for each request until nobody asks any more."""
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for name in IMPORTED:
        importlib.import_module(name)
    gc.freeze()
    while True:
        length, files, _, _ = socket.recv_fds(connection, 8, 1)
        if not length:
            return
        words, folder, environment = json.loads(_received(connection, int.from_bytes(length, "little")))
        between = os.fork()
        if between == 0:
            pid = os.fork()
            if pid:
                connection.sendall(pid.to_bytes(8, "little"))
                os._exit(0)
            connection.close()
            code = 1
            try:
                code = _run(words, folder, environment, files[0])
            finally:
                os._exit(code)
        os.waitpid(between, 0)
        os.close(files[0])


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])))
