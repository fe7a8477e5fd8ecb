"""Random networks, spike for spike and state for state: host engine, our Processes in Lava, and Lava's own library."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.fuzz.fuzz_networks import (
    BLOCKS_OF_GROUP,
    GROUPS_OF_START,
    KINDS,
    NETWORKS_OF_START,
    block_of,
    fused_of,
    input_of,
    place_of,
    steps_of,
)
from support.literal.integers import as_populations, literal_run

from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.general.simulation import INPUTS, GeneralNetwork, Population, Recording, Synapses, simulate
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError
from lava_vpr.isolated.runner import run_isolated
from lava_vpr.loihi import DECAY_BITS, INPUT_SHIFT, STATE_LIMIT


def events_of(network: GeneralNetwork, recording: Recording) -> dict[str, bool]:
    """What happened to the first population in a recorded run: u beyond 24 bits, v beyond its ends, a spike."""
    population = network.populations[0]
    constants = population.parameters.constants
    u, v, drive = (film[0].astype(np.int64) for film in (recording.film_u, recording.film_v, recording.film_drive))

    def decayed(x: NDArray[np.int64], keep: int) -> NDArray[np.int64]:
        """Of the step before."""
        before = np.concatenate([np.zeros_like(x[:1]), x[:-1]])
        if population.reset_interval:
            before[:: population.reset_interval] = 0
        return np.sign(before) * (np.abs(before) * keep >> DECAY_BITS)

    current = decayed(u, constants.keep_u) + (drive << INPUT_SHIFT)
    membrane = decayed(v, constants.keep_v) + u + population.bias
    return {
        "exactly 2^23": bool((np.abs(current) == STATE_LIMIT).any()),
        "wrapped": bool(((current > STATE_LIMIT) | (current <= -STATE_LIMIT)).any()),
        "saturated": bool((np.abs(membrane) >= STATE_LIMIT).any()),
        "spiked": bool(recording.spikes[0].any()),
    }


def compare_groups(seed: int, chosen: dict[int, Sequence[int]], *, timeout: float) -> Counter[str]:
    """Hold blocks of groups in Lava, by our Processes and its library, against the host; how many had which events."""
    starts: dict[int, list[Any]] = {}
    for group, blocks in chosen.items():
        starts.setdefault(group // GROUPS_OF_START, []).append([group, list(blocks)])
    found = run_isolated(
        "support.fuzz.fuzz_jobs:groups", {}, {"seed": seed, "starts": list(starts.values())}, timeout=timeout
    )
    seen: Counter[str] = Counter()
    for group, blocks in chosen.items():
        first, looks = 0, np.array(steps_of(seed, group)) - 1
        for number in blocks:
            block = block_of(seed, group, number)
            done = simulate(block.network, block.train, record=True)
            seen.update(["networks", *(name for name, did in events_of(block.network, done).items() if did)])
            part = slice(first, first + block.network.populations[0].size)
            first = part.stop
            states = {"spikes": done.spikes[0], "u": done.film_u[0][looks], "v": done.film_v[0][looks]}
            for kind, what in itertools.product(KINDS, states):
                same = np.array_equal(found[f"{group}_{kind}_{what}"][:, part], states[what])
                assert same, f"block_of({seed}, {group}, {number}): {kind} {what}"
        assert {found[f"{group}_{kind}_u"].shape[1] for kind in KINDS} == {first}, "neurons of no network"
    return seen


def refused(network: FixedNetwork) -> bool:
    """Whether it could wrap its currents."""
    try:
        FixedNetwork.check(network)
    except NetworkLimitError:
        return True
    return False


def compare_places(seed: int, chosen: dict[int, Sequence[int]], *, timeout: float) -> Counter[str]:
    """Hold place networks in Lava (composed, library, fused) against both host engines; how many had which events.

    Lava presents in a row. Where what is taken wraps it excites, and spikes may still be under way when the silent
    steps are over; then only presentations each by itself equal the engine's.
    """
    starts = [[start, list(numbers)] for start, numbers in chosen.items()]
    found = run_isolated("support.fuzz.fuzz_jobs:places", {}, {"seed": seed, "starts": starts}, timeout=timeout)
    seen: Counter[str] = Counter()
    for start, numbers in chosen.items():
        given = input_of(seed, start)
        for number in numbers:
            network, name = place_of(seed, start, number), f"place_of({seed}, {start}, {number})"
            spec = as_populations(network)
            _, _, film = count_spikes(network, given.rates, given.keys, raster=True)
            alone = [simulate(spec, train).spikes[0] for train in np.split(given.trains, len(film))]
            row = simulate(spec, given.trains, record=True)
            in_a_row, wraps = row.spikes[0].reshape(film.shape), refused(network)
            kept = wraps and not np.array_equal(in_a_row, film)
            events = events_of(spec, row) | {"refused": wraps, "not over after the silent steps": kept}
            seen.update(["networks", *(name for name, did in events.items() if did)])
            assert np.array_equal(alone, film), name
            if number == fused_of(start, numbers):
                assert np.array_equal(found[f"{start}_fused_spikes"], film), name
            expected = {"spikes": in_a_row if kept else film, "u": row.u[0], "v": row.v[0]}
            for kind, what in itertools.product(KINDS, expected):
                same = np.array_equal(found[f"{start}_{number}_{kind}_{what}"], expected[what])
                assert same, f"{name}: {kind} {what}"
    return seen


def judge(seen: Counter[str], networks: int, enough: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Each of the events ``enough`` in a tenth of the networks, none of which differs."""
    with capsys.disabled():
        print("\n" + ", ".join(f"{n} {name}" for name, n in sorted(seen.items())))
    assert seen["networks"] == networks
    assert min(seen[name] for name in enough) * 10 >= networks


