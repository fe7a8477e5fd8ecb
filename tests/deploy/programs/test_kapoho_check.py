"""What `run.py --check` of Kapoho Bay sees to: with NxSDK and no board, without NxSDK, without numpy."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from support.boards.host_programs import Made
from support.boards.kapoho_board import SEEDS, child, layout, make, random_network
from support.common import children


@pytest.fixture(scope="module", params=[False, True])
def two_chips(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A network on two chips, with injected and with bias input; never written to."""
    network = random_network(regular=request.param, bias_input=request.param)
    return make(tmp_path_factory.mktemp("made"), layout("two chips", network))


def test_check_needs_no_board(two_chips: Made) -> None:
    without = {name: value for name, value in SEEDS.items() if name != "KAPOHOBAY"}
    ended = child(two_chips, "--check", env=without | {"KAPOHOBAY": ""}, version="0.9.9", start_hangs=True)
    assert (ended.code, ended.err) == (0, "")
    intact, ready = ended.out.splitlines()
    assert re.fullmatch(r"intact: \d+ files, \d+ bytes, all as their checksums say", intact)
    assert ready == "ready: 3 cores, 265 synapses, 10 neurons; set KAPOHOBAY=1 to run on the board"


def alone(made: Made, *words: str, bare: bool = False) -> tuple[int, str, str]:
    """The program without NxSDK and, if ``bare``, without numpy or anything else that is installed."""
    flags = ["-E", "-S"] if bare else ["-E"]
    command = [sys.executable, *flags, str(made.path / "program" / "run.py"), *words]
    done = children.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


def test_check_sees_to_the_files_before_it_says_what_is_missing(two_chips: Made) -> None:
    code, out, err = alone(two_chips, "--check")
    assert (code, out.split(":")[0]) == (1, "intact")
    assert err.startswith(f"{sys.executable} has no nxsdk; ")
    code, out, err = alone(two_chips, "--check", bare=True)
    assert (code, out.split(":")[0]) == (1, "intact")
    assert err == f"{sys.executable} has no numpy; install it for this Python: pip install numpy\n"
    assert alone(two_chips, "--self-test", bare=True) == (code, "", err)


@pytest.mark.parametrize("bare", [False, True])
def test_check_finds_what_was_altered_without_anything(tmp_path: Path, bare: bool) -> None:
    made = make(tmp_path, layout("one core", random_network(1)), images=2)
    path = made.path / "cores" / "chip0-core000" / "synapses.npy"
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    code, out, err = alone(made, "--check", bare=bare)
    assert (code, out) == (1, "")
    assert err == f"{path}: was altered (checksum differs); deploy the model again or fetch an intact copy\n"
