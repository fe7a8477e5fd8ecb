"""Kapoho Bay when things go wrong: what was answered is kept and right, nothing is invented, one line says why."""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.boards.host_programs import Made, answers, write_queries
from support.boards.kapoho_board import (
    ASKED,
    SEEDS,
    STANDIN,
    Board,
    altered,
    child,
    layout,
    make,
    random_network,
    start,
)

from lava_vpr.deploy.bundle import board_program
from lava_vpr.deploy.bundle.folder import load
from lava_vpr.errors import BackendUnavailableError, BundleError, LavaRunError, NetworkLimitError

pytestmark = pytest.mark.slow  # half a minute of starting programs; CI runs them

BATCH = 2


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A bundle with injected spikes on two chips; never written to."""
    return make(tmp_path_factory.mktemp("made"), layout("two chips", random_network(steps=24)), images=6)


@pytest.fixture(scope="module")
def bias(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """The same with inputs that integrate a bias."""
    return make(
        tmp_path_factory.mktemp("bias"),
        layout("one core", random_network(steps=24, regular=True, bias_input=True)),
        images=6,
    )


def words(made: Made, folder: Path) -> tuple[object, ...]:
    """Present its references, two in a run of the board."""
    queries = write_queries(folder / "q", made.rates, made.keys)
    return ("--queries", queries, "--out", folder / "r", "--batch", BATCH)


def check_kept(made: Made, folder: Path, answered: int, error: str = "") -> None:
    """Exactly the first ``answered`` queries are answered, and rightly."""
    counts, done, status = answers(folder / "r")
    assert done.tolist() == [i < answered for i in range(6)]
    assert np.array_equal(counts[done], made.counts[done])
    assert (counts[~done] == -1).all()
    assert status["done"] == answered
    assert (status["error"] or "") in error


def said_more(folder: Path) -> str:
    """The vendor's traceback, if there is one."""
    file = folder / "r" / "failure.txt"
    return file.read_text() if file.exists() else ""


