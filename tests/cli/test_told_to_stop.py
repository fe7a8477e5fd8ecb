"""The real command, told to stop: early and late, once and twice, where nothing can be raised.

Whatever the moment, it leaves nothing behind, shows no traceback, and its exit code says what it was told by.
"""

from __future__ import annotations

import shutil
import signal
import sys
import time
from collections import Counter
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.common import surroundings
from support.common.eventfiles import damage
from support.common.surroundings import AT_IMPORT, QUERY, done

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
EACH = (signal.SIGINT, signal.SIGTERM, pytest.param(signal.SIGHUP, marks=pytest.mark.slow))

# The command line, but the signal comes in the middle of a kernel's compilation, twice, where nothing can be raised;
# and what it has to say takes its time.
AT_COMPILATION = """
import os, sys, time
import click.core
number, echo = int(sys.argv.pop(1)), click.core.echo
def slow(*what, **how):
    time.sleep(0.2)
    echo(*what, **how)
click.core.echo = slow
from numba.core import dispatcher
whole = dispatcher.Dispatcher.compile
class Lost:
    def __del__(self):
        os.kill(os.getpid(), number)
        print(end="")
def compile(self, *what):
    for _ in range(2):
        Lost()
    return whole(self, *what)
dispatcher.Dispatcher.compile = compile
from lava_vpr.__main__ import run
run()
"""

# The same, but the signal comes when the function argv[3] of the module argv[2] has done its work for the first time.
AT_RETURN = """
import importlib, os, sys
number, module, name = int(sys.argv.pop(1)), importlib.import_module(sys.argv.pop(1)), sys.argv.pop(1)
whole = getattr(module, name)
def told(*words, **options):
    setattr(module, name, whole)
    result = whole(*words, **options)
    os.kill(os.getpid(), number)
    return result
setattr(module, name, told)
from lava_vpr.__main__ import run
run()
"""


# The same, but the signal comes when its temporary folder is about to be removed, and nothing holds it back yet.
AT_REMOVAL = """
import os, sys
number = int(sys.argv.pop(1))
from lava_vpr.storage import writing
held = writing.held
def told():
    if writing.standing:
        writing.held = held
        os.kill(os.getpid(), number)
    return held()
writing.held = told
from lava_vpr.__main__ import run
run()
"""

# The signal comes while subprocess has the lock of a program that it waits for, and has not yet minded that it has.
IN_THE_LOCK = """
import os, subprocess, sys
number, wait = int(sys.argv.pop(1)), subprocess.Popen._wait
def told(child, timeout):
    if not interrupts.begun():  # what is loaded may start a program, too, and a signal then ends all at once
        return wait(child, timeout)
    subprocess.Popen._wait = wait
    child._waitpid_lock.acquire()
    os.kill(os.getpid(), number)
    child._waitpid_lock.release()
    return wait(child, timeout)
subprocess.Popen._wait = told
from lava_vpr import interrupts
from lava_vpr.__main__ import run
run()
"""

# The program argv[2:], told to stop by SIGHUP after argv[1] seconds, and again by all three signals, close together.
TWICE = """
import signal, subprocess, sys, time
child = subprocess.Popen(sys.argv[2:])
time.sleep(float(sys.argv[1]))
for number in (signal.SIGHUP, signal.SIGHUP, signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
    child.send_signal(number)
    time.sleep(0.02)
sys.exit(child.wait() not in (0, 1, -signal.SIGHUP, -signal.SIGTERM))
"""

# The command line, but a signal comes while a class is made, in the midst of the work.
IN_A_CLASS = """
import os, sys
number = int(sys.argv.pop(1))
class Named:
    def __set_name__(self, *owner):
        os.kill(os.getpid(), number)
class Finder:
    def find_spec(self, wanted, *rest):
        if wanted == "lava_vpr.report.html":
            sys.meta_path.remove(self)
            type("Owner", (), {"name": Named()})
sys.meta_path.insert(0, Finder())
from lava_vpr.__main__ import run
run()
"""

