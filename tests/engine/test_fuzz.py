"""Random networks, spike for spike and state for state: host engine, our Processes in Lava, and Lava's own library."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.fuzz.fuzz_compare import Comparison, all_groups, all_places, compare_groups, compare_places
from support.fuzz.fuzz_networks import block_of
from support.fuzz.fuzz_places import input_of, place_of
from support.literal.integers import as_populations, literal_run

from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.general.simulation import INPUTS, GeneralNetwork, Population, Synapses, simulate
from lava_vpr.errors import NetworkLimitError


def judge(found: Comparison, networks: int, enough: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """No difference, and each of the events ``enough`` in a tenth of the networks."""
    with capsys.disabled():
        print(f"\n{found}")
    assert found.differences == []
    assert found.networks == networks
    assert min(found.events[name] for name in enough) * 10 >= networks


@pytest.mark.lava
def test_100_random_networks_equal_lavas_library(capsys: pytest.CaptureFixture[str]) -> None:
    found = compare_groups(1, all_groups(4), timeout=400)
    judge(found, 100, ["wrapped", "saturated", "spiked"], capsys)
    assert found.events["exactly 2^23"] > 0


@pytest.mark.lava
@pytest.mark.slow
def test_2000_random_networks_equal_lavas_library(capsys: pytest.CaptureFixture[str]) -> None:
    found = compare_groups(2, all_groups(80), timeout=1700)
    judge(found, 2000, ["wrapped", "saturated", "spiked"], capsys)


@pytest.mark.lava
def test_random_place_networks_equal_lavas_library(capsys: pytest.CaptureFixture[str]) -> None:
    found = compare_places(1, {0: (0, 1), 1: (1, 2)}, timeout=400)
    judge(found, 4, ["wrapped", "refused", "spiked"], capsys)


@pytest.mark.lava
@pytest.mark.slow
def test_many_random_place_networks_equal_lavas_library(capsys: pytest.CaptureFixture[str]) -> None:
    found = compare_places(2, all_places(10), timeout=1700)
    judge(found, 40, ["wrapped", "refused", "saturated", "spiked"], capsys)


def hold_against_literal(network: GeneralNetwork, train: NDArray[np.bool_]) -> None:
    """Spikes and final states of the kernels, and of plain integers."""
    done, (films, u, v) = simulate(network, train), literal_run(network, train)
    assert all(np.array_equal(a, b) for a, b in zip(done.spikes, films, strict=True))
    assert [x.tolist() for x in done.u] == u
    assert [x.tolist() for x in done.v] == v


@pytest.mark.parametrize("group", range(8))
def test_the_host_equals_plain_integers(group: int) -> None:
    for number in range(0, 25, 2):
        block = block_of(1, group, number)
        hold_against_literal(block.network, block.train)


@pytest.mark.parametrize("number", range(4))
def test_the_host_equals_plain_integers_for_place_networks(number: int) -> None:
    hold_against_literal(as_populations(place_of(1, 0, number)), input_of(1, 0).trains)


def learning_like(seed: int) -> tuple[GeneralNetwork, NDArray[np.bool_]]:
    """Two populations in a loop, with everything that Lava's LIF lacks: thresholds each, floor, hold, theta, resets."""
    rng = np.random.default_rng([seed, 5])
    sizes, synapses = (int(rng.integers(1, 6)), int(rng.integers(1, 6))), []
    for source, target, sign in ((INPUTS, 0, "excitatory"), (0, 1, "null"), (1, 0, "inhibitory"), (1, 1, "mixed")):
        pre = 6 if source == INPUTS else sizes[source]
        weights = rng.integers(0, 256, (pre, sizes[target])) * (-1 if sign == "inhibitory" else 1)
        bits, exponent = int(rng.integers(3, 9)), int(rng.integers(-3, 4))
        synapses.append(Synapses(source, target, weights, bits, exponent, sign))  # type: ignore[arg-type]
    populations = [
        Population(
            rng.integers(0, 2000, size),
            rng.integers(-4096, 4096, size),
            rng.integers(-7, 3, size),
            LifParameters(*rng.integers(0, 4096, 2).tolist(), -int(rng.integers(0, 500)), int(rng.integers(1, 4)), 50),
            int(rng.integers(0, 12)),
        )
        for size in sizes
    ]
    return GeneralNetwork(6, tuple(populations), tuple(synapses)), rng.random((40, 6)) < 0.4


