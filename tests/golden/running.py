"""Runs cases, each in a process and a folder of its own, and keeps what each gives.

The process is a copy (fork) of one that has imported lava-vpr, so it starts at once and nothing of one case is left for
another; it runs `lava_vpr.__main__.run`, as the program does, its streams connected to files. Or it is a real one.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import shlex
import shutil
import signal
import sys
import tempfile
import textwrap
import time
import traceback
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import numpy as np

from golden import calls
from golden.inputs import INPUTS, Changed
from golden.table import IMAGES, Case, made

ROOT = Path(__file__).resolve().parents[2]
WRITTEN = 1_717_200_000  # when inputs were written, in seconds since 1970
LIMIT = 300  # seconds that a case may take
KEPT_VARIABLES = ("PATH", "HOME", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES")
SET_VARIABLES = {"TZ": "UTC", "LC_ALL": "C.UTF-8", "MPLBACKEND": "Agg"}


def ready() -> Path | None:
    """Make this process one whose copies run cases; returns the folder with real images, if there is one."""
    data = Path(os.environ.get("LAVA_VPR_DATA", "")) / "data"
    real = data.resolve() if "LAVA_VPR_DATA" in os.environ and data.is_dir() else None
    kept = {name: os.environ[name] for name in KEPT_VARIABLES if name in os.environ}
    os.environ.clear()
    os.environ.update(kept | SET_VARIABLES)
    time.tzset()
    os.umask(0o022)
    from lava_vpr.cli import COMMANDS

    for name in ("lava_vpr.__main__", "lava_vpr.localizer", *(row[0] for row in COMMANDS.values())):
        importlib.import_module(name)
    return real


def with_needs(chosen: Collection[Case]) -> list[Case]:
    """Some cases and all that they start from, these first."""
    found: dict[Case, None] = {}
    for case in chosen:
        found.update(dict.fromkeys([*with_needs([made()[name] for name in case.needs]), case]))
    return list(found)


def run_all(
    chosen: Collection[Case], out: Path, jobs: int, data: Path | None, apart: bool, told: Callable[[str], None]
) -> None:
    """Run cases and what they need, ``jobs`` at a time; what each gives goes to ``out / case.key``.

    Args:
        chosen: The cases.
        out: A new or empty folder.
        jobs: Processes at a time.
        data: The folder with real images.
        apart: Whether each command is run in a process of its own.
        told: Is told of each case that it is done.
    """
    waiting, running, done = with_needs(chosen), dict[int, tuple[Case, Work]](), set[str]()
    total = len(waiting)
    while waiting or running:
        able = (case for case in waiting if {made()[name].key for name in case.needs} <= done)
        case = next(able, None) if len(running) < jobs else None
        if case is not None:
            waiting.remove(case)
            work = Work(case, out, data)
            running[work.start(apart)] = case, work
            continue
        number, status = os.waitpid(-1, 0)  # an alarm ends each
        case, work = running.pop(number)
        work.keep(os.waitstatus_to_exitcode(status))
        done.add(case.key)
        told(f"{len(done)} of {total}: {case.key}")


class Work:
    """The folder in which a case runs, ``here``, and the one that keeps what it gives, ``kept``."""

    def __init__(self, case: Case, out: Path, data: Path | None) -> None:
        self.case, self.data, self.kept = case, data, out / case.key
        self.here = Path(tempfile.mkdtemp(prefix="golden-")) / "w"
        self.here.mkdir()
        self.kept.mkdir(parents=True)
        for name in case.needs:
            shutil.copytree(out / made()[name].key / "files", self.here, dirs_exist_ok=True)
        for name in reversed(case.inputs):
            put(self.here / name, INPUTS[name], self.here)
        if data is not None and IMAGES in case.wants:
            (self.here / "data").symlink_to(data)
        for path in self.here.rglob("*"):
            os.utime(path, (WRITTEN, WRITTEN), follow_symlinks=False)
        self.before, self.began = self.stand(), time.monotonic()

    def stand(self) -> dict[str, tuple[int, ...]]:
        """Every file, and what changes if it is written."""
        paths = (path for path in self.here.rglob("*") if path.is_file() and not path.is_symlink())
        stands = ((path, path.stat()) for path in paths)
        return {str(path.relative_to(self.here)): (at.st_ino, at.st_mtime_ns, at.st_size) for path, at in stands}

    def start(self, apart: bool) -> int:
        """Start the case; the number of its process."""
        sys.stdout.flush()
        sys.stderr.flush()
        number = os.fork()
        if number == 0:
            try:
                signal.alarm(LIMIT)
                os.chdir(self.here)
                self.connect()
                self.run(apart)
                code: object = 0
            except SystemExit as ending:
                code = ending.code
            except BaseException:
                traceback.print_exc()
                code = 70
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(code if isinstance(code, int) else int(code is not None))
        return number

    def connect(self) -> None:
        """Connect this process's streams to files."""
        found = re.search(r"< (\S+)$", self.case.command)
        files = [(found[1] if found else os.devnull, os.O_RDONLY)]
        files += [(str(self.kept / name), os.O_WRONLY | os.O_CREAT) for name in ("stdout", "stderr")]
        for number, (name, how) in enumerate(files):
            os.dup2(os.open(name, how, 0o644), number)

    def run(self, apart: bool) -> None:
        """Run the case in this process, and end it."""
        os.environ["TMPDIR"] = tempfile.tempdir = str(self.here.parent)
        if self.case.command.startswith(">>>"):
            sys.exit(calls.run(textwrap.dedent(self.case.command.removeprefix(">>>")).strip()))
        words = shlex.split(re.sub(r"< \S+$", "", self.case.command).replace("<project>", str(ROOT)), comments=True)
        while words and re.match(r"[A-Z_]+=", words[0]):
            os.environ.update([words.pop(0).split("=", 1)])
        if words[:1] == ["$"]:
            program = {"python": ()}.get(words[1], ("-m", "lava_vpr"))
            os.execv(sys.executable, [sys.executable, *program, *words[2:]])
        if apart:
            os.execv(sys.executable, [sys.executable, "-m", "lava_vpr", *words])
        from lava_vpr.__main__ import run

        sys.argv = ["lava-vpr", *words]
        run()

    def keep(self, code: int) -> None:
        """Keep what the process has written and how it ended; files that are as they were do not stay."""
        after = self.stand()
        lost = sorted(set(self.before) - set(after))
        for name, at in after.items():
            if self.before.get(name) == at:
                (self.here / name).unlink()
        (self.here / "data").unlink(missing_ok=True)
        for folder in sorted((path for path in self.here.rglob("*") if path.is_dir()), reverse=True):
            if not any(folder.iterdir()) and any(
                name.startswith(f"{folder.relative_to(self.here)}/") for name in self.before
            ):
                folder.rmdir()
        left = sorted(path.name for path in self.here.parent.iterdir() if path != self.here)
        for stream in ("stdout", "stderr"):
            (self.kept / stream).write_text(self.placeless(self.kept / stream), encoding="utf-8")
        shutil.move(self.here, self.kept / "files")
        shutil.rmtree(self.here.parent)
        ended = {"command": self.case.command, "code": code}
        ended |= {name: value for name, value in (("lost", lost), ("left behind", left)) if value}
        (self.kept / "seconds").write_text(f"{time.monotonic() - self.began:.2f}\n")
        (self.kept / "case.json").write_text(json.dumps(ended, indent=1, ensure_ascii=False), encoding="utf-8")

    def placeless(self, stream: Path) -> str:
        """What a stream says, without the places of this machine."""
        text = stream.read_text(encoding="utf-8", errors="backslashreplace")
        places: Sequence[tuple[object, str]] = (
            (self.here, "<work>"),
            (self.here.parent, "<temporary>"),
            (self.data or "<data>", "<data>"),
            (sys.executable, "<python>"),
            (ROOT, "<project>"),
        )
        for place, name in places:
            text = text.replace(str(place), name)
        return text


def put(path: Path, value: object, root: Path) -> None:
    """Write an input: text, bytes, an array, a folder of such, or a changed copy of what is there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(value, Changed):
        source = root / value.source
        if source.is_dir():
            shutil.copytree(source, path)
        for name, change in value.changes.items():
            old = source / name if name else source
            new = path / name if name else path
            made_of = change(old.read_bytes()) if callable(change) else change
            if new.exists():
                shutil.rmtree(new) if new.is_dir() else new.unlink()
            if made_of is not None:
                put(new, made_of, root)
    elif isinstance(value, dict):
        path.mkdir(exist_ok=True)
        for name, part in value.items():
            put(path / name, part, root)
    elif isinstance(value, np.ndarray):
        with path.open("wb") as file:
            np.save(file, value)
    elif isinstance(value, bytes):
        path.write_bytes(value)
    else:
        path.write_text(str(value), encoding="utf-8")
