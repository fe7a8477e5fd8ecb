"""What is started for a board: the shipped program on the bundle's data, whatever program the bundle holds."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from support.boards import host_programs
from support.boards.host_programs import Made
from support.boards.kapoho_board import layout, make, random_network
from support.common.commands import run
from support.common.small_models import encoded

from lava_vpr.backends.interface import query_presentations
from lava_vpr.bench.measure import board_power
from lava_vpr.cli import main
from lava_vpr.deploy.bundle import board_program
from lava_vpr.deploy.bundle.folder import MANIFEST, json_bytes, load, sealed
from lava_vpr.deploy.bundle.targets import open_bundle
from lava_vpr.errors import LavaRunError

RECORDER = f"""#!{sys.executable} -I
import os, pathlib, shutil, sys
if sys.argv[1] == "-c":
    sys.exit(0)
program = pathlib.Path(sys.argv[1])
shutil.copytree(program.parent.parent, {{seen!r}}, dirs_exist_ok=True)
sys.exit("recorded in " + os.getcwd())
"""


@pytest.fixture
def seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where an interpreter leaves the folder of the program that it is to run, instead of running it."""
    script, folder = tmp_path / "recorder", tmp_path / "seen"
    script.write_text(RECORDER.format(seen=str(folder)))
    script.chmod(0o755)
    monkeypatch.setenv("NXSDK_PYTHON", str(script))
    monkeypatch.setenv("KAPOHOBAY", "1")
    return folder


def forge(path: Path) -> None:
    """Put foreign code into a bundle wherever an interpreter might look, and make the checksums right again."""
    whole = load(path)
    foreign = {name: b"print('owned')\n" for name in ("program/run.py", "program/numpy.py", "sitecustomize.py")}
    for name, data in foreign.items():
        (path / name).write_bytes(data)
    (path / MANIFEST).write_bytes(json_bytes(sealed(whole.manifest, {**whole.files, **foreign})))
    (path / "program" / "argparse.py").write_text("print('owned')\n")  # beside run.py, and in no list
    (path / "program" / "__pycache__").mkdir()
    (path / "program" / "__pycache__" / f"refusals.{sys.implementation.cache_tag}.pyc").write_bytes(b"owned")


def check_shipped(folder: Path, path: Path) -> None:
    """What was to run is the shipped program, whole and alone, on the data of the bundle at ``path``."""
    ours, theirs = load(folder), load(path)
    program = {name.removeprefix("program/"): data for name, data in ours.files.items() if name.startswith("program/")}
    assert program == host_programs.files("kapoho_bay")
    assert {entry.name for entry in (folder / "program").iterdir()} == set(program), "something else stands beside it"
    for name, data in theirs.files.items():
        if not name.startswith("program/"):
            assert ours.files[name] == data


COMMANDS = (("eval", "b", "query"), ("query", "b", "query", "-o", "q.csv"), ("verify", "b", "query", "--limit", "2"))


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: words[0])
def test_no_command_runs_what_a_bundle_holds(here: Path, seen: Path, words: tuple[str, ...]) -> None:
    run("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "b")
    forge(Path("b"))
    result = CliRunner().invoke(main, [*words, "--backend", "kapoho-bay"])
    assert result.exit_code == 1
    assert "recorded in " in result.stderr
    assert str(here / "b") not in result.stderr, "the program stands in the bundle's folder"
    check_shipped(seen, Path("b"))


def test_a_bench_on_a_board_does_not_either(here: Path, seen: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(board_power, "STEPS", 400)
    run("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "b")
    forge(Path("b"))
    model = open_bundle(Path("b"))
    with pytest.raises(LavaRunError, match="recorded in "):
        board_power.measure(model, query_presentations(model, encoded(2, model.config.encoder.inputs), 0), "kapoho-bay")
    check_shipped(seen, Path("b"))


def test_a_package_where_we_stand_is_not_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether NxSDK is there is asked without a look at the working folder, which may be a bundle."""
    (tmp_path / "contextlib.py").write_text(f"open({str(tmp_path / 'owned')!r}, 'w')\n")
    (tmp_path / "nxsdk.py").write_text("")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NXSDK_PYTHON", os.path.realpath(sys.executable))
    monkeypatch.delenv("PYTHONPATH", raising=False)
    assert str(board_program.kapoho_bay_available()).startswith("nxsdk is not installed for ")
    assert not (tmp_path / "owned").exists()


LEAVE: dict[str, tuple[Callable[[Path], Any], str]] = {
    "a status that is a list": (lambda out: (out / "status.json").write_text("[1]"), ""),
    "a deep status": (lambda out: (out / "status.json").write_text("[" * 100_000), ""),
    "a status that is a pipe": (lambda out: os.mkfifo(out / "status.json"), ""),
    "words that are numbers": (lambda out: (out / "status.json").write_text('{"stage": [], "error": 7}'), ""),
    "an escape": (lambda out: (out / "status.json").write_text(json.dumps({"error": "\x1b[2J x" * 999})), "\\x1b[2J x"),
    "progress beyond the end": (lambda out: (out / "status.json").write_text('{"done": 99999999}'), ""),
    "a huge header": (lambda out: array(out, "counts", "(99999999999, 9), "), "impossible results"),
    "counts of another network": (lambda out: np.save(out / "counts.npy", np.zeros((6, 3), np.int32)), "impossible"),
    "objects": (lambda out: array(out, "counts", "(6, 10), ", "|O"), "impossible results"),
    "traceback that is a pipe": (lambda out: os.mkfifo(out / "failure.txt"), ""),
}
"""What a program may leave, and what is said of it."""


def array(out: Path, name: str, shape: str, kind: str = "<i4") -> None:
    """An array's header with little behind it."""
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    (out / f"{name}.npy").write_bytes(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + b"x" * 64)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A small bundle; never written to."""
    return make(tmp_path_factory.mktemp("made"), layout("one core", random_network(steps=24)), images=6)


@pytest.mark.parametrize("kind", LEAVE)
def test_what_a_program_leaves_is_not_trusted(small: Made, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    leave, said = LEAVE[kind]

    def ran(bundle: Any, folder: Path, rates: Any, keys: Any, *words: Any, **more: Any) -> board_program.EndedProgram:
        (folder / "out").mkdir()
        np.save(folder / "out" / "counts.npy", np.zeros((6, 10), np.int32))
        np.save(folder / "out" / "done.npy", np.zeros(6, bool))
        leave(folder / "out")
        return board_program.ended(folder, bundle, 0, hung=False)

    monkeypatch.setattr(board_program, "run_program", ran)
    with pytest.raises(LavaRunError) as caught:
        board_program.run_bundle(load(small.path), small.rates, small.keys)
    text = str(caught.value)
    assert text.isprintable()
    assert len(text) < 1000
    assert text.startswith("Kapoho Bay answered 0 of 6 queries, then: ")
    assert said in text
    assert "; run the bundle's program/run.py --self-test" in text


def test_of_a_long_log_the_end_is_kept(small: Made, tmp_path: Path) -> None:
    with (tmp_path / "log").open("wb") as file:
        file.truncate(1 << 33)
    (tmp_path / "errors").write_text("\x1b[2Jfirst\n\x1b[31mlast\n")
    ended = board_program.ended(tmp_path, load(small.path), 1, hung=False)
    assert ended.last == "\\x1b[31mlast"
    assert len(ended.log) < 10 * board_program.KEPT
