"""Forked workers that try cases under guards of time and memory; one that dies takes no more than its case with it.

Used by storage and support.
"""

from __future__ import annotations

import faulthandler
import json
import math
import os
import resource
import select
import signal
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from support.fuzz.files import cases
from support.fuzz.files.corpus import Corpus
from support.fuzz.files.trial import CRASH, HANG, Outcome, tried

from lava_vpr.storage.limits import LIMITS, variable

CPU_SECONDS = 5
"""Processor time of one case, whatever else the machine does."""
STILL_SECONDS = 10.0
"""Time after which a case waits for something that never comes, if all its threads sleep."""
MEMORY = 1 << 30
"""What a case may take beside what the worker has at its start."""
LOWERED = 1 << 26
"""Most of every limit in bytes while cases are tried, so that `MEMORY` is far above what limits allow."""


def lower_limits() -> None:
    """Lower the program's limits in bytes, by their variables."""
    for name, limit in LIMITS.items():
        if limit.unit == "bytes":
            os.environ[variable(name)] = str(min(limit.default, LOWERED))


@dataclass
class _Worker:
    """A child process, what it still has to do, and the case that it is at."""

    pid: int
    pipe: int
    left: list[int]
    at: int | None = None
    since: float = field(default_factory=time.monotonic)
    text: bytes = b""


def run(corpus: Corpus, seed: int, numbers: Sequence[int], workers: int = 2) -> Iterator[tuple[int, Outcome]]:
    """Try the cases ``numbers`` of ``seed``; yields each with its outcome, as they come."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    parts = [list(numbers[k::workers]) for k in range(workers)]
    running = [_start(corpus, seed, part, k) for k, part in enumerate(parts) if part]
    names = {worker.pid: k for k, worker in enumerate(running)}
    try:
        while running:
            ready, _, _ = select.select([worker.pipe for worker in running], [], [], 1.0)
            for worker in list(running):
                if worker.pipe in ready:
                    data = os.read(worker.pipe, 1 << 16)
                    yield from _heard(worker, data)
                    if data:
                        continue
                elif time.monotonic() - worker.since < STILL_SECONDS or not _asleep(worker.pid):
                    continue
                else:
                    os.kill(worker.pid, signal.SIGKILL)
                outcome = _ended(worker)
                running.remove(worker)
                if outcome is not None and worker.at is not None:
                    yield worker.at, outcome
                if worker.left:
                    again = _start(corpus, seed, worker.left, names[worker.pid])
                    names[again.pid] = names[worker.pid]
                    running.append(again)
    finally:
        for worker in running:
            os.kill(worker.pid, signal.SIGKILL)
            os.waitpid(worker.pid, 0)


def _asleep(pid: int) -> bool:
    """Whether all threads of a process wait, but for the disk; one that waits for a processor does not."""
    states = [path.read_text(encoding="ascii", errors="replace") for path in Path(f"/proc/{pid}/task").glob("*/stat")]
    return all(state.rpartition(")")[2].split()[0] == "S" for state in states)


def _heard(worker: _Worker, data: bytes) -> Iterator[tuple[int, Outcome]]:
    """What a worker said: lines of a number and, once the case is done, its outcome."""
    worker.since = time.monotonic()
    *lines, worker.text = (worker.text + data).split(b"\n")
    for line in lines:
        number, *outcome = json.loads(line)
        if outcome:
            worker.at = None
            worker.left.remove(number)
            yield number, Outcome(*outcome)
        else:
            worker.at = number


def _ended(worker: _Worker) -> Outcome | None:
    """What the end of a worker says of the case that it was at; that case is taken from what is left."""
    os.close(worker.pipe)
    _, status = os.waitpid(worker.pid, 0)
    if worker.at is None:
        if worker.left:
            raise RuntimeError(f"a worker ended between two cases, with status {status}")
        return None
    worker.left.remove(worker.at)
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU:
        return Outcome(HANG, f"more than {CPU_SECONDS} s of processor time")
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL:
        return Outcome(HANG, "waits for something that does not come, or was killed")
    return Outcome(CRASH, f"the process ended with status {status}")


def _start(corpus: Corpus, seed: int, numbers: list[int], name: int) -> _Worker:
    """A worker for ``numbers``."""
    out, into = os.pipe()
    pid = os.fork()
    if pid:
        os.close(into)
        return _Worker(pid, out, list(numbers))
    code = 1
    try:
        os.close(out)
        _work(corpus, seed, numbers, into, f"work{name}")
        code = 0
    finally:
        os._exit(code)  # nothing of the parent's is to be done twice


def _work(corpus: Corpus, seed: int, numbers: list[int], into: int, name: str) -> None:
    """What a worker does."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    faulthandler.disable()  # a death is told by the parent
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", DeprecationWarning)
    with open("/proc/self/statm", encoding="ascii") as file:
        pages = int(file.read().split()[0])
    most = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    for number in numbers:
        used = sum(os.times()[:2])
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(used) + CPU_SECONDS, hard))
        os.write(into, json.dumps([number]).encode() + b"\n")
        outcome = tried(cases.make(corpus, seed, number), corpus, name)
        os.write(into, json.dumps([number, outcome.kind, outcome.told[:6000]]).encode() + b"\n")
