"""Change honest files at random, give them to the program, and count what becomes of them.

    PYTHONPATH=tests .venv/bin/python -m support.fuzz.run [--count 10000] [--seed 0] [--first 0] [--show 20]

Prints outcomes by format, and every failure with its number; ``--first NUMBER --count 1`` repeats one alone. The exit
code is 1 if there is a failure. A case that takes more than `CPU_SECONDS` of the processor, or that ends the process,
ends the run: the last number in ``--log`` is its own. One that takes more than `MEMORY` is a MemoryError.

Used by storage.
"""

from __future__ import annotations

import argparse
import collections
import faulthandler
import os
import resource
import signal
import sys
import tempfile
import warnings
from pathlib import Path

import cv2
from support.fuzz import corpus, trial

from lava_vpr.storage.limits import LIMITS, variable

CPU_SECONDS = 5.0
"""Processor time of one case, whatever else the machine does."""
MEMORY = 1 << 30
"""What a case may take beside what the process has at its start."""
LOWERED = 1 << 26
"""Most of every limit in bytes, so that `MEMORY` is far above what limits allow."""


def guard() -> None:
    """Lower the program's limits in bytes, and bound the memory of this process."""
    for name, limit in LIMITS.items():
        if limit.unit == "bytes":
            os.environ[variable(name)] = str(min(limit.default, LOWERED))
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faulthandler.disable()
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", DeprecationWarning)


def main(words: list[str] | None = None) -> int:
    """Run the command; its exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    for name, default in (("--count", 10_000), ("--seed", 0), ("--first", 0), ("--show", 20)):
        parser.add_argument(name, type=int, default=default)
    parser.add_argument("--log", type=Path, default=Path(os.devnull), help="File that gets the number of each case.")
    asked = parser.parse_args(words)
    cv2.setNumThreads(0)
    counts = collections.Counter[tuple[str, str]]()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder, asked.log.open("w") as log:
        honest = corpus.make(Path(folder))
        for case in trial.honest(honest):  # compiles what they need, before there are guards
            trial.tried(case, honest)
        guard()
        for number in range(asked.first, asked.first + asked.count):
            case = trial.made(honest, asked.seed, number)
            print(number, case.format, case.honest, file=log, flush=True)
            signal.setitimer(signal.ITIMER_PROF, CPU_SECONDS)  # SIGPROF ends the process
            kind, told = trial.tried(case, honest)
            signal.setitimer(signal.ITIMER_PROF, 0)
            counts[case.format, kind] += 1
            if kind not in (trial.REFUSED, trial.SOUND) and asked.show:
                asked.show -= 1
                print(f"{kind}: seed {asked.seed}, number {number}, {case}\n    {told.strip()}", flush=True)
    kinds = [trial.REFUSED, trial.SOUND, *sorted({kind for _, kind in counts} - {trial.REFUSED, trial.SOUND})]
    for row in (["format", *kinds], *([f, *(str(counts[f, kind]) for kind in kinds)] for f in trial.SHARES)):
        print("| " + " | ".join(row) + " |")
    return int(any(kind not in (trial.REFUSED, trial.SOUND) for _, kind in counts))


if __name__ == "__main__":
    sys.exit(main())
