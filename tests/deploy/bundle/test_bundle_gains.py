"""A bundle that holds the gains and biases of a drive: backends replay it, and its program presents queries so."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.boards import host_programs
from support.common import children
from support.common.commands import content, fails, run
from support.common.teaching import teach_quickly

from lava_vpr import load
from lava_vpr.backends.asking import Asker, Asking
from lava_vpr.backends.interface import HostBackend, Presentations
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.bundle import folder
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.deploy.bundle.folder import ReadBundle
from lava_vpr.deploy.bundle.gains import FACTS, TABLE
from lava_vpr.deploy.bundle.targets import open_bundle
from lava_vpr.encoding import EncodedTraverse, encode_traverse
from lava_vpr.engine.gains import FULL
from lava_vpr.engine.inference.biases import bias_registers, held_biases
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.engine.rates import rates16
from lava_vpr.errors import BundleError, LavaVprError, ModelFileError
from lava_vpr.model import IntegerModel, integer_model
from lava_vpr.season import table as gain_table
from lava_vpr.season.table import GainTable, Used, packed
from lava_vpr.traverse import open_traverse

QUERIES = 6
SEED = 20


def queries_of(model: IntegerModel) -> EncodedTraverse:
    """The route's first queries."""
    return encode_traverse(open_traverse("query").take(range(QUERIES)), model.config.encoder)


def table_of(model: IntegerModel) -> GainTable:
    """A table of three epochs, the first with all gains full, the last with none 0, and biases of every size."""
    rng, inputs = np.random.default_rng(SEED), model.config.encoder.inputs
    shown = Asker(model).presentations((queries_of(model),))
    bias = held_biases(rng.integers(-200, model.network.highest_bias + 1, (QUERIES, model.neurons)))
    bias[1] = held_biases(bias[1] - 70_000)
    gains = [np.full(inputs, FULL), rng.integers(0, FULL + 1, inputs), rng.integers(1, FULL + 1, inputs)]
    parts = [slice(0, 2), slice(2, 5), slice(5, QUERIES)]
    images = image_keys(shown.rates)
    used = [Used(own.astype(np.uint8), bias[k], images[k]) for own, k in zip(gains, parts, strict=True)]
    return GainTable.of(model, used)


def presented(model: IntegerModel, table: GainTable) -> Presentations:
    """The queries as the host replays ``table``."""
    return Asker(model, Asking(replay=table)).presentations((queries_of(model),))


@pytest.fixture
def model(here: Path) -> IntegerModel:
    """The route's model."""
    return integer_model(load("m.lvpr"), "a test")


def written(model: IntegerModel, target: str = "kapoho-bay") -> ReadBundle:
    """A bundle with a table."""
    return deploy(model, BOARDS[target], Path("b"), picture=False, gains=table_of(model)).bundle


