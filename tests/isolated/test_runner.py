"""No failure inside Lava hangs, and none leaves a process, shared memory or a folder behind."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.common import children
from support.lava.lava_traces import Place

from lava_vpr.errors import LavaRunError, LavaVprError, NetworkLimitError
from lava_vpr.isolated import first_failure
from lava_vpr.isolated.runner import run_isolated

SOON = 10.0  # seconds from an event to the end
LONG = 240.0  # reached only when something hangs
ENDLESS = {"what": "none", "steps": 1_000_000}

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks at processes in /proc")


@pytest.fixture
def place(monkeypatch: pytest.MonkeyPatch) -> Iterator[Place]:
    """A place of its own with a short path, where nothing may be left."""
    root = Path(tempfile.mkdtemp(prefix="runner-"))
    monkeypatch.setattr(tempfile, "tempdir", str(root))
    here = Place(root)
    yield here
    try:
        assert here.left() == []
    finally:
        for pid in here.processes():
            os.kill(pid, signal.SIGKILL)
        shutil.rmtree(root)


def failed(place: Place, target: str, options: dict[str, Any], then: Callable[[], None] | None = None) -> LavaRunError:
    """The error of a run; the first time that it reports work, ``then`` is called, and it must end soon after that."""
    begin: list[float] = []

    def progress(done: int) -> None:
        if not begin:
            place.note()
            if then is not None:
                then()
            begin.append(time.monotonic())

    with pytest.raises(LavaRunError) as caught:
        run_isolated(target, {}, options, timeout=LONG, progress=progress)
    if begin:
        assert time.monotonic() - begin[0] < SOON
    assert place.left() == []
    assert "\n" not in str(caught.value)
    return caught.value


def kept(error: LavaRunError) -> str:
    """The text in the file that the error names, which its ``traceback`` repeats."""
    path = re.search(r": (/\S+\.txt)$", str(error))
    assert path is not None, str(error)
    text = Path(path[1]).read_text()
    assert text.strip() == error.traceback
    return text


def test_arrays_options_and_progress_go_through(place: Place) -> None:
    given = {
        "file": np.arange(6, dtype=np.uint64).reshape(2, 3) + 2**63,
        "a/b": np.array([True, False]),
        "empty": np.zeros((0, 4), np.float32),
        "number": np.array(-3),
        "text": np.array(["ä", "bc"]),
        "columns": np.asfortranarray(np.random.default_rng(0).random((3, 4))),
    }
    seen: list[int] = []
    options = {"reports": [3, 5], "name": "x", "nothing": None}
    got = run_isolated("support.lava.lava_targets:echo", given, options, timeout=LONG, progress=seen.append)
    assert sum(seen) == 8
    assert str(got.pop("options")) == repr(options)
    assert str(got.pop("folder")).startswith(f"{place.root}/lava-vpr-")
    assert got.keys() == given.keys()
    for name, array in given.items():
        assert got[name].dtype == array.dtype
        assert np.array_equal(got[name], array), name


def test_wrong_calls_are_refused(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match=r"'os.path' is not a target: write package.module:function"):
        run_isolated("os.path", {}, timeout=1)
    for seconds in (0, -1, float("nan")):
        with pytest.raises(ValueError, match="leaves no time: give more than 0"):
            run_isolated("support.lava.lava_targets:echo", {}, timeout=seconds)
    with pytest.raises(ValueError, match="Object arrays cannot be saved"):
        run_isolated("support.lava.lava_targets:echo", {"x": np.array([object()])}, timeout=1)
    monkeypatch.setattr(tempfile, "tempdir", str(place.root / "missing"))
    with pytest.raises(
        LavaRunError, match=r"no temporary folder can be made .*; set TMPDIR to one that can be written"
    ):
        run_isolated("support.lava.lava_targets:echo", {}, timeout=1)
    long = place.root / ("x" * 80)
    long.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(long))
    with pytest.raises(LavaRunError, match=r"x: too long a path for the sockets .*; set TMPDIR to a shorter one"):
        run_isolated("support.lava.lava_targets:echo", {}, timeout=1)
    long.rmdir()


@pytest.mark.lava
def test_a_run_of_lava(place: Place) -> None:
    """Its shared memory bears its name while it is there; Lava is not stopped."""
    seen: list[int] = []

    def progress(done: int) -> None:
        if not seen:
            place.go_on()
            assert len(place.shared()) > 4
        seen.append(done)

    options = {"what": "wait", "when": 30, "steps": 50, "stop": False}
    done = run_isolated("support.lava.lava_targets:act", {}, options, timeout=LONG, progress=progress)
    assert done == {"done": True}
    assert sum(seen) == 50


@pytest.mark.lava
def test_several_at_once(place: Place) -> None:
    """From threads, of which one fails."""
    ends: dict[str, object] = {}

    def run(what: str) -> None:
        try:
            ends[what] = run_isolated("support.lava.lava_targets:act", {}, {"what": what}, timeout=LONG)
        except LavaVprError as error:
            ends[what] = type(error)

    threads = [threading.Thread(target=run, args=(what,)) for what in ("none", "raise")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(LONG)
    assert ends == {"none": {"done": True}, "raise": LavaRunError}


@pytest.mark.quick(2)
@pytest.mark.lava
@pytest.mark.parametrize(
    ("what", "line", "more"),
    [
        ("raise", "failed in PyActor: ValueError: told to fail at models.py:", "told to\nfail"),
        ("exit", "failed in PyActor: SystemExit: 0 at models.py:", "sys.exit(0)"),
        ("crash", "the process of PyActor crashed (SIGSEGV); ", "models.py"),
        ("thread", "failed in thread side of SystemProcess-", "IndexError: list index out of range"),
    ],
)
def test_a_model_fails(place: Place, what: str, line: str, more: str) -> None:
    error = failed(place, "support.lava.lava_targets:act", {"what": what, "steps": 100_000})
    assert str(error).startswith("support.lava.lava_targets:act")
    assert line in str(error)
    assert more in kept(error)


@pytest.mark.parametrize(
    ("target", "what", "said"),
    [
        pytest.param("act", "gone", "the process of PyActor ended itself with exit code 7", marks=pytest.mark.lava),
        ("fail", "exit", "its process ended itself with exit code 0"),
    ],
)
def test_who_ends_without_a_word_is_told(place: Place, target: str, what: str, said: str) -> None:
    """A model, and the target."""
    error = failed(place, f"support.lava.lava_targets:{target}", {"what": what, "steps": 100_000})
    end = "and no result; let it raise an error or return"
    assert str(error) == f"support.lava.lava_targets:{target}: {said} {end}"


@pytest.mark.lava
def test_our_own_errors_stay_what_they_are(place: Place) -> None:
    """From a model, where Lava would hang, and from the target."""
    with pytest.raises(NetworkLimitError, match=r"^the model refuses; use a smaller one$"):
        run_isolated("support.lava.lava_targets:act", {}, {"what": "limit at start"}, timeout=LONG)
    with pytest.raises(NetworkLimitError, match=r"^too many\nneurons: take fewer$"):
        run_isolated("support.lava.lava_targets:fail", {}, {"what": "limit"}, timeout=LONG)


def test_a_failure_that_is_being_noted_is_waited_for(place: Place) -> None:
    """The end of the target is the end of whoever is noting it; of one that is killed over it, another is told."""
    for killed, noting, said in ((False, LONG, "the first"), (True, 0.2, "the second")):
        with pytest.raises(NetworkLimitError, match=f"^{said}$"):
            run_isolated(
                "support.lava.lava_targets:note_slowly", {}, {"killed": killed, "noting": noting}, timeout=LONG
            )


@pytest.mark.parametrize(
    ("target", "what", "line"),
    [
        ("support.lava.lava_targets:fail", "a", r"failed: KeyError: 'a' at lava_targets.py:\d+ in fail; traceback: "),
        ("support.lava.lava_targets:fail", "text", r"failed: ValueError: Object arrays cannot be saved "),
        (
            "support.lava.lava_targets:none",
            "",
            r"failed: AttributeError: module 'support.lava.lava_targets' has no attribute 'none' at worker.py",
        ),
        ("no_such_module:run", "", r"failed: ModuleNotFoundError: No module named 'no_such_module'"),
    ],
)
def test_the_target_fails(place: Place, target: str, what: str, line: str) -> None:
    error = failed(place, target, {"what": what})
    assert re.match(f"{target} {line}", str(error)), str(error)
    assert kept(error).startswith("Traceback")


@pytest.mark.lava
@pytest.mark.parametrize(
    ("target", "stands"),
    [("support.lava.lava_targets:act", "PyActor"), ("support.lava.lava_targets:fail", "the target")],
)
def test_it_takes_too_long(place: Place, target: str, stands: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A model sleeps for an hour; the runner's clock goes forward by as much."""
    late = [0.0]
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + late[0], sleep=time.sleep)
    monkeypatch.setattr(first_failure, "time", clock)
    options = {"what": "sleep", "when": 1}
    error = failed(place, target, options, lambda: late.__setitem__(0, 3600.0))
    said = (
        f"{target} did not end within 240 s and was stopped; allow more time or run less at once; where its processes"
    )
    assert str(error).startswith(said)
    text = kept(error)
    assert re.search(rf"Process \d+: {stands}\n", text)
    assert re.search(r"(models|lava_targets)\.py\", line \d+ in (act|run_spk|fail)", text)