def test_the_host_equals_plain_integers_with_floors_holds_rising_thresholds_and_resets() -> None:
    spikes = 0
    for seed in range(20):
        network, train = learning_like(seed)
        hold_against_literal(network, train)
        done = simulate(network, train)
        spikes += sum(int(film.sum()) for film in done.spikes)
        for population, film, raised in zip(network.populations, done.spikes, done.threshold, strict=True):
            assert np.array_equal(raised, population.threshold + 50 * film.sum(axis=0))
    assert spikes > 400


def test_a_recorded_run_is_the_same_run() -> None:
    network, train = learning_like(0)
    plain, recorded = simulate(network, train), simulate(network, train, record=True)
    for k in range(2):
        assert np.array_equal(plain.spikes[k], recorded.spikes[k])
        assert np.array_equal(plain.u[k], recorded.film_u[k][-1])
        assert np.array_equal(plain.v[k], recorded.film_v[k][-1])
    rows = network.synapses[0].rows
    assert plain.film_u == plain.film_v == plain.film_drive == ()
    assert not recorded.film_drive[0][0].any()
    first = rows[train[0]].sum(axis=0)  # nothing else has spiked before step 1 but by its bias
    exponent = network.synapses[0].exponent
    if not recorded.spikes[1][0].any():
        expected = first << exponent if exponent > 0 else first >> -exponent
        assert np.array_equal(recorded.film_drive[0][1], expected)


def test_a_difference_names_its_network_and_the_first_place() -> None:
    found = Comparison()
    found.expect("general 1 2 3", "library", "u", np.array([[1, 2], [3, 5]]), np.array([[1, 2], [3, 4]]))
    found.expect("places 1 2 3", "fused", "spikes", np.zeros((2, 3)), np.zeros((3, 2)))
    found.expect("general 1 2 4", "ours", "v", np.zeros(2), np.zeros(2))
    assert found.differences == [
        "general 1 2 3: library: u differs from the host's in 1 places, first at (1, 1): 5, not 4; "
        "alone: python tests/support/fuzz/fuzz_compare.py general 1 2 3",
        "places 1 2 3: fused: spikes has shape (2, 3), not (3, 2)",
    ]


def refused(change: dict[str, Any], **synapses: Any) -> str:
    """The error of a network of three inputs and two neurons with this changed."""
    population = Population(**{"threshold": np.array([5, 6]), **change})
    given = {"source": INPUTS, "target": 0, "weights": np.ones((3, 2), np.int64), **synapses}
    network = GeneralNetwork(3, (population,), (Synapses(**given),))
    with pytest.raises(NetworkLimitError) as caught:
        simulate(network, np.zeros((4, 3), bool))
    return str(caught.value)


def test_networks_that_do_not_fit_are_refused() -> None:
    assert "weights are (2, 3), but must be (pre, post) = (3, 2)" in refused({}, weights=np.ones((2, 3), np.int64))
    assert "synapses 0: source is 1, but must be in -1..0" in refused({}, source=1)
    assert "synapses 0: target is -1, but must be in 0..0" in refused({}, target=-1)
    assert "synapses 0: exponent is 8, but must be in -7..7" in refused({}, exponent=8)
    assert "excitatory weight is 256" in refused({}, weights=np.full((3, 2), 256))
    assert "num_weight_bits is 9, but must be in 1..8" in refused({}, bits=9)
    assert "threshold is 131072" in refused({"threshold": np.array([5, 1 << 17])})
    assert "population 0: threshold's shape is (1, 2), but must be (n,)" in refused({"threshold": np.ones((1, 2))})
    assert "bias mantissa" in refused({"bias_mant": np.array([0, 4096])})
    assert "population 0: bias_exp's shape is (3,), but must be (2,)" in refused({"bias_exp": np.zeros(3, np.int64)})
    assert "du is 4096" in refused({"parameters": LifParameters(du=4096)})
    assert "population 0: reset_interval is -1" in refused({"reset_interval": -1})
    network = GeneralNetwork(3, (), ())
    with pytest.raises(NetworkLimitError, match=r"input spikes are int64 \(4, 3\), but must be bool \(steps, 3\)"):
        simulate(network, np.zeros((4, 3), np.int64))  # type: ignore[arg-type]