def test_a_drive_is_replayed_from_its_bundle(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    teach_quickly(monkeypatch)
    run("query", "m.lvpr", "query", "--learn", "-o", "learned.csv", "--gains", "g.lvpg")
    told = [line.split(",")[1:] for line in Path("learned.csv").read_text().splitlines()]
    for target in ("kapoho-bay", "loihi2"):
        run("deploy", "m.lvpr", "--target", target, "--replay", "g.lvpg", "-o", target)
        own = Path(target) / TABLE
        assert own.read_bytes() == Path("g.lvpg").read_bytes()
        run("query", target, "query", "--replay", own, "-o", "q.csv")
        assert [line.split(",")[1:] for line in Path("q.csv").read_text().splitlines()] == told
        said = run("verify", target, "query", "--backend", "bundle", "--replay", own, "--limit", 8).stdout
        assert "every spike equal" in said
        assert TABLE in (Path(target) / "README.md").read_text()


@pytest.mark.parametrize("count", [0, 1, 70, 300, 9_999])
@pytest.mark.parametrize("inputs", [40, 300, 9_001])
def test_the_program_makes_the_host_s_rates_and_keys(tmp_path: Path, inputs: int, count: int) -> None:
    program = host_programs.load(host_programs.flat("kapoho_bay", tmp_path / "program"))
    rng = np.random.default_rng([inputs, count])
    activity = rng.gamma(0.3, 2.0, (5, inputs)).astype(np.float32)
    activity[1] = np.rint(activity[1])  # many are equal
    activity[2] = 0
    activity[3, 7:] = 0
    rates = program.gained.rates_of(activity, count, 12.5)
    wanted = rates16(activity, 12.5, count)
    assert np.array_equal(rates, wanted)
    images = image_keys(wanted)
    assert np.array_equal(program.gained.image_keys(wanted), images)
    for seed in (0, 2**63 - 1):
        assert np.array_equal(program.gained.query_keys(seed, images), presentation_keys(seed, "query", images))


@pytest.mark.parametrize("target", ["kapoho-bay", "loihi2"])
def test_the_program_presents_what_the_host_replays(model: IntegerModel, target: str) -> None:
    bundle, wanted = written(model, target), presented(model, table_of(model))
    assert wanted.bias is not None
    program = host_programs.load(host_programs.flat(target.replace("-", "_"), Path("program").absolute()))
    given = program.bundle_files.Bundle("b", target)
    shown = program.gained.under_gains(given, queries_of(model).activity, "Q")
    mantissas, exponents = bias_registers(wanted.bias)
    assert exponents.max() > 0
    for name, array in (
        ("rates", wanted.rates),
        ("keys", wanted.keys),
        ("biases", mantissas),
        ("exponents", exponents),
    ):
        assert np.array_equal(shown[name], array), name
        assert shown[name].dtype == array.dtype
    assert (wanted.rates[:2] == wanted.seen[:2]).all()
    assert (wanted.rates[2:] != wanted.seen[2:]).any(axis=1).all()
    assert bundle.manifest[FACTS]["queries"] == QUERIES


def queries_in(place: str, activity: NDArray[Any], **more: NDArray[Any]) -> str:
    """The folder ``place`` of queries with this activity, and what else is in it."""
    Path(place).mkdir(exist_ok=True)
    for path in Path(place).iterdir():
        path.unlink()
    for name, array in {"activity": activity, **more}.items():
        np.save(f"{place}/{name}.npy", array)
    return place


def asked(activity: NDArray[Any]) -> subprocess.CompletedProcess[str]:
    """A run of the simulated program on queries with this activity."""
    words = [sys.executable, "b/program/run.py", "--simulate", "--queries", queries_in("Q", activity), "--out", "R"]
    return children.run(words, capture_output=True, text=True, check=False, timeout=120, env=dict(os.environ))


@pytest.mark.parametrize("target", ["kapoho-bay", pytest.param("loihi2", marks=[pytest.mark.slow, pytest.mark.lava])])
def test_the_program_counts_what_the_host_counts(model: IntegerModel, target: str) -> None:
    written(model, target)
    counts, _ = HostBackend().count_spikes(model, presented(model, table_of(model)))
    ran = asked(queries_of(model).activity)
    assert (ran.returncode, ran.stdout) == (0, f"{QUERIES} of {QUERIES} queries answered\n"), ran.stderr
    assert np.array_equal(np.load("R/counts.npy"), counts)
    plain, _ = HostBackend().count_spikes(model, Asker(model).presentations((queries_of(model),)))
    assert not np.array_equal(plain, counts)


def test_the_program_refuses_other_queries_in_a_line(model: IntegerModel) -> None:
    written(model)
    program = host_programs.load(host_programs.flat("kapoho_bay", Path("program").absolute()))
    good = queries_of(model).activity
    longer = np.concatenate([good, good[:1]])
    for activity, more, said in (
        (good[1:], {}, "Q: query 0 is another image than the bundle's table has there"),
        (longer, {}, "Q: activity.npy has 7 queries, but the bundle's table has 6; ask no more"),
        (good.astype(np.float64), {}, "Q: activity.npy is float64 (6, "),
        (good[:, 1:], {}, "but must be float32 (n, "),
        (-good, {}, "Q: activity.npy holds a value below 0"),
        (good, {"rates": np.zeros((6, 9), np.uint16)}, "Q: has activity.npy, of which gains make rates.npy, too"),
    ):
        given = program.bundle_files.Bundle("b", "kapoho-bay")
        with pytest.raises(program.refusals.Refused) as refused:
            program.host.load_queries(given, queries_in("Q", activity, **more), *given.numbers("inputs", "neurons"))
        assert said in str(refused.value)
        assert refused.value.stage == "input"
    deploy(model, BOARDS["kapoho-bay"], Path("b"), picture=False)
    ran = asked(good)
    assert (ran.returncode, ran.stderr.count("\n")) == (1, 1)
    assert "needs gains, which this bundle has none of" in ran.stderr


def changed(model: IntegerModel, change: Callable[[dict[str, Any], dict[str, bytes]], object]) -> None:
    """The bundle, sealed again after a change of manifest and files."""
    bundle = written(model)
    manifest, files = dict(bundle.manifest), dict(bundle.files)
    change(manifest, files)
    folder.write(Path("b"), {key: manifest[key] for key in manifest if key not in ("files", "sha256")}, files)


def with_table(**values: Any) -> Callable[[dict[str, Any], dict[str, bytes]], object]:
    """A change of the table."""

    def change(manifest: dict[str, Any], files: dict[str, bytes]) -> None:
        table = replace(gain_table.unpacked(files[TABLE], Path("b") / TABLE), **values)
        files[TABLE] = packed(table)

    return change


def facts(**values: Any) -> Callable[[dict[str, Any], dict[str, bytes]], object]:
    """A change of what the manifest says of gains."""
    return lambda manifest, _: manifest.update({FACTS: {**manifest[FACTS], **values}})


CHANGES: Mapping[str, tuple[Callable[[dict[str, Any], dict[str, bytes]], object], type[LavaVprError], str]] = {
    "another model": (
        with_table(network_of="0" * 64, map_of="0" * 64),
        BundleError,
        f"b/{TABLE}: was written with another model",
    ),
    "another network": (
        with_table(network_of="0" * 64),
        BundleError,
        f"b/{TABLE}: was written with another network of the same map",
    ),
    "no table": (lambda _, files: files.update({TABLE: b"x"}), ModelFileError, f"b/{TABLE}: "),
    "another seed": (facts(seed=5), BundleError, "b/manifest.json: what it says of gains is not what"),
    "fewer queries": (facts(queries=5), BundleError, "b/manifest.json: what it says of gains"),
    "a table left out": (lambda _, files: files.pop(TABLE), BundleError, "b/manifest.json: what it says of gains"),
    "nothing said": (lambda manifest, _: manifest.pop(FACTS), BundleError, "b/manifest.json: what it says of gains"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_table_that_does_not_belong_is_refused(model: IntegerModel, name: str) -> None:
    change, error, said = CHANGES[name]
    assert open_bundle(written(model).path).places == model.places
    changed(model, change)
    with pytest.raises(error, match=said):
        open_bundle(Path("b"))


def test_deploy_refuses_what_the_board_cannot_replay(model: IntegerModel) -> None:
    gain_table.save(table_of(model), Path("g.lvpg"))
    run("remove", "m.lvpr", "7", "-o", "n.lvpr")
    Path("no.lvpg").write_bytes(Path("g.lvpg").read_bytes()[:-9])
    before = content(Path())
    words = ("--target", "loihi2", "-o", "b", "--replay")
    assert fails("deploy", "n.lvpr", *words, "g.lvpg").startswith("g.lvpg: was written with another model")
    assert "no.lvpg: the gain table is damaged" in fails("deploy", "m.lvpr", *words, "no.lvpg")
    assert "none.lvpg: the gain table cannot be read" in fails("deploy", "m.lvpr", *words, "none.lvpg")
    said = fails("deploy", "m.lvpr", *words, "g.lvpg", "--prune", "0.5")
    assert said.startswith("g.lvpg: was written with another network of the same map (deploy changes bits, pruning")
    assert "g.lvpg: is also an input" in fails("deploy", "m.lvpr", *words, "g.lvpg", "--json", "g.lvpg")
    assert content(Path()) == before
