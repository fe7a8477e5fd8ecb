"""Bundles in use: by `eval`, `query` and `verify`, and the backends that run them."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from support.common.commands import run
from support.common.small_models import encoded, paper_model, small_model

from benchmarks.places import encoded as real, learn
from lava_vpr.backends import registry as backends
from lava_vpr.backends.interface import HostBackend, Presentations, query_presentations
from lava_vpr.backends.verification import verify
from lava_vpr.cli import main
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import BOARDS, KAPOHO_BAY, LOIHI_2
from lava_vpr.deploy.bundle import board_program
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.deploy.bundle.folder import load
from lava_vpr.deploy.bundle.targets import open_bundle
from lava_vpr.engine.inference.biases import held_biases
from lava_vpr.engine.presentations import Trains
from lava_vpr.errors import BackendUnavailableError, ConfigError, NetworkLimitError
from lava_vpr.model import Model
from lava_vpr.training.loop import train


@pytest.fixture(scope="module")
def model() -> Model:
    """Eight places."""
    return small_model()


@pytest.mark.parametrize("board", BOARDS.values(), ids=BOARDS)
def test_a_bundle_gives_its_model_back(model: Model, board: Any, tmp_path: Path) -> None:
    deploy(model, board, tmp_path / "b", picture=False)
    back = open_bundle(tmp_path / "b")
    assert back.bundle == tmp_path / "b"
    own = {"weights": model.network.weights, "bias": model.network.bias}
    assert all(np.array_equal(getattr(back.network, name), array) for name, array in own.items())
    assert model.network.bias.any()
    assert replace(back.network, **own) == model.network
    assert np.array_equal(back.responses, model.responses), "the self-test would not give the model's responses"
    assert back.place_names == model.place_names
    assert back.config == model.config


@pytest.mark.quick(1)
@pytest.mark.parametrize("mode", ["injected", "bias"])
def test_equal_models_give_equal_bundles(mode: str, tmp_path: Path) -> None:
    config = update(small_model().config, {"network": {"input_mode": mode}})
    for name in ("a", "b"):
        deploy(train([encoded(8)], config), KAPOHO_BAY, tmp_path / name)
    one, other = load(tmp_path / "a"), load(tmp_path / "b")
    assert one.files == other.files
    assert one.manifest == other.manifest
    text = json.dumps(one.manifest) + one.data("README.md").decode() + one.data("mapping.json").decode()
    assert str(tmp_path) not in text
    assert one.manifest["input"]["mode"] == mode
    assert one.manifest["clearing"]["input_writes_per_query"] == (3 * 1568 if mode == "bias" else 0)


def test_what_is_not_public_says_so(model: Model, tmp_path: Path) -> None:
    told = deploy(model, LOIHI_2, tmp_path / "b", picture=False).bundle
    assert told.manifest["limits"]["synapse_words"] == "unknown"
    assert told.manifest["clearing"]["mechanism"] == "LIFReset"
    assert told.json("mapping.json")["cores"][0]["load"]["nanoseconds"] == "unknown"
    assert told.json("mapping.json")["hops_per_step"] == "unknown"


def three(model: Model, seed: int) -> Presentations:
    """Three queries."""
    return query_presentations(model, encoded(3, seed=7), seed)


@pytest.mark.parametrize("board", BOARDS)
def test_bundles_take_biases_of_each_presentation(model: Model, board: str, tmp_path: Path) -> None:
    shown, spec = three(model, 3), model.network
    wanted = spec.bias - np.array([[0], [200], [60_000]])
    biased = replace(shown, bias=held_biases(wanted))
    deploy(model, BOARDS[board], tmp_path / "b", picture=False)
    backend, used = backends.get("bundle"), open_bundle(tmp_path / "b")
    counts, events = backend.count_spikes(used, biased)
    expected, told = HostBackend().count_spikes(model, biased)
    assert np.array_equal(counts, expected)
    assert events == told
    plain, _ = HostBackend().count_spikes(model, shown)
    assert np.array_equal(counts[0], plain[0])
    assert (counts[1:] != plain[1:]).any()
    trains, hosts = backend.trains(used, biased), HostBackend().trains(model, biased)
    for name in Trains.POPULATIONS:
        assert np.array_equal(getattr(trains, name), getattr(hosts, name)), name
    too_high = replace(shown, bias=np.full_like(wanted, spec.highest_bias + 1, np.int32))
    with pytest.raises(NetworkLimitError, match="spike without input"):
        backend.count_spikes(used, too_high)


def test_a_model_is_deployed_and_counts_what_the_host_counts(model: Model) -> None:
    shown = three(model, 3)
    seen: list[int] = []
    counts, events = backends.get("bundle", advance=seen.append).count_spikes(model, shown)
    expected, wanted = HostBackend().count_spikes(model, shown)
    assert np.array_equal(counts, expected)
    assert events == wanted
    assert counts.any()
    assert sum(seen) == 3


@pytest.mark.parametrize("board", BOARDS)
def test_memory_and_time_of_a_simulation_are_bounded(
    model: Model, board: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deploy(model, BOARDS[board], tmp_path / "b", picture=False)
    used, shown, one = open_bundle(tmp_path / "b"), three(model, 3), 128 * (8 + 1 + 1568)
    expected, _ = HostBackend().count_spikes(model, shown)
    seen: list[int] = []
    monkeypatch.setenv("LAVA_VPR_MAX_SIMULATION_BYTES", str(2 * one))
    counts, _ = backends.get("bundle", advance=seen.append).count_spikes(used, shown)
    assert seen == [1, 1, 1], "more at once than memory is allowed for"
    assert np.array_equal(counts, expected)
    with pytest.raises(
        NetworkLimitError, match=r"^to simulate every spike of 3 queries takes .* set LAVA_VPR_MAX_SIMUL"
    ):
        backends.get("bundle").trains(used, shown)
    monkeypatch.setenv("LAVA_VPR_MAX_SIMULATION_BYTES", str(2 * one - 1))
    said = (
        r"^to simulate a query of 125 steps to 8 neurons takes .*; if the file is sound, set .*, or run it on --backend"
    )
    with pytest.raises(NetworkLimitError, match=said):
        backends.get("bundle").count_spikes(used, shown)
    monkeypatch.delenv("LAVA_VPR_MAX_SIMULATION_BYTES")
    monkeypatch.setenv("LAVA_VPR_MAX_SIMULATION_OPERATIONS", str(128 * (8 * (1568 + 2) + 1568) - 1))
    with pytest.raises(NetworkLimitError, match=said):
        backends.get("bundle").count_spikes(used, shown)


def board_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if NxSDK were installed and a Kapoho Bay announced to it."""
    monkeypatch.setattr(board_program, "kapoho_bay_available", lambda: None)


