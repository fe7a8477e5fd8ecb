"""Random networks, partitioned: every limit holds, counted from the bundle's bytes; every spike is the engine's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.fuzz.fuzz_deploy import (
    cores_of,
    matrices,
    memory_bundle,
    model_of,
    random_board,
    random_network,
    tables_of,
    violations,
)
from support.fuzz.fuzz_deploy import wanted as wanted_of

from lava_vpr.backends.host import HostBackend
from lava_vpr.backends.interface import Presentations
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.bundle import folder as bundle_folder
from lava_vpr.deploy.bundle.deployment import contents
from lava_vpr.deploy.bundle.folder import load, sealed
from lava_vpr.deploy.bundle.targets import TARGETS
from lava_vpr.encoding import query_rates
from lava_vpr.engine.inference import fixed
from lava_vpr.errors import NetworkLimitError

SEEDS = 5000
"""Most that are tried to find as many as fit."""


def partitioned(wanted: int, start: int = 0) -> dict[str, int]:
    """Deploy random networks until ``wanted`` fit; what was seen."""
    seen = {"fit": 0, "refused": 0, "cores": 0, "several": 0, "chips": 0, "bias inputs": 0}
    seen |= dict.fromkeys(("signed", "biases", "relayed", "leaves"), 0)
    for seed in range(start, start + SEEDS):
        rng = np.random.default_rng(seed)
        network = random_network(rng, large=seed % 8 == 0)
        board = random_board(rng, network)
        try:
            manifest, files, _ = contents(model_of(network), board, picture=False, dense_rows=bool(seed % 2))
        except NetworkLimitError:
            seen["refused"] += 1
            continue
        bundle = memory_bundle(sealed(manifest, files), files)
        cores, tables = cores_of(bundle), tables_of(bundle)
        assert violations(cores, board, tables) == [], f"seed {seed}"
        expected = wanted_of(network)
        for ways, found in matrices(cores, tables, network.inputs).items():
            assert np.array_equal(found, expected.get(ways, 0 * found)), f"seed {seed}: {ways}"
        seen["fit"] += 1
        seen["cores"] += len(cores)
        seen["several"] += len(cores) > 1
        seen["chips"] += len({core.chip for core in cores}) > 1
        seen["bias inputs"] += network.bias_input
        seen["signed"] += network.signed
        seen["biases"] += bool(network.bias.any())
        seen["relayed"] += network.relayed
        seen["leaves"] += network.leaves > 0
        if seen["fit"] == wanted:
            return seen
    raise AssertionError(f"only {seen} of {wanted} fit")


def test_every_limit_holds_of_forty_random_networks() -> None:
    seen = partitioned(40, start=100)
    assert seen["several"] > 8
    assert seen["chips"] > 0
    assert seen["bias inputs"] > 5
    assert min(seen["signed"], seen["biases"]) > 8


@pytest.fixture
def small_fan_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few neurons are many: there are leaves and relays."""
    monkeypatch.setattr(fixed, "FAN_IN", 16)
    monkeypatch.setattr(fixed, "DIRECT", 8)


@pytest.mark.usefixtures("small_fan_in")
def test_every_limit_holds_of_twenty_networks_with_leaves_and_relays() -> None:
    seen = partitioned(20, start=300)
    assert seen["relayed"] > 3
    assert seen["leaves"] > 5


@pytest.mark.slow
def test_every_limit_holds_of_a_thousand_random_networks() -> None:
    seen = partitioned(1000, start=10_000)
    print(seen)
    assert seen["several"] > 200
    assert seen["chips"] > 5
    assert seen["bias inputs"] > 100


def simulated(wanted: int, start: int) -> tuple[int, int]:
    """Compare the bundle's simulation with the engine; spikes of exc, and networks that took several cores."""
    spikes, several, done = 0, 0, 0
    for seed in range(start, start + SEEDS):
        rng = np.random.default_rng(seed)
        network = random_network(rng, large=seed % 10 == 0)
        model = model_of(network)
        try:
            board = random_board(rng, network)
            manifest, files, plan = contents(model, board, picture=False, dense_rows=bool(seed % 2))
        except NetworkLimitError:
            continue
        rates = query_rates(model.activity, model.config)
        shown = Presentations(rates, 1)
        host = HostBackend().trains(model, shown)
        exc, inh, inputs = TARGETS[manifest["target"]].player(memory_bundle(sealed(manifest, files), files))(
            rates, shown.keys
        )
        assert np.array_equal(exc, host.exc), f"seed {seed}"
        assert np.array_equal(inputs, host.inputs), f"seed {seed}"
        assert np.array_equal(inh, host.inh), f"seed {seed}"
        spikes += int(exc.sum())
        several += len(plan.cores) > 1
        done += 1
        if done == wanted:
            return spikes, several
    raise AssertionError(f"only {done} of {wanted} fit")


def test_every_spike_of_ten_random_networks() -> None:
    spikes, several = simulated(10, 50_000)
    assert spikes > 100
    assert several > 0


@pytest.mark.usefixtures("small_fan_in")
def test_every_spike_of_ten_networks_with_leaves_and_relays() -> None:
    spikes, several = simulated(10, 70_000)
    assert spikes > 100
    assert several > 0


@pytest.mark.slow
def test_every_spike_of_eighty_random_networks() -> None:
    spikes, several = simulated(80, 60_000)
    print(spikes, several)
    assert spikes > 1000
    assert several > 10


def test_a_random_bundle_on_disk_gives_its_network_back(tmp_path: Path) -> None:
    for seed in range(3):
        network = random_network(np.random.default_rng(seed), large=False)
        manifest, files, _ = contents(model_of(network), KAPOHO_BAY, picture=False)
        bundle_folder.write(tmp_path / str(seed), manifest, files)
        assert load(tmp_path / str(seed)).files == files
        bundle = load(tmp_path / str(seed))
        back = TARGETS[bundle.target].network(bundle)
        assert np.array_equal(back.weights, network.weights)
        assert np.array_equal(back.bias, network.bias)
        assert back.scalars == network.scalars


def test_a_violation_is_seen() -> None:
    """The independent count must be able to fail: one word too many, one threshold too high."""
    network = random_network(np.random.default_rng(5), large=False)
    manifest, files, _ = contents(model_of(network), KAPOHO_BAY, picture=False)
    bundle = memory_bundle(sealed(manifest, files), files)
    cores, tables = cores_of(bundle), tables_of(bundle)
    assert violations(cores, KAPOHO_BAY, tables) == []
    cores[0].registers["vthProfileCfg"][0]["vth"] = 1 << 17
    cores[0].registers["cxProfileCfg"] *= 40
    texts = " ".join(violations(cores, KAPOHO_BAY, tables))
    assert "threshold" in texts
    assert "profiles" in texts