# The command line, but a signal comes within a library that does not return: of a damaged file that is not refused.
IN_A_LIBRARY = """
import os, sys, threading
number = int(sys.argv.pop(1))
from lava_vpr.storage import hdf5
hdf5._check_heaps = lambda data: threading.Timer(0.5, os.kill, (os.getpid(), number)).start()
from lava_vpr.__main__ import run
run()
"""

# The command line, but a signal comes when its work is over, and it minds those that came before.
AT_FINISH = """
import os, sys
from lava_vpr import interrupts
number, finish = int(sys.argv.pop(1)), interrupts.finish
def late():
    os.kill(os.getpid(), number)
    finish()
interrupts.finish = late
from lava_vpr.__main__ import run
run()
"""

# The command line, but a signal comes while the interpreter is taken apart.
AT_THE_END = """
import os, sys
class Last:
    def __del__(self, kill=os.kill, process=os.getpid(), number=int(sys.argv.pop(1))):
        kill(process, number)
last = Last()
from lava_vpr.__main__ import run
run()
"""


def taken_away(folder: Path, names: list[str]) -> dict[str, set[str]]:
    """Removes the entries ``names`` of ``folder``; returns for each the names of the files that it is or holds."""
    found = {}
    for name in names:
        entry = folder / name
        within = [file for file in entry.rglob("*") if file.is_file()]
        found[name] = {str(file.relative_to(folder)) for file in within} or {name}
        shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
    return found


@pytest.mark.parametrize(
    ("number", "module"),
    [
        (signal.SIGINT, "click"),
        (signal.SIGINT, "numba._devicearray"),
        (signal.SIGTERM, "numba"),
        (signal.SIGHUP, "cv2"),
    ],
)
def test_told_to_stop_while_it_loads(here: Path, number: int, module: str) -> None:
    """Nothing is begun: it ends at once. Machine code looks for numba's array type, and makes any exception another."""
    program = [sys.executable, "-c", AT_IMPORT, str(int(number)), module]
    ended = surroundings.run(here, *QUERY, "q.csv", program=program)
    assert (ended.code, ended.err) == ((1, "\nAborted!\n") if number == signal.SIGINT else (-number, ""))
    assert not ended.made
    assert not ended.left


def test_nohup(here: Path) -> None:
    """A signal that was ignored when the program began stays ignored."""
    program = [sys.executable, "-c", AT_IMPORT, str(int(signal.SIGHUP)), "click"]
    done(surroundings.run(here, "--version", program=program, ignored=[signal.SIGHUP]))


def test_told_to_stop_where_nothing_can_be_raised(here: Path) -> None:
    """An exception is lost in a destructor, which numba has many of; the signal is not."""
    program = [sys.executable, "-c", AT_COMPILATION, str(int(signal.SIGINT))]
    ended = surroundings.run(here, *QUERY, "q.csv", program=program)
    assert (ended.code, ended.err, ended.left) == (1, "\nAborted!\n", [])


MAKING = (
    (signal.SIGTERM, "tempfile.mkdtemp", ("synth", "route", "--places", "2")),
    (signal.SIGHUP, "tempfile.mkdtemp", (*QUERY, "q.csv", "--backend", "bundle")),
    (signal.SIGTERM, "tempfile.mkdtemp", ("deploy", "m.lvpr", "--target", "loihi2", "-o", "bundle")),
    (signal.SIGTERM, "fcntl.flock", ("train", "reference", "-o", "n.lvpr", "--config", "quick.toml")),
)


@pytest.mark.quick(2)
@pytest.mark.parametrize(("number", "function", "words"), MAKING, ids=[f"{n.name}-{w[0]}" for n, _, w in MAKING])
def test_told_to_stop_when_something_was_made(
    here: Path, number: signal.Signals, function: str, words: tuple[str, ...]
) -> None:
    """A temporary folder or a lock is there, and hardly known: it is removed."""
    program = [sys.executable, "-c", AT_RETURN, str(int(number)), *function.split(".")]
    ended = surroundings.run(here, *words, program=program)
    assert (ended.code, ended.err, ended.left, ended.made) == (-number, "\nAborted!\n", [], [])


