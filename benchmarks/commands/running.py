"""What a whole command takes, its start included: seconds, seconds of processors, memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

PROGRAM = (sys.executable, "-m", "lava_vpr")
STARTER = """
import resource, subprocess, sys, time
began = time.perf_counter()
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
used, unit = resource.getrusage(resource.RUSAGE_CHILDREN), 1 if sys.platform == "darwin" else 1024
print(code, time.perf_counter() - began, used.ru_utime + used.ru_stime, used.ru_maxrss * unit)
"""
"""Starts a command from a process that holds little: Linux counts what the starter held as the command's own."""


class CommandRun(NamedTuple):
    """Seconds that a command took, seconds of processors that it used, and bytes that it held at most."""

    seconds: float
    used: float
    held: float


def command_run(place: Path, *words: object) -> CommandRun:
    """What a command takes that runs in ``place``, which must succeed."""
    command = [sys.executable, "-c", STARTER, *map(str, words)]
    run = subprocess.run(command, cwd=place, stdout=subprocess.PIPE, text=True, check=True)
    code, *figures = map(float, run.stdout.split())
    if code:
        raise SystemExit(f"{' '.join(map(str, words))}: failed, see above")
    return CommandRun(*figures)


def lava_vpr(place: Path, *words: object) -> CommandRun:
    """What a command of lava-vpr takes."""
    return command_run(place, *PROGRAM, *words)
