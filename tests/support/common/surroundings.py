"""The real command in a process of its own, in surroundings of the test's choice: streams, limits, user, signals.

Used by cli.
"""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from support.common import children

DEADLINE = 240.0  # seconds; reached only when something hangs
SHARED = Path("/dev/shm")
PROGRAM = (sys.executable, "-m", "lava_vpr")
QUERY = ("query", "m.lvpr", "query", "--min-confidence", "0", "-o")
"""A query that has nothing to note; the name of its CSV is behind it."""

# The command line, but a signal (argv[1]) comes when the module argv[2] is first looked for.
AT_IMPORT = """
import os, sys
number, name = int(sys.argv.pop(1)), sys.argv.pop(1)
class Finder:
    def find_spec(self, wanted, *rest):
        if wanted == name:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), number)
sys.meta_path.insert(0, Finder())
from lava_vpr.__main__ import run
run()
"""


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    Attributes:
        code: Its exit code; negative: the signal that ended it.
        out, err: What it wrote, without what is no UTF-8.
        left: What it left among the temporary files, and in shared memory of what stood there when it was stopped.
        made: Entries that are new in the working directory.
    """

    code: int
    out: str
    err: str
    left: list[str]
    made: list[str] = field(default_factory=list)

    @property
    def lines(self) -> list[str]:
        """The lines on stderr that say something."""
        return [line for line in self.err.splitlines() if line.strip()]


def _wait_until_it_minds(child: children.Child) -> None:
    """Wait until the program catches SIGHUP, which Python does not, or has ended."""
    status = Path(f"/proc/{child.pid}/status")
    while child.poll() is None:
        caught = next(line for line in status.read_text().splitlines() if line.startswith("SigCgt:"))
        if int(caught.split()[1], 16) >> (signal.SIGHUP - 1) & 1:
            return
        time.sleep(0.002)


def run(
    folder: Path,
    *words: object,
    program: Sequence[str] = PROGRAM,
    set_to: Mapping[str, str] | None = None,
    without: Sequence[str] = (),
    closed: Sequence[int] = (),
    out: Path | None = None,
    limits: Mapping[int, int] | None = None,
    prefix: Callable[[Sequence[str]], list[str]] | None = None,
    stop: tuple[int, float] | None = None,
    ignored: Sequence[int] = (),
) -> Ended:
    """Run a command in ``folder`` to its end; its temporary files go to a new folder beside it.

    Args:
        folder: The working directory.
        words: The command's arguments.
        program: What is run.
        set_to: Environment variables that are added.
        without: Environment variables that are taken away.
        closed: Numbers of streams that are closed.
        out: What stdout is connected to.
        limits: Limits of the process by their numbers in `resource`.
        prefix: Makes other words of the program's.
        stop: A signal, and the seconds after which it is sent, once the program minds signals: Python itself shows
            tracebacks while it starts.
        ignored: Signals that are ignored when the program starts.
    """
    # In a folder of a short name: the sockets that Lava makes there take no long paths.
    temporary = Path(tempfile.mkdtemp(prefix="t", dir=folder.parent))
    temporary.chmod(0o777)
    command = [*program, *(str(word) for word in words)]
    environment = {key: value for key, value in os.environ.items() if key not in without}
    environment |= {"TMPDIR": str(temporary), **(set_to or {})}

    def prepare() -> None:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN if number in ignored else signal.SIG_DFL)
        for number, most in (limits or {}).items():
            resource.setrlimit(number, (most, most))
        for stream in closed:
            os.close(stream)

    before, runs = set(os.listdir(folder)), []
    with open(out if out is not None else os.devnull, "wb") as sink:
        with children.Child(
            prefix(command) if prefix is not None else command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=sink if out is not None else subprocess.PIPE,
            stderr=subprocess.PIPE,
            preexec_fn=prepare,
        ) as child:
            if stop is not None:
                _wait_until_it_minds(child)
                time.sleep(stop[1])
                runs = os.listdir(temporary)
                child.send_signal(stop[0])
            printed, said = child.communicate(timeout=DEADLINE)
    left = [*os.listdir(temporary), *(name for name in os.listdir(SHARED) if any(run in name for run in runs))]
    made = sorted(set(os.listdir(folder)) - before)
    texts = [(text or b"").decode(errors="replace") for text in (printed, said)]
    return Ended(child.returncode, texts[0], texts[1], left, made)


def done(ended: Ended, *made: str) -> None:
    """It did its work without a word on stderr but notes, and made just these files."""
    assert ended.code == 0, ended
    assert all(line.startswith("note: ") for line in ended.lines), ended.err
    assert not ended.left
    assert ended.made == sorted(made)