@pytest.mark.quick(1)
@pytest.mark.parametrize("number", EACH)
def test_told_to_stop_when_its_folder_is_about_to_go(here: Path, number: int) -> None:
    program = [sys.executable, "-c", AT_REMOVAL, str(int(number))]
    ended = surroundings.run(here, *QUERY, "q.csv", "--backend", "bundle", program=program)
    assert (ended.code, ended.err) == (1 if number == signal.SIGINT else -number, "\nAborted!\n")
    assert (ended.left, ended.made) == ([], [])


@pytest.mark.slow
def test_told_to_stop_between_the_notes_and_the_table(here: Path) -> None:
    """The bundle is written and its notes are told: it stays, whole, and one line says that the table is missing."""
    words = ("deploy", "m.lvpr", "--target", "loihi2", "-o", "bundle")
    whole = surroundings.run(here, *words)
    files = taken_away(here, whole.made)
    told = (str(int(signal.SIGTERM)), "lava_vpr.deploy.show.tables", "core_table")
    ended = surroundings.run(here, *words, program=[sys.executable, "-c", AT_RETURN, *told])
    assert whole.lines
    assert (ended.code, ended.out, ended.err, ended.left) == (-signal.SIGTERM, "", f"{whole.err}\nAborted!\n", [])
    assert taken_away(here, ended.made) == files


def test_told_to_stop_while_it_waits_for_another_program(here: Path) -> None:
    """An exception at the wrong moment would leave the lock taken for ever, and whoever ends that program waiting."""
    program = [sys.executable, "-c", IN_THE_LOCK, str(int(signal.SIGTERM))]
    ended = surroundings.run(here, "bench", "m.lvpr", "query", "--backend", "host", "--limit", "2", program=program)
    assert (ended.code, ended.err, ended.left, ended.made) == (-signal.SIGTERM, "\nAborted!\n", [], [])


@pytest.mark.quick(1)
@pytest.mark.parametrize("number", EACH)
def test_told_to_stop_where_another_exception_is_raised_instead(here: Path, number: int) -> None:
    """Python says of a class that could not be made why, as a RuntimeError; the signal was why."""
    program = [sys.executable, "-c", IN_A_CLASS, str(int(number))]
    ended = surroundings.run(here, "eval", "m.lvpr", "query", "--report", "r", program=program)
    assert (ended.code, ended.err) == (1 if number == signal.SIGINT else -number, "\nAborted!\n")
    assert not ended.made
    assert not ended.left


@pytest.mark.quick(1)
@pytest.mark.parametrize("number", EACH)
def test_told_to_stop_when_its_work_is_over(here: Path, number: int) -> None:
    program = [sys.executable, "-c", AT_FINISH, str(int(number))]
    ended = surroundings.run(here, *QUERY, "q.csv", program=program)
    assert (ended.code, ended.err) == ((1, "\nAborted!\n") if number == signal.SIGINT else (-number, ""))
    assert ended.made == ["q.csv"]
    assert not ended.left


def test_told_again_when_its_work_is_over(here: Path) -> None:
    """What was told is not told twice."""
    late = IN_A_CLASS.replace("from lava_vpr.__main__ import run\nrun()\n", AT_FINISH)
    program = [sys.executable, "-c", late, *[str(int(signal.SIGINT))] * 2]
    ended = surroundings.run(here, "eval", "m.lvpr", "query", "--report", "r", program=program)
    assert (ended.code, ended.err, ended.made, ended.left) == (1, "\nAborted!\n", [], [])


