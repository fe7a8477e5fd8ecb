"""Networks of neurons of any model, step by step: LIF by its definition spikes and counts as the compiled kernel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lava_vpr.engine.inference import fixed, stepped
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.random import presentation_keys
from lava_vpr.errors import PluginError
from lava_vpr.neurons.models import NEURONS, NeuronConstants, NeuronModel, State, lif


@pytest.fixture(autouse=True)
def again() -> Iterator[None]:
    """With the neuron model ``again``, LIF by its definition."""
    NEURONS.register(NeuronModel("again", "LIF", lif))
    yield
    NEURONS.remove("again")


def network(rng: np.random.Generator, **changes: Any) -> FixedNetwork:
    """A random network of 12 inputs and 9 neurons that has something to do."""
    regular, neurons = bool(rng.integers(2)), 9
    made = FixedNetwork(
        weights=rng.integers(-7, 8, (12, neurons)).astype(np.int16),
        bias=np.zeros(neurons, np.int32),
        bits=3,
        signed=True,
        threshold=int(rng.integers(1, 30)),
        inhibition=int(rng.integers(0, 20)),
        inhibition_exponent=int(rng.integers(0, 2)),
        decay=int(rng.choice([0, 1, 341, 4096])),
        steps=20,
        regular=regular,
        bias_input=regular and bool(rng.integers(2)),
    )
    most = min(4095, made.highest_bias)
    return replace(made, bias=rng.integers(-most, most + 1, neurons).astype(np.int32), **changes)


def shown(rng: np.random.Generator, n: int = 5) -> tuple[NDArray[np.uint16], NDArray[np.uint64]]:
    """Rates and keys of presentations."""
    return rng.integers(0, 40000, (n, 12)).astype(np.uint16), presentation_keys(3, "query", np.arange(n))


@pytest.mark.parametrize("wiring", [(4096, 1024), (4, 1024), (4, 4)], ids=["direct", "leaves", "leaves and relays"])
def test_lif_by_its_definition_is_the_compiled_kernel(wiring: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fixed, "FAN_IN", wiring[0])
    monkeypatch.setattr(fixed, "DIRECT", wiring[1])
    monkeypatch.setattr(stepped, "TOGETHER", 3)
    spikes = inhibited = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        lif_network = network(rng)
        rates, keys = shown(rng)
        bias = None if seed % 2 else np.tile(lif_network.bias, (5, 1)) // rng.integers(1, 4, (5, 1)).astype(np.int32)
        for threads in (1, 2):
            expected = count_spikes(lif_network, rates, keys, bias=bias, raster=True)
            got = count_spikes(
                replace(lif_network, model="again"), rates, keys, bias=bias, threads=threads, raster=True
            )
            assert np.array_equal(got[0], expected[0]), seed
            assert got[1] == expected[1], seed
            assert np.array_equal(got[2], expected[2]), seed
        spikes, inhibited = spikes + int(got[0].sum()), inhibited + got[1]["inh_spikes"]
    assert min(spikes, inhibited) > 1000


@pytest.mark.parametrize(
    "step",
    [
        lambda constants, state, drive: (state, drive),  # no truth values
        lambda constants, state, drive: (state[0], drive > 0),  # an axis is missing
        lambda constants, state, drive: (state * 0.5, drive > 0),  # no whole numbers
        lambda constants, state, drive: (state, (drive > 0)[:, :1]),
    ],
)
def test_a_step_that_returns_something_else_is_refused(step: Any) -> None:
    rng = np.random.default_rng(0)
    NEURONS.register(NeuronModel("wrong", "of a test", step))
    try:
        with pytest.raises(
            PluginError, match=r"^neuron model 'wrong' must return whole numbers \(states, n, neurons\)"
        ):
            count_spikes(network(rng, model="wrong"), *shown(rng))
    finally:
        NEURONS.remove("wrong")


def test_a_step_is_given_what_it_is_told() -> None:
    rng, seen = np.random.default_rng(0), []

    def step(constants: NeuronConstants, state: State, drive: State) -> tuple[State, NDArray[np.bool_]]:
        seen.append((constants, state.shape, state.sum(), drive))
        return state + 1, np.zeros(drive.shape, bool)

    NEURONS.register(NeuronModel("seen", "of a test", step, states=3))
    try:
        made = network(rng, model="seen")
        count_spikes(made, *shown(rng, 2))
    finally:
        NEURONS.remove("seen")
    assert [number for _, _, number, _ in seen] == [2 * 9 * 3 * step for step in range(made.interval)]
    assert {(constants, shape) for constants, shape, _, _ in seen} == {
        (NeuronConstants(made.threshold << 6, made.decay), (3, 2, 9))
    }
    assert np.array_equal(seen[0][3], np.tile(made.bias, (2, 1)))
