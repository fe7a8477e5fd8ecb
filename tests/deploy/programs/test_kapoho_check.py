"""What `run.py --check` of Kapoho Bay sees to: with NxSDK and no board, without NxSDK, without numpy."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
from support.boards.host_programs import Made
from support.boards.kapoho_board import SEEDS, child, layout, make, random_network
from support.common import children

from lava_vpr.deploy.bundle.folder import self_digest


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


def alone(bundle: Path, *words: str, bare: bool = False) -> tuple[int, str, str]:
    """The program without NxSDK and, if ``bare``, without numpy or anything else that is installed."""
    flags = ["-E", "-S"] if bare else ["-E"]
    command = [sys.executable, *flags, str(bundle / "program" / "run.py"), *words]
    done = children.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


def test_check_sees_to_the_files_before_it_says_what_is_missing(two_chips: Made) -> None:
    code, out, err = alone(two_chips.path, "--check")
    assert (code, out.split(":")[0]) == (1, "intact")
    assert err.startswith(f"{sys.executable} has no nxsdk; ")
    code, out, err = alone(two_chips.path, "--check", bare=True)
    assert (code, out.split(":")[0]) == (1, "intact")
    assert err == f"{sys.executable} has no numpy; install it for this Python: pip install numpy\n"
    assert alone(two_chips.path, "--self-test", bare=True) == (code, "", err)


@pytest.mark.parametrize("bare", [False, True])
def test_check_finds_what_was_altered_without_anything(tmp_path: Path, bare: bool) -> None:
    made = make(tmp_path, layout("one core", random_network(1)), images=2)
    path = made.path / "cores" / "chip0-core000" / "synapses.npy"
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    code, out, err = alone(made.path, "--check", bare=bare)
    assert (code, out) == (1, "")
    assert err == f"{path}: was altered (checksum differs); deploy the model again or fetch an intact copy\n"


FORGED: dict[str, tuple[Any, str]] = {
    "deep": (b'{"a":' + b"[" * 200_000, "is not a bundle's manifest"),
    "deep network": (b'{"a":' + b"[" * 900 + b"]" * 900 + b"}", "is not a bundle's manifest"),
    "no file's name": ({"files": {"a\0b": {"bytes": 1, "sha256": ""}}}, r"a\x00b: cannot be read ("),
    "no text": ({"files": {"\ud800": {"bytes": 1, "sha256": ""}}}, r"\ud800: cannot be read ("),
    "a terminal's": ({"files": {"\x1b[2J\u202e": {"bytes": 1, "sha256": ""}}}, r"\x1b[2J\u202e: cannot be read ("),
    "a board": ({"target": "\x1b[2J"}, r"is lava-vpr bundle 1 for \x1b[2J, not "),
    "long": ({"files": {"x" * 9999: {"bytes": 1, "sha256": ""}}}, "..."),
    "a pipe": (None, "cannot be read (is no file)"),
}


@pytest.mark.parametrize("kind", FORGED)
def test_check_refuses_a_forged_manifest_in_one_plain_line(tmp_path: Path, two_chips: Made, kind: str) -> None:
    """Whoever forges one can seal it, too."""
    path, (forged, said) = tmp_path / "b", FORGED[kind]
    shutil.copytree(two_chips.path, path)
    file = path / "manifest.json"
    if isinstance(forged, dict):
        forged = json.loads(file.read_bytes()) | forged
        forged = json.dumps(forged | {"sha256": self_digest(forged)}).encode()
    file.unlink()
    if forged is None:
        os.mkfifo(file)
    else:
        file.write_bytes(forged)
    code, out, err = alone(path, "--check", bare=True)
    assert (code, out) == (1, "")
    assert said in err
    assert err[:-1].isprintable()
    assert err.endswith("; deploy the model again or fetch an intact copy\n")
    assert len(err) < 800