@pytest.mark.quick(1)
@pytest.mark.parametrize("number", EACH)
def test_told_to_stop_when_all_is_done(here: Path, number: int) -> None:
    """What is done is called done: the process ends before it takes anything apart."""
    program = [sys.executable, "-c", AT_THE_END, str(int(number))]
    done(surroundings.run(here, *QUERY, "q.csv", program=program), "q.csv")


FEW = ("--limit", "1", "--backend", "lava-fixed", "--backend", "bundle")
"""A query to Lava's processes and to a bundle in a temporary folder: the other backends start nothing else."""
STOPPED = (
    (*QUERY, "q.csv"),
    ("eval", "m.lvpr", "query", "--report", "r"),
    ("train", "reference", "-o", "n.lvpr", "--config", "quick.toml", "--epochs", "200"),
    ("synth", "route"),
    ("deploy", "m.lvpr", "--target", "loihi2", "-o", "bundle"),
    ("bench", "m.lvpr", "query", "--json", "b.json", *FEW),
    ("verify", "m.lvpr", "query", *FEW),
)


@pytest.mark.slow
@pytest.mark.parametrize("words", STOPPED, ids=[words[0] for words in STOPPED])
def test_told_to_stop_whenever(here: Path, words: tuple[str, ...]) -> None:
    """Each signal, early and late: no traceback, nothing left, and the exit code says what it was.

    An output that stands there already, when only figures were still to be printed, is all there; notes on it may have
    been told by then, as a run tells them that goes through.
    """
    began = time.monotonic()
    whole = surroundings.run(here, *words)
    seconds = time.monotonic() - began
    assert whole.code == 0, whole.err
    assert not whole.left
    files = taken_away(here, whole.made)
    counts: Counter[tuple[str, int]] = Counter()
    for k in range(24):
        number = SIGNALS[k % 3]
        ended = surroundings.run(here, *words, stop=(number, seconds * k / 24))
        counts[signal.Signals(number).name, ended.code] += 1
        assert ended.code in (0, 1 if number == signal.SIGINT else -number), ended
        assert "Traceback" not in ended.err, ended.err
        assert "ignored" not in ended.err, ended.err
        assert not ended.left
        if ended.code:
            assert set(ended.made) <= {*whole.made, "n.lvpr.checkpoint"}, ended
            told = [line for line in ended.lines if line not in whole.lines]  # beside notes on what it had done
            assert len(told) <= 1 + ("n.lvpr.checkpoint" in ended.made), ended.err  # and where the progress is kept
        for name, found in taken_away(here, ended.made).items():
            assert found == files.get(name, {name}), ended
    print(words[0], f"{seconds:.1f} s", *(f"{name} {code}: {n}" for (name, code), n in sorted(counts.items())))
    assert len(counts) > 3 or set(code for _, code in counts) != {0}


@pytest.mark.slow
def test_told_twice(here: Path) -> None:
    """A second signal while the first is being minded: as when a terminal is closed."""
    for seconds in (4.0, 6.0, 8.0):
        words = [sys.executable, "-m", "lava_vpr", "bench", "m.lvpr", "query"]
        ended = surroundings.run(here, program=[sys.executable, "-c", TWICE, str(seconds), *words])
        assert ended.code == 0, ended
        assert "Traceback" not in ended.err
        assert not ended.left


@pytest.mark.quick(1)
@pytest.mark.parametrize("number", EACH)
def test_within_a_library_that_does_not_return(here: Path, number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surroundings, "DEADLINE", 60.0)
    with h5py.File("v.h5", "w") as file:
        file["descriptors"], file["names"] = np.eye(6), list("abcdef")
    damage(Path("v.h5"), 6, 0)
    program = [sys.executable, "-c", IN_A_LIBRARY, str(int(number))]
    ended = surroundings.run(here, "train", "v.h5", "-o", "v.lvpr", program=program)
    assert (ended.code, ended.err) == (1 if number == signal.SIGINT else -number, "\nAborted!\n")
    assert (ended.left, ended.made) == ([], [])