@pytest.mark.quick(3)
@pytest.mark.lava
@pytest.mark.parametrize(
    ("who", "name", "number"),
    [
        ("PyActor", "the process of PyActor", signal.SIGKILL),
        ("LoihiPyRuntimeService", "the process of LoihiPyRuntimeService", signal.SIGKILL),
        ("SharedMemoryManager-1", "the process of SharedMemoryManager-1", signal.SIGKILL),
        ("the target", "its process", signal.SIGKILL),
        ("the keeper", "its process", signal.SIGKILL),
        ("the keeper", "its process", signal.SIGTERM),
    ],
)
def test_a_process_is_ended(place: Place, who: str, name: str, number: signal.Signals) -> None:
    error = failed(place, "support.lava.lava_targets:act", ENDLESS, lambda: os.kill(place.process(who), number))
    said = "if memory ran out, free some or run less at once; then run it again"
    assert str(error).startswith(f"support.lava.lava_targets:act: {name} was killed ({number.name}); {said}")


@pytest.mark.parametrize("session", [False, True])
def test_programs_that_it_started_are_ended(place: Place, session: bool) -> None:
    """Also one that has left its session; the system does not end these with who started them."""
    run_isolated(
        "support.lava.lava_targets:leave", {}, {"session": session}, timeout=LONG, progress=lambda done: place.go_on()
    )
    assert place.left() == []