@pytest.mark.lava
def test_100_random_networks_equal_lavas_library(capsys: pytest.CaptureFixture[str]) -> None:
    seen = compare_groups(1, dict.fromkeys(range(4), range(BLOCKS_OF_GROUP)), timeout=400)
    judge(seen, 100, ["wrapped", "saturated", "spiked"], capsys)
    assert seen["exactly 2^23"] > 0


@pytest.mark.lava
@pytest.mark.slow
def test_2000_random_networks_equal_lavas_library(capsys: pytest.CaptureFixture[str]) -> None:
    seen = compare_groups(2, dict.fromkeys(range(80), range(BLOCKS_OF_GROUP)), timeout=1700)
    judge(seen, 2000, ["wrapped", "saturated", "spiked"], capsys)


@pytest.mark.lava
def test_random_place_networks_equal_lavas_library(capsys: pytest.CaptureFixture[str]) -> None:
    seen = compare_places(1, {0: (0, 1), 1: (1, 2)}, timeout=400)
    judge(seen, 4, ["wrapped", "refused", "spiked"], capsys)


@pytest.mark.lava
@pytest.mark.slow
def test_many_random_place_networks_equal_lavas_library(capsys: pytest.CaptureFixture[str]) -> None:
    seen = compare_places(2, dict.fromkeys(range(10), range(NETWORKS_OF_START)), timeout=1700)
    judge(seen, 40, ["wrapped", "refused", "saturated", "spiked"], capsys)


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


def refusal(change: dict[str, Any], **synapses: Any) -> str:
    """The error of a network of three inputs and two neurons with this changed."""
    population = Population(**{"threshold": np.array([5, 6]), **change})
    given = {"source": INPUTS, "target": 0, "weights": np.ones((3, 2), np.int64), **synapses}
    network = GeneralNetwork(3, (population,), (Synapses(**given),))
    with pytest.raises(NetworkLimitError) as caught:
        simulate(network, np.zeros((4, 3), bool))
    return str(caught.value)


def test_networks_that_do_not_fit_are_refused() -> None:
    assert "weights are (2, 3), but must be (pre, post) = (3, 2)" in refusal({}, weights=np.ones((2, 3), np.int64))
    assert "synapses 0: source is 1, but must be in -1..0" in refusal({}, source=1)
    assert "synapses 0: target is -1, but must be in 0..0" in refusal({}, target=-1)
    assert "synapses 0: exponent is 8, but must be in -7..7" in refusal({}, exponent=8)
    assert "excitatory weight is 256" in refusal({}, weights=np.full((3, 2), 256))
    assert "num_weight_bits is 9, but must be in 1..8" in refusal({}, bits=9)
    assert "threshold is 131072" in refusal({"threshold": np.array([5, 1 << 17])})
    assert "population 0: threshold's shape is (1, 2), but must be (n,)" in refusal({"threshold": np.ones((1, 2))})
    assert "bias mantissa" in refusal({"bias_mant": np.array([0, 4096])})
    assert "population 0: bias_exp's shape is (3,), but must be (2,)" in refusal({"bias_exp": np.zeros(3, np.int64)})
    assert "du is 4096" in refusal({"parameters": LifParameters(du=4096)})
    assert "population 0: reset_interval is -1" in refusal({"reset_interval": -1})
    network = GeneralNetwork(3, (), ())
    with pytest.raises(NetworkLimitError, match=r"input spikes are int64 \(4, 3\), but must be bool \(steps, 3\)"):
        simulate(network, np.zeros((4, 3), np.int64))  # type: ignore[arg-type]
