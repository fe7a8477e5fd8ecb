"""The host program of a Loihi 2 bundle, with Lava's simulation and with a stand-in for lava-loihi."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.boards import host_programs
from support.boards.host_programs import answers, write_queries
from support.boards.loihi2_bundles import (
    AGAIN,
    INTERVAL,
    STANDIN,
    asked,
    environment,
    network,
    program,
    queries,
    write_bundle,
)
from support.common import children
from support.lava.small_networks import SMALL_LIMITS, limits

from lava_vpr.deploy.bundle import folder as bundle_folder
from lava_vpr.deploy.bundle.folder import json_bytes
from lava_vpr.engine.inference.biases import held_biases
from lava_vpr.engine.inference.counting import count_spikes

WAYS: dict[str, dict[str, Any]] = {
    "injected": {"signed": True},
    "regular": {"regular": True},
    "bias": {"bias_input": True, "signed": True},
}
"""How the networks of the bundles differ, by name."""


def running(bundle: Path) -> list[str]:
    """Command lines of processes that run a bundle's program."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            found.append(path.read_text(encoding="utf-8", errors="replace"))
        except OSError:
            continue
    return [line for line in found if str(bundle) in line]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Bundles, and queries; never written to."""
    root = tmp_path_factory.mktemp("loihi2")
    bundles = {way: write_bundle(root / way, network(**changes)) for way, changes in WAYS.items()}
    return {**bundles, "queries": write_queries(root / "queries", *queries())}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The modules of the program, by name; they import neither Lava nor lava_vpr by that."""
    return host_programs.load(host_programs.flat("loihi2", tmp_path_factory.mktemp("flat") / "program"))


def test_the_program_stands_alone() -> None:
    assert host_programs.imported("loihi2", (3, 10)) - sys.stdlib_module_names == {"numpy", "scipy", "lava"}


# The program's refusals


def refusal(run: Any, simulate: bool = False) -> str:
    with pytest.raises(run.refusals.Refused) as caught:
        run.run.require(simulate)
    assert caught.value.stage == "missing"
    return str(caught.value)