def test_programs_are_ended_without_the_keeper(place: Place) -> None:
    options = {"session": False}
    failed(
        place, "support.lava.lava_targets:leave", options, lambda: os.kill(place.process("the keeper"), signal.SIGKILL)
    )


@pytest.mark.lava
def test_the_caller_gives_up(place: Place) -> None:
    def progress(done: int) -> None:
        place.note()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_isolated("support.lava.lava_targets:act", {}, ENDLESS, timeout=LONG, progress=progress)
    assert list(place.root.iterdir()) == []


CALLER = """
from lava_vpr.isolated.runner import run_isolated
def going(done):
    print("going", flush=True)
run_isolated("support.lava.lava_targets:act", {}, {"what": "none", "steps": 1_000_000}, timeout=600, progress=going)
"""


def start_caller(place: Place, going: bool = True) -> children.Child:
    """A process that calls `run_isolated`; ``going``: Lava runs in it."""
    paths = os.pathsep.join([str(Path(__file__).parents[1]), *filter(None, sys.path)])
    caller = children.Child(
        [sys.executable, "-c", CALLER],
        env={**os.environ, "TMPDIR": str(place.root), "PYTHONPATH": paths},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    if going:
        assert caller.stdout.readline() == "going\n"
        place.note()
    return caller


@pytest.mark.quick(1)
@pytest.mark.lava
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_the_caller_is_ended(place: Place, number: signal.Signals) -> None:
    caller = start_caller(place)
    assert place.shared()
    caller.send_signal(number)
    _, errors = caller.communicate(timeout=SOON)
    assert caller.returncode == -number
    assert ("KeyboardInterrupt" in errors) == (number == signal.SIGINT)
    assert children.until(lambda: place.left() == [], SOON), place.left()


@pytest.mark.lava
def test_the_caller_and_the_keeper_are_killed(place: Place) -> None:
    """Nobody is left to see to it; the system ends the rest, only the folder stays."""
    caller = start_caller(place)
    keeper = place.process("the keeper")
    os.kill(keeper, signal.SIGSTOP)
    caller.kill()
    caller.communicate(timeout=SOON)
    os.kill(keeper, signal.SIGKILL)
    assert children.until(lambda: not place.processes() and not place.shared(), SOON), place.left()
    (folder,) = place.names
    shutil.rmtree(place.root / folder)


@pytest.mark.lava
@pytest.mark.slow
def test_the_caller_is_killed_at_any_moment(place: Place) -> None:
    """From its own start on to that of Lava."""
    for delay in np.linspace(0.05, 2.0, 40):
        caller = start_caller(place, going=False)
        time.sleep(delay)
        place.sessions |= set(place.processes().values())
        place.names |= {path.name for path in place.root.glob("lava-vpr-*")}
        caller.kill()
        caller.communicate(timeout=SOON)
        assert children.until(lambda: not place.processes() and not place.shared(), SOON), place.left()
        for path in place.root.glob("lava-vpr-*"):
            # Between the making of the folder and the start of the worker nobody can remove it.
            assert {inner.name for inner in path.iterdir()} <= {"log", "progress"}
            shutil.rmtree(path)
    assert place.sessions
    assert place.names


@pytest.mark.lava
@pytest.mark.slow
def test_two_hundred_networks(place: Place) -> None:
    """Created, run and stopped in one process, one after the other."""
    got = run_isolated("support.lava.lava_targets:cycles", {}, {"cycles": 200}, timeout=1200)
    resident, children, shared, files, threads = got["held"].T
    growth = (resident[-1] - resident[5]) / 1e6
    print(f"200 networks: {got['seconds'].mean():.2f} s each, {growth:.1f} MB more from the 6th to the last")
    assert growth < 20
    assert not children.any()
    assert not shared.any()
    assert (files < files[5] + 10).all()
    assert (threads < threads[5] + 10).all()