def test_the_wrong_board_and_the_wrong_network_are_refused(
    model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    board_is_there(monkeypatch)
    deploy(model, LOIHI_2, tmp_path / "b", picture=False)
    with pytest.raises(BackendUnavailableError, match="is a bundle for loihi2, which kapoho-bay cannot run; deploy"):
        backends.require("kapoho-bay", open_bundle(tmp_path / "b"))
    floating = paper_model(4)
    for name in ("bundle", "kapoho-bay"):
        with pytest.raises(ConfigError, match=f"^{name} needs an integer network, but preset paper is the float"):
            backends.require(name, floating)
    with pytest.raises(ConfigError, match=r"^Kapoho Bay \(two Loihi 1 chips\) needs an integer network, but"):
        deploy(floating, KAPOHO_BAY, tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_verify_says_why_a_model_does_not_fit(model: Model) -> None:
    forgetful = replace(model, network=replace(model.network, decay=4096))
    (_, verdict) = verify(forgetful, encoded(8), np.eye(8, dtype=bool), names=("host", "bundle"))
    assert verdict.as_json()["available"] is False
    assert "decay 4096 does not fit" in str(verdict.reason)
    with pytest.raises(NetworkLimitError, match="decay 4096 does not fit"):
        backends.get("bundle").count_spikes(forgetful, three(model, 0))


class Counter:
    """A board that tells counts only, and may lose one."""

    def __init__(self, wrong: int) -> None:
        self.wrong = wrong

    def count_spikes(self, model: Model, shown: Presentations) -> tuple[NDArray[np.int32], dict[str, int]]:
        counts, events = HostBackend().count_spikes(model, shown)
        counts[2, 1] += self.wrong
        return counts, events


@pytest.mark.parametrize("wrong", [0, 1])
def test_a_backend_without_spikes_is_compared_by_its_counts(
    model: Model, wrong: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    board_is_there(monkeypatch)
    monkeypatch.setattr(backends, "get", lambda name, threads=1, advance=None: Counter(wrong))
    queries = encoded(8)
    host, verdict = verify(model, queries, np.eye(8, dtype=bool), names=("host", "kapoho-bay"))
    assert verdict.equal is (wrong == 0)
    assert verdict.differing == wrong
    assert 0 < verdict.spikes < host.spikes
    if wrong:
        counts = HostBackend().count_spikes(model, query_presentations(model, queries))[0]
        said = f"neuron 1: host {counts[2, 1]}, backend {counts[2, 1] + 1}"
        assert str(verdict.mismatch) == f"query {queries.names[2]}, population exc, {said}"


def test_commands_take_bundles(here: Path) -> None:
    run("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "b")
    for command, output in ((("eval", "QUERY"), "--json"), (("query", "QUERY"), "-o")):
        found = []
        for source, backend in (("m.lvpr", "host"), ("m.lvpr", "bundle"), ("b", "bundle"), ("b", "host")):
            run(command[0], source, "query", "--backend", backend, output, "out")
            found.append(Path("out").read_text().replace(f'"model": "{source}"', ""))
        assert len(set(found)) == 1, f"{command[0]} answers differently"
    text = run("verify", "b", "query", "--limit", 3, "--backend", "bundle", "--json", "v.json").stdout
    assert "every spike equal" in text
    verdict = json.loads(Path("v.json").read_text())["backends"]["bundle"]
    assert verdict["equal"] is True
    assert verdict["queries"] == 3
    assert verdict["spikes_compared"] > 1000
    assert verdict["spikes_compared"] == sum(verdict["spikes_by_population"].values())


def test_an_altered_bundle_is_refused_by_every_command(here: Path) -> None:
    run("deploy", "m.lvpr", "--target", "kapoho-bay", "-o", "b")
    file = Path("b/cores/chip0-core000/synapses.npy")
    file.write_bytes(file.read_bytes()[:-1] + b"\x01")
    for words in (("eval", "b", "query"), ("query", "b", "query", "-o", "q.csv"), ("verify", "b", "query")):
        result = CliRunner().invoke(main, [*words])
        assert result.exit_code == 1
        assert result.stderr == f"lava-vpr: error: {file}: was altered (checksum differs); {AGAIN}\n"
    shutil.rmtree("b")


AGAIN = "deploy the model again or fetch an intact copy"


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize("places", [100, 500])
@pytest.mark.parametrize("mode", ["injected", "bias"])
def test_a_hundred_real_queries_on_both_bundles(places: int, mode: str, data_root: Path, tmp_path: Path) -> None:
    """The default model of 100 and of 500 places, both input modes, deployed to both boards: every spike."""
    config = update(preset("loihi"), {"network": {"input_mode": mode}})
    model = learn((0, places), config)
    queries = real("winter", config.encoder).take(slice(0, 100))
    for board in BOARDS.values():
        deploy(model, board, tmp_path / board.name)
        own = open_bundle(tmp_path / board.name)
        (_, verdict) = verify(own, queries, np.eye(100, places, dtype=bool), names=("host", "bundle"))
        print(f"{places} places, {mode}, {board.name}: {verdict.spikes:,} spikes, {verdict.decided:,} of exc and inh")
        assert verdict.equal, verdict.mismatch
        assert verdict.queries == 100
        assert verdict.spikes > 120_000  # 61 steps of about 20 input spikes a query, and the neurons' own
        assert verdict.decided == verdict.spikes - verdict.compared["inputs"] > 1000