@pytest.mark.lava
def test_what_is_missing_is_said_in_one_line(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("SLURM", "NXSDKHOST"):
        monkeypatch.delenv(name, raising=False)
    vendor = "Intel's closed package, from its neuromorphic research cloud"
    assert refusal(run) == f"lava-loihi is not installed; it is {vendor}; --simulate needs none"
    assert run.run.require(True) == "lava-nc 0.10.0, simulated"
    with monkeypatch.context() as patch:
        patch.setattr(importlib.util, "find_spec", lambda name: object())
        assert refusal(run) == ("no Loihi host is configured; set SLURM=1 or NXSDKHOST=ADDRESS; --simulate needs none")
        patch.setenv("NXSDKHOST", "10.0.0.2")
        assert run.run.require(False) == "lava-nc 0.10.0, lava-loihi, host 10.0.0.2"
        patch.setattr(importlib.metadata, "version", lambda name: "0.9.0")
        assert (
            refusal(run)
            == "lava-nc 0.9.0 is installed, 0.10 is needed: pip install lava-nc==0.10.*, or --ways any-lava"
        )

        def absent(name: str) -> str:
            raise importlib.metadata.PackageNotFoundError(name)

        patch.setattr(importlib.metadata, "version", absent)
        assert refusal(run, simulate=True) == "lava-nc is not installed: pip install lava-nc==0.10.*"
        patch.setattr(run.run, "sys", SimpleNamespace(version_info=(3, 11, 4, "final", 0)))
        assert refusal(run) == "lava-nc 0.10 needs Python 3.10, this is 3.11.4; run this program with Python 3.10"


def test_a_bundle_for_another_board_is_not_run(made: dict[str, Path], tmp_path: Path) -> None:
    own = shutil.copytree(made["injected"], tmp_path / "bundle")
    manifest = json.loads((own / "manifest.json").read_bytes())
    other = {key: value for key, value in manifest.items() if key != "sha256"} | {"target": "kapoho-bay"}
    (own / "manifest.json").write_bytes(json_bytes(other | {"sha256": bundle_folder.self_digest(other)}))
    assert program(own, "--check", "--simulate") == (
        1,
        f"{own}/manifest.json: is lava-vpr bundle 1 for kapoho-bay, not lava-vpr bundle 1 for loihi2{AGAIN}",
    )


@pytest.mark.lava  # which the program asks for before it reads queries
def test_queries_that_are_not_there_are_refused(made: dict[str, Path], tmp_path: Path) -> None:
    words = ("--queries", tmp_path, "--out", tmp_path / "out", "--simulate")
    missing = f"{tmp_path}/rates.npy: cannot be read (No such file or directory); write the queries there"
    assert program(made["injected"], *words) == (1, missing)
    assert answers(tmp_path / "out")[2] == {"done": 0, "of": 0, "stage": "input", "error": missing}
    assert program(made["injected"], "--queries", tmp_path)[0] == 2


# The program in Lava's simulation, and on the stand-in


@pytest.mark.quick(1)
@pytest.mark.lava
@pytest.mark.parametrize("way", WAYS)
def test_lavas_simulation_counts_what_the_host_counts(made: dict[str, Path], way: str, tmp_path: Path) -> None:
    words = ("--queries", made["queries"], "--out", tmp_path / "out", "--batch", 2, "--simulate")
    assert program(made[way], *words) == (0, "5 of 5 queries answered")
    counts, done, status = answers(tmp_path / "out")
    wanted, _, _ = count_spikes(network(**WAYS[way]), *queries())
    assert counts.dtype == np.int32
    assert np.array_equal(counts, wanted)
    assert wanted.any(axis=1).all()
    assert done.all()
    assert status == {"done": 5, "of": 5, "stage": None, "error": None}
    assert not running(made[way])
    assert not list(made[way].rglob("__pycache__"))  # the bundle is as it was


@pytest.mark.quick(2)
@pytest.mark.lava
@pytest.mark.parametrize("way", WAYS)
def test_the_board_answers_as_the_host(made: dict[str, Path], way: str, tmp_path: Path) -> None:
    """All of the network is on the chip, with the bundle's own weights; all steps are run, and no more."""
    weights = str(made[way] / "network" / "weights.npy")
    env = environment(options=asked(tmp_path, weights=weights, log=str(tmp_path / "log")))
    code, text = program(made[way], "--self-test", "--batch", 3, env=env)
    wanted, _, _ = count_spikes(network(**WAYS[way]), *queries())
    assert (code, text) == (0, f"equal: 5 references, 40 counts, {wanted.sum()} spikes of exc")
    parts = [*["Dense"] * 3, *["LIFReset"] * 2, "LIF" if way == "bias" else "PyToNxAdapter", "NxToPyAdapter"]
    log = (tmp_path / "log").read_text(encoding="utf-8").splitlines()
    assert log == [f"placed {', '.join(sorted(parts))}", f"ran {5 * INTERVAL} steps"]


@pytest.mark.quick(1)
@pytest.mark.lava
@pytest.mark.parametrize(("way", "chip"), [("injected", False), ("injected", True), ("bias", True)])
def test_every_query_may_bring_biases(made: dict[str, Path], way: str, chip: bool, tmp_path: Path) -> None:
    net, (rates, keys) = network(**WAYS[way]), queries()
    rng = np.random.default_rng(7)
    wanted = rng.integers(-net.highest_bias, net.highest_bias + 1, (len(keys), net.neurons))
    wanted[1] = np.minimum(wanted[1], -1) * 40
    biases = held_biases(wanted)
    written = write_queries(tmp_path / "queries", rates, keys, biases)
    words = ["--queries", written, "--out", tmp_path / "out", "--batch", 2]
    env = environment(options=asked(tmp_path, log=str(tmp_path / "log"))) if chip else None
    code, text = program(made[way], *words, *([] if chip else ["--simulate"]), env=env)
    assert (code, text) == (0, "5 of 5 queries answered")
    counts, done, _ = answers(tmp_path / "out")
    expected, _, _ = count_spikes(net, rates, keys, bias=biases)
    own, _, _ = count_spikes(net, rates, keys)
    assert done.all()
    assert np.array_equal(counts, expected)
    assert not np.array_equal(expected, own)
    if chip and way == "injected":
        code, text = program(made[way], *words, "--power", tmp_path / "power.json", env=env)
        assert code == 1
        assert "biases of each query interrupt" in text


@pytest.mark.lava
def test_leaves_and_relays_stand_on_the_board(tmp_path: Path) -> None:
    with limits(**SMALL_LIMITS):
        net = network()
        bundle = write_bundle(tmp_path / "bundle", net)
        wanted, _, _ = count_spikes(net, *queries())
    direct, _, _ = count_spikes(network(), *queries())
    assert not np.array_equal(wanted, direct)
    env = environment(options=asked(tmp_path, log=str(tmp_path / "log")))
    assert program(bundle, "--self-test", env=env) == (
        0,
        f"equal: 5 references, 40 counts, {wanted.sum()} spikes of exc",
    )
    parts = ["Dense", *["LIFReset"] * 3, "NxToPyAdapter", "PyToNxAdapter", *["Sparse"] * 4]
    log = (tmp_path / "log").read_text(encoding="utf-8").splitlines()
    assert log == [f"placed {', '.join(parts)}", f"ran {5 * INTERVAL} steps"]


@pytest.mark.quick(1)
@pytest.mark.lava
@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("raise", "NxSdkRuntimeService: ConnectionError: the board does not answer any more"),
        pytest.param(
            "exit", r"a process of Lava's \(NxSdkRuntimeService\) ended with code 9; run again", marks=pytest.mark.slow
        ),
        ("pause", r"queries 2 to 3: the read-out covers \d+ of 64 steps; run them again, and see to the board"),
    ],
)
def test_a_board_that_fails_loses_no_answer(made: dict[str, Path], fault: str, said: str, tmp_path: Path) -> None:
    """In the third query: the first two are kept, the others are not answered, none is invented."""
    env = environment(options=asked(tmp_path, fault=fault, step=80))
    out = tmp_path / "out"
    code, text = program(made["injected"], "--queries", made["queries"], "--out", out, "--batch", 2, env=env)
    assert code == 1
    assert re.match(said, text)
    assert text.endswith(" (2 of 5 queries answered)")
    counts, done, status = answers(out)
    wanted, _, _ = count_spikes(network(**WAYS["injected"]), *queries())
    assert done.tolist() == [True, True, False, False, False]
    assert np.array_equal(counts[:2], wanted[:2])
    assert (counts[2:] == -1).all()
    assert {key: status[key] for key in ("done", "of", "stage")} == {"done": 2, "of": 5, "stage": "run"}
    assert re.match(said, status["error"])
    assert not running(made["injected"])


