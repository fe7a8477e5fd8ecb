"""Runs the program for Kapoho Bay against the stand-in for NxSDK: in this process, or as a child.

Used by bench and deploy.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from support.boards import host_programs
from support.boards.host_programs import Made
from support.common import children

from lava_vpr.deploy.bundle import folder as bundle

STANDIN = Path(__file__).parents[1] / "standins" / "kapoho_bay"
ASKED = ["rows without indices", "rows with indices, of discrete axons", "weights of fewer than 8 bits"]
"""Kinds of unproven values of registers that bundles may have; the stand-in takes them where a test says so."""
SEEDS = {"KAPOHOBAY": "1", "PYTHONPATH": str(STANDIN), "PYTHONDONTWRITEBYTECODE": "1"}
SEEDS |= {"STANDIN": json.dumps({"asked": ASKED})}


@dataclass(frozen=True)
class Ended:
    """How the program ended."""

    code: int
    out: str
    err: str


class Looks:
    """In place of the module time: a clock that goes on only while the program waits for a chip."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        """Seconds slept."""
        return self.now

    def sleep(self, seconds: float) -> None:
        """Let others work."""
        self.now += seconds
        time.sleep(seconds)


@dataclass(frozen=True)
class Board:
    """The program and the stand-in's faults, in this process."""

    program: Any  # its modules
    faults: Any
    capsys: pytest.CaptureFixture[str]

    def run(self, made: Made, *words: object, **faults: Any) -> Ended:
        """The program of a bundle, with faults."""
        self.program.run.__file__ = str(made.path / "program" / "run.py")
        self.faults.choose(**{"asked": ASKED, **faults})
        self.capsys.readouterr()
        code = self.program.run.main([str(word) for word in words])
        text = self.capsys.readouterr()
        return Ended(code, text.out, text.err)


def load_program(folder: Path) -> Any:
    """The modules of a program, by name."""
    modules = host_programs.load(folder)
    # In this process no watchdog may bite, and time is counted in looks at a channel, however slow the machine is.
    host_programs.set_everywhere(modules, PAUSE=0.0, time=Looks(), Watchdog=Unwatched)
    return modules


class Unwatched(contextlib.nullcontext[None]):
    """In place of the watchdog."""

    let_go = None

    def __init__(self, *_: object) -> None:
        super().__init__()


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Any:
    """See `Board`; NxSDK's stand-in is forgotten afterwards."""
    monkeypatch.syspath_prepend(str(STANDIN))
    monkeypatch.setenv("KAPOHOBAY", "1")
    monkeypatch.delenv("STANDIN", raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    handler = signal.getsignal(signal.SIGTERM)
    from nxsdk_standin.faults import FAULTS  # the stand-in is on the path only here

    yield Board(load_program(host_programs.flat("kapoho_bay", tmp_path / "program")), FAULTS, capsys)
    signal.signal(signal.SIGTERM, handler)
    for name in [name for name in sys.modules if name.split(".")[0] in ("nxsdk", "nxsdk_standin")]:
        del sys.modules[name]


def start(made: Made, *words: object, before: str = "", env: dict[str, str] | None = None, **faults: Any) -> Any:
    """The program as a child; ``before`` is Python that changes its modules first."""
    script = str(made.path / "program" / "run.py")
    command = [sys.executable, script]
    if before:
        modules = (
            "import os, sys; sys.path.insert(0, os.path.dirname(sys.argv[1])); import run, board_device, board_link"
        )
        code = f"{modules}; {before}"
        command = [sys.executable, "-c", f"{code}; sys.exit(run.main(sys.argv[2:]))", script]
    given = {
        **os.environ,
        **(SEEDS if env is None else env),
        "STANDIN": json.dumps({"asked": ASKED, **faults}),
        "TMPDIR": str(made.path.parent),
    }
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return children.Child(
        [*command, *map(str, words)],
        env=given,
        text=True,
        **pipes,
    )


def child(made: Made, *words: object, **given: Any) -> Ended:
    """`start`, and wait."""
    running = start(made, *words, **given)
    out, err = running.communicate(timeout=60)
    return Ended(running.returncode, out, err)


def edited(board: Board, made: Made, name: str, old: str, new: str) -> Board:
    """A board with the program of a bundle, in whose file ``name`` the text ``old`` is ``new``."""
    altered(made, f"program/{name}", lambda content: content.replace(old.encode(), new.encode()))
    return replace(board, program=load_program(made.path / "program"))


def altered(made: Made, name: str, change: Callable[[bytes], bytes]) -> None:
    """Change a file of a bundle and seal it again, as if it had been deployed so."""
    old = bundle.load(made.path)
    content = change(old.files[name])
    assert content != old.files[name]
    bundle.write(made.path, {k: old.manifest[k] for k in ("target", "network", "limits")}, {**old.files, name: content})