# Packets to chip 0: BEGIN, 24 steps of each query. From chip 0: READY and a COUNTS for each query. The host
# reads as many from chip 1.
PACKETS = 1 + BATCH * 24
FAULTS: dict[str, tuple[dict[str, int], int, str]] = {
    "first packet lost": ({"lose": 0}, 0, "the chip does not answer in time"),
    "spikes lost": ({"lose": PACKETS + 30}, 3, "query 3, chip 0: the chip does not answer in time"),
    "begin damaged": ({"damage": PACKETS}, 2, "a packet came with checksum"),
    "spikes damaged": ({"damage": 1 + 30}, 1, "query 1, chip 0: in step 6 a packet came with checksum"),
    "spikes twice": ({"repeat": 1 + 10}, 0, "query 0, chip 0: in step 11 a packet came with number 10 instead of 11"),
    "another query": ({"wrong_query": 2}, 1, "the chip sent"),
    "gone at once": ({"vanish_after": 1}, 0, "queries 0 to 1: the board failed (OSError: [Errno 19] No such device)"),
    "gone at query 2": ({"vanish_after": 9}, 2, "queries 2 to 3: the board failed (OSError: [Errno 19]"),
    "gone in query 5": ({"vanish_after": 17}, 5, "queries 4 to 5: the board failed (OSError"),
    "silent": ({"silent_after": 5}, 1, "query 1, chip 1: the chip does not answer in time"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_was_answered_is_kept(board: Board, made: Made, tmp_path: Path, name: str) -> None:
    faults, answered, said = FAULTS[name]
    ended = board.run(made, *words(made, tmp_path), "--timeout", 0.5, **faults, log=str(tmp_path / "log"))
    assert ended.code == 1
    assert said in ended.err, ended.err
    assert f"({answered} of 6 queries answered)" in ended.err
    assert len(ended.err.splitlines()) == 1
    assert ("Traceback" in said_more(tmp_path)) == ("OSError" in ended.err)
    check_kept(made, tmp_path, answered, ended.err)
    assert (tmp_path / "log").read_text().endswith("disconnect\n")


@pytest.mark.parametrize(("packet", "answered"), [(1, 0), (4, 1), (6, 2)])
def test_damaged_settings(board: Board, bias: Made, tmp_path: Path, packet: int, answered: int) -> None:
    ended = board.run(bias, *words(bias, tmp_path), damage=packet)
    assert f"query {answered}, chip 0: in step 0 a packet came with checksum" in ended.err
    check_kept(bias, tmp_path, answered, ended.err)


def test_a_device_that_starts_at_the_third_attempt(board: Board, made: Made, tmp_path: Path) -> None:
    log = tmp_path / "log"
    assert board.run(made, *words(made, tmp_path), start_fails=2, log=str(log)).code == 0
    assert log.read_text().split().count("start") == 3
    check_kept(made, tmp_path, 6)


def test_a_device_that_does_not_start(board: Board, made: Made, tmp_path: Path) -> None:
    ended = board.run(made, *words(made, tmp_path), start_fails=3)
    assert ended.code == 1
    assert ended.err.startswith("the board did not start in 3 attempts (ConnectionError: no board answers); see that ")
    assert answers(tmp_path / "r")[2]["stage"] == "start"
    check_kept(made, tmp_path, 0, ended.err)


def test_a_run_that_never_finishes(made: Made, tmp_path: Path) -> None:
    log = tmp_path / "log"
    quick = "run.GRACE = 0.3"
    ended = child(made, *words(made, tmp_path), "--timeout", 3, before=quick, never_finishes=True, log=str(log))
    assert (ended.code, ended.out) == (1, "")
    assert ended.err == "queries 0 to 1: the board did not finish within 3 s (2 of 6 queries answered)\n"
    check_kept(made, tmp_path, 2, ended.err)
    assert log.read_text().split("\n")[-2] == "disconnect"


def test_a_start_that_never_returns(made: Made, tmp_path: Path) -> None:
    quick = "board_device.START_SECONDS = board_device.GRACE = 0.3"
    ended = child(made, *words(made, tmp_path), before=quick, start_hangs=True)
    assert ended.code == 1
    assert ended.err == "the board did not start within 0.3 s (0 of 6 queries answered)\n"
    check_kept(made, tmp_path, 0, ended.err)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted(made: Made, tmp_path: Path, number: int) -> None:
    log = tmp_path / "log"
    running = start(made, *words(made, tmp_path), "--timeout", 60, silent_after=7, log=str(log))
    while not log.exists() or log.read_text().count("run ") < 2:  # in the second run the chips say nothing more
        assert running.poll() is None
        time.sleep(0.01)
    os.kill(running.pid, number)
    out, err = running.communicate(timeout=30)
    assert (running.returncode, out) == (1, "")
    assert err == "interrupted (2 of 6 queries answered)\n"
    check_kept(made, tmp_path, 2, err)
    assert log.read_text().endswith("disconnect\n")


def test_without_nxsdk(made: Made, tmp_path: Path) -> None:
    ended = child(made, *words(made, tmp_path), env={**SEEDS, "PYTHONPATH": ""})
    assert ended.code == 1
    assert ended.err == (
        f"{sys.executable} has no nxsdk; it is Intel's closed package, from its neuromorphic research community; use a "
        "Python that has it\n"
    )
    assert answers(tmp_path / "r")[2]["stage"] == "missing"


@pytest.mark.parametrize("version", ["0.8.7", "1.1.0", "2.0", "unknown"])
def test_another_version(board: Board, made: Made, monkeypatch: pytest.MonkeyPatch, version: str) -> None:
    import nxsdk  # the stand-in

    monkeypatch.setattr(nxsdk, "__version__", version)
    ended = board.run(made, "--self-test")
    assert ended.code == 1
    assert ended.err.startswith(f"nxsdk {version} is installed, 0.9 to 1.0 is needed; ")


def test_no_board_is_announced(board: Board, made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("KAPOHOBAY")
    ended = board.run(made, "--self-test")
    assert ended.code == 1
    assert ended.err.startswith(
        "KAPOHOBAY is not set, so NxSDK would look for another board; connect Kapoho Bay (lsusb"
    )


def test_more_spikes_than_the_host_can_send(board: Board, tmp_path: Path) -> None:
    made = make(tmp_path, layout("one core", random_network(steps=24, inputs=60)), images=6)
    made.rates[4] = 65535
    log = tmp_path / "log"
    ended = board.run(made, *words(made, tmp_path), log=str(log))
    assert ended.code == 1
    assert ended.err == (
        "query 4: 60 inputs spike in one step, but the host sends a chip at most 56; lower encoder.query_spikes or "
        "deploy with --input-mode bias\n"
    )
    assert not log.exists()
    check_kept(made, tmp_path, 0, ended.err)


DAMAGE: dict[str, tuple[str, Any, str]] = {
    "a byte": ("cores/chip0-core000/synapses.npy", lambda data: data[:-1] + bytes([data[-1] ^ 1]), "was altered"),
    "its own": ("program/run.py", lambda data: data + b"#", "was altered"),
    "the chips' program": ("program/embedded.c", lambda data: data + b"\n", "was altered"),
    "the manifest": ("manifest.json", lambda data: data.replace(b'"steps": 24', b'"steps": 25'), "was altered"),
    "no manifest": ("manifest.json", lambda data: b"{}", "is not a bundle's manifest"),
    "missing": ("host/exc.npy", None, "cannot be read (No such file or directory)"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_an_altered_bundle(board: Board, tmp_path: Path, name: str) -> None:
    made = make(tmp_path, layout("one core", random_network(steps=24)), images=6)
    given = words(made, tmp_path)
    assert board.run(made, *given).code == 0
    file, change, said = DAMAGE[name]
    path = made.path / file
    if change is None:
        path.unlink()
    else:
        path.write_bytes(change(path.read_bytes()))
    ended = board.run(made, *given)
    assert ended.code == 1
    assert ended.err.startswith(f"{path}: {said}"), ended.err
    assert len(ended.err.splitlines()) == 1
    counts, done, status = answers(tmp_path / "r")  # those of before are gone
    assert (counts.size, done.size, status["done"], status["stage"]) == (0, 0, 0, "bundle")


@pytest.mark.parametrize("left", [None, b"import board_link\n"])
def test_a_program_that_lacks_a_part(tmp_path: Path, left: bytes | None) -> None:
    made = make(tmp_path, layout("one core", random_network(steps=24)), images=2)
    part = made.path / "program" / "board_network.py"
    part.unlink() if left is None else part.write_bytes(left)
    ended = child(made, "--check")
    assert (ended.code, ended.out) == (1, "")
    assert ended.err.startswith(f"{made.path}/program: is damaged (")
    assert ended.err.endswith("); deploy the model again or fetch an intact copy\n")
    assert len(ended.err.splitlines()) == 1


def test_a_bundle_stays_as_it_is(made: Made) -> None:
    before = sorted(made.path.rglob("*"))
    assert child(made, "--self-test", 2, env=SEEDS | {"PYTHONDONTWRITEBYTECODE": ""}).code == 0
    assert sorted(made.path.rglob("*")) == before


@pytest.mark.parametrize(
    ("name", "array", "said"),
    [
        ("rates", np.zeros((2, 30), np.float32), "rates.npy is float32 (2, 30), but must be uint16 (n, 30)"),
        ("rates", np.zeros((2, 31), np.uint16), "rates.npy is uint16 (2, 31), but must be uint16 (n, 30)"),
        ("keys", np.zeros(3, np.uint64), "keys.npy is uint64 (3,), but must be uint64 (2,)"),
        ("keys", np.zeros(2, np.int64), "keys.npy is int64 (2,), but must be uint64 (2,)"),
    ],
)
def test_queries_that_do_not_fit(board: Board, made: Made, tmp_path: Path, name: str, array: Any, said: str) -> None:
    arrays = {"rates": np.zeros((2, 30), np.uint16), "keys": np.zeros(2, np.uint64), name: array}
    queries = write_queries(tmp_path / "q", arrays["rates"], arrays["keys"])
    ended = board.run(made, "--queries", queries, "--out", tmp_path / "r")
    assert (ended.code, ended.err) == (1, f"{queries}: {said}\n")


@pytest.fixture
def seeds(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """An environment in which this Python has NxSDK."""
    for name, value in SEEDS.items():
        monkeypatch.setenv(name, value)
    monkeypatch.delenv(board_program.PYTHON, raising=False)
    return monkeypatch


def choose(seeds: pytest.MonkeyPatch, **faults: Any) -> None:
    """Faults for the child."""
    seeds.setenv("STANDIN", json.dumps({"asked": ASKED, **faults}))


def test_run_bundle(seeds: pytest.MonkeyPatch, made: Made) -> None:
    assert board_program.kapoho_bay_available() is None
    told: list[int] = []
    counts = board_program.run_bundle(load(made.path), made.rates, made.keys, advance=told.append)
    assert counts.dtype == np.int32
    assert np.array_equal(counts, made.counts)
    assert sum(told) == 6


def test_unanswered_queries_are_presented_again(
    seeds: pytest.MonkeyPatch, made: Made, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    choose(seeds, vanish_after=8, once=str(tmp_path / "once"))
    told: list[int] = []
    counts = board_program.run_bundle(load(made.path), made.rates, made.keys, advance=told.append)
    assert np.array_equal(counts, made.counts)
    assert sum(told) == 6
    (said,) = caplog.messages
    assert said.startswith("Kapoho Bay answered 2 of 6 queries, then: ")
    assert said.endswith("; the others are presented again")


def test_a_device_that_stays_away(seeds: pytest.MonkeyPatch, made: Made, tmp_path: Path) -> None:
    choose(seeds, vanish_after=8)
    seeds.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(LavaRunError, match=r"^Kapoho Bay answered 4 of 6 queries, then: .* No such device") as caught:
        board_program.run_bundle(load(made.path), made.rates, made.keys)
    assert len(str(caught.value).splitlines()) == 1
    assert "Traceback" in caught.value.traceback
    assert str(tmp_path) not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_run_bundle_tells_what_is_missing(seeds: pytest.MonkeyPatch, made: Made, tmp_path: Path) -> None:
    choose(seeds, start_fails=3)
    with pytest.raises(BackendUnavailableError, match="did not start in 3 attempts"):
        board_program.run_bundle(load(made.path), made.rates, made.keys)
    seeds.setenv("KAPOHOBAY", "")
    assert str(board_program.kapoho_bay_available()).startswith(
        "no Kapoho Bay is announced to NxSDK; connect it (lsusb"
    )
    with pytest.raises(BackendUnavailableError, match="KAPOHOBAY is not set"):
        board_program.run_bundle(load(made.path), made.rates, made.keys)
    seeds.setenv("PYTHONPATH", "")
    assert str(board_program.kapoho_bay_available()).startswith(f"nxsdk is not installed for {sys.executable}; ")
    with pytest.raises(BackendUnavailableError, match="has no nxsdk"):
        board_program.run_bundle(load(made.path), made.rates, made.keys)
    seeds.setenv(board_program.PYTHON, str(tmp_path / "python"))
    assert "which cannot be started" in str(board_program.kapoho_bay_available())
    with pytest.raises(BackendUnavailableError, match="cannot be started"):
        board_program.run_bundle(load(made.path), made.rates, made.keys)


def test_run_bundle_refuses_more_spikes_than_fit(seeds: pytest.MonkeyPatch, tmp_path: Path) -> None:
    made = make(tmp_path, layout("one core", random_network(steps=24, inputs=60)), images=2)
    with pytest.raises(NetworkLimitError, match=r"^query 0: 60 inputs spike in one step, but the host sends"):
        board_program.run_bundle(load(made.path), np.full_like(made.rates, 65535), made.keys)


def test_run_bundle_refuses_an_altered_bundle(seeds: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The program gets what was read; where it finds that wrong itself, it names the bundle, not its copy."""
    made = make(tmp_path, layout("one core", random_network(steps=24)), images=2)
    altered(made, "host/exc.npy", lambda data: data[:-1])
    with pytest.raises(BundleError) as caught:
        board_program.run_bundle(load(made.path), made.rates, made.keys)
    assert str(caught.value).startswith(f"{made.path}/host/exc.npy: is missing or no array; deploy the model again")


def test_the_stand_in_is_found_only_in_tests() -> None:
    assert STANDIN.is_dir()
    assert str(STANDIN) not in sys.path