@pytest.mark.lava
@pytest.mark.slow
@pytest.mark.parametrize("fault", ["hang", pytest.param("lose", marks=pytest.mark.slow)])
def test_a_board_that_never_ends_is_given_up(made: dict[str, Path], fault: str, tmp_path: Path) -> None:
    env = environment(options=asked(tmp_path, fault=fault, step=10))
    out = tmp_path / "out"
    words = ("--queries", made["queries"], "--out", out, "--timeout", 3)
    code, text = program(made["injected"], *words, env=env)
    assert code == 1
    assert text.startswith("queries 0 to 4: Lava or the board did not finish within 3 s and was ended, ")
    assert text.endswith(" steps were read out in all; see to the board or raise --timeout (0 of 5 queries answered)")
    assert (answers(out)[0] == -1).all()
    assert not running(made["injected"])


@pytest.fixture
def short() -> Iterator[Path]:
    """A temporary folder with a short path: Lava makes sockets there."""
    with tempfile.TemporaryDirectory(prefix="t") as name:
        yield Path(name)


def test_a_temporary_folder_has_a_short_path(run: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    long = tmp_path / ("x" * 60)
    long.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(long))
    with pytest.raises(run.refusals.Refused) as caught, run.worker_process.job({}, {}):
        pass
    assert str(caught.value) == f"{long}: too long a path for Lava's sockets; set TMPDIR to a shorter one"
    assert caught.value.stage == "start"


@pytest.mark.lava
@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_nothing_outlives_the_program(made: dict[str, Path], number: int, tmp_path: Path, short: Path) -> None:
    env = {**environment(options=asked(tmp_path, fault="hang", step=40)), "TMPDIR": str(short)}
    out = tmp_path / "out"
    bundle = shutil.copytree(made["injected"], tmp_path / "bundle")
    words = ["--queries", str(made["queries"]), "--out", str(out), "--batch", "1"]
    command = [sys.executable, str(bundle / "program" / "run.py"), *words]
    with children.Child(command, env=env, stderr=subprocess.PIPE, text=True) as process:
        done = out / "done.npy"
        assert children.until(lambda: process.poll() is not None or (done.exists() and bool(np.load(done)[:1].any())))
        process.send_signal(number)
        said = process.communicate(timeout=60)[1]
    assert children.until(lambda: not running(bundle))
    assert not list(short.iterdir())
    if number == signal.SIGTERM:
        assert (process.returncode, said.strip()) == (1, "interrupted (1 of 5 queries answered)")
        assert answers(out)[2] == {"done": 1, "of": 5, "stage": "run", "error": "interrupted"}


@pytest.mark.lava
def test_a_network_on_the_cpu_is_refused(made: dict[str, Path], tmp_path: Path) -> None:
    """Lava would run it there without a word: a lava-loihi that lacks one model."""
    lacking = shutil.copytree(STANDIN, tmp_path / "standin")
    (lacking / "lava" / "proc" / "dense" / "ncmodels.py").unlink()
    code, text = program(made["injected"], "--self-test", env=environment(lacking))
    assert code == 1
    assert text == (
        "Loihi2HwCfg would run on the CPU: Dense (PyDenseModelFloat), Dense (PyDenseModelFloat), "
        "Dense (PyDenseModelFloat); install lava-loihi for lava-nc 0.10"
    )
