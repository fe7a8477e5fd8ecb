"""Neurons that hear the cells of the front end themselves: the kernel spikes as all populations in one run do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from support.literal import front_end as literal

from lava_vpr.engine.inference.biases import held_biases
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.engine.inference.direct import SILENCING
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.whole import WholeNetwork
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.inputs.front_end import BURST, FrontEnd
from lava_vpr.loihi import INPUT_SHIFT


def spec_of(**numbers: int) -> FrontEnd:
    """A small front end whose cells are heard."""
    return FrontEnd(8, **{"reading": 4, "levels": 12, "race": 8, "budget": 60, "joined": 2, "needed": 3} | numbers)


def network_of(spec: FrontEnd, seed: int, neurons: int = 9, **changes: int) -> FixedNetwork:
    """A network of random weights and biases that hears the cells of ``spec``."""
    rng = np.random.default_rng(seed)
    made = FixedNetwork(
        weights=rng.integers(-7, 8, (spec.populations["cells"], neurons)).astype(np.int16),
        bias=(rng.integers(-200, 1, neurons) << INPUT_SHIFT).astype(np.int32),
        bits=3,
        signed=True,
        threshold=int(rng.integers(1, 400)),
        inhibition=int(rng.integers(0, 128)),
        inhibition_exponent=int(rng.integers(0, 3)),
        decay=int(rng.integers(0, 4097)),
        steps=spec.ticks,
        regular=True,
        rising=spec.rising,
        rise=int(rng.integers(0, 40)),
    )
    made = replace(made, **changes)
    made.check()
    return made


def images(seed: int, spec: FrontEnd) -> NDArray[np.uint8]:
    """Three images of much contrast, little and none, uint8 (3, height, width)."""
    rng = np.random.default_rng(seed)
    drawn = rng.integers(0, 256, (3, spec.height, spec.width))
    drawn[1] = 100 + drawn[1] // 8
    drawn[2] = 77
    return drawn.astype(np.uint8)


def bias_of_each(whole: WholeNetwork, n: int, seed: int) -> NDArray[np.int32]:
    """Biases of ``n`` presentations, some above 0 if the membranes decay."""
    highest, shape = whole.places.highest_bias, (n, whole.places.neurons)
    return held_biases(np.random.default_rng(seed).integers(-400 << INPUT_SHIFT, highest, shape, endpoint=True))


@pytest.mark.quick(1)
@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 1 << 32),
    levels=st.integers(2, 26),
    race=st.integers(2, 14),
    reading=st.integers(1, 16),
    budget=st.integers(1, 200),
    most=st.integers(1, 7),
    joined=st.sampled_from([1, 2]),
    needed=st.integers(1, 4),
)
def test_the_kernel_spikes_as_all_populations_do(seed: int, **numbers: int) -> None:
    numbers["needed"] = min(numbers["needed"], 2 * numbers["joined"])
    spec = spec_of(**numbers)
    whole = WholeNetwork.of(spec, network_of(spec, seed))
    shown, given = images(seed, spec), bias_of_each(whole, 3, seed) if seed % 2 else None
    films, own = literal.trains(whole, shown, given), whole.trains(shown, given)
    assert list(films) == ["clock", "pixels", "filters", "pairs", "onsets", "cells", "pools", "exc", "inh"]
    for name, film in films.items():
        assert np.array_equal(film, own[name]), name


def test_neurons_spike_in_steps_of_reading_and_are_silent_when_the_next_image_comes() -> None:
    spec = spec_of()
    whole = WholeNetwork.of(spec, network_of(spec, 1, threshold=5, inhibition=0, decay=300, rise=200))
    exc = whole.trains(images(2, spec))["exc"]
    assert exc[0, spec.end :].any(axis=1)[: spec.reading].all()
    assert not exc[:, spec.ticks :].any()


def test_no_bias_that_is_allowed_makes_a_neuron_spike_alone() -> None:
    spec = spec_of(reading=16)
    good = network_of(spec, 1, threshold=500, decay=341, rise=0)
    most = replace(good, bias=held_biases(np.full_like(good.bias, good.highest_bias)))
    blank, key = np.zeros((1, good.inputs), np.uint16), np.zeros(1, np.uint64)
    assert not count_spikes(most, blank, key)[0].any()
    assert count_spikes(replace(good, bias=2 * most.bias), blank, key)[0].any()


def test_currents_shrink_as_the_chips_do() -> None:
    """A neuron whose membrane is its current, which the bursts bring just above the threshold, soon stops."""
    spec = spec_of(reading=30)
    shown = images(8, spec)[:1]
    whole = 7 * int(spec.trains(shown)["cells"].sum())
    lone = network_of(spec, 9, neurons=1, threshold=whole - 1, decay=4096, inhibition=0, rise=0)
    made = WholeNetwork.of(spec, replace(lone, weights=np.full_like(lone.weights, 7), bias=0 * lone.bias))
    spikes = made.trains(shown)["exc"].sum()
    assert 0 < spikes < spec.reading
    assert np.array_equal(literal.trains(made, shown)["exc"], made.trains(shown)["exc"])


def test_bursts_are_when_cells_begin_and_how_often_they_spike() -> None:
    spec = spec_of()
    image = images(3, spec)[0]
    codes, cells = spec.burst_codes(spec.bursts(image)).ravel(), spec.trains(image[None])["cells"][0]
    assert np.array_equal(codes % BURST, cells.sum(axis=0))
    spiked = codes > 0
    assert spiked.any()
    assert np.array_equal(codes[spiked] // BURST, cells.argmax(axis=0)[spiked])


def test_bursts_of_altered_images_stay_within_the_race() -> None:
    spec = spec_of()
    codes = spec.burst_codes(np.random.default_rng(4).uniform(0, 20, 5000).astype(np.float32))
    first, counts = codes[codes > 0] // BURST, codes[codes > 0] % BURST
    assert counts.max() == spec.most
    assert first.min() >= spec.levels
    assert (first + counts).max() <= spec.end


def test_what_could_not_be_silenced_or_heard_is_refused() -> None:
    spec = spec_of()
    good = network_of(spec, 5, rise=0)
    many = replace(good, weights=np.full((SILENCING // 49 + 1, good.neurons), 7, np.int16), bias=0 * good.bias)
    with pytest.raises(NetworkLimitError, match="but the clock takes"):
        many.check()
    replace(many, weights=many.weights[1:]).check()
    with pytest.raises(NetworkLimitError, match="cells and the clock can bring a neuron"):
        replace(many, weights=many.weights[1:], rise=10).check()
    with pytest.raises(NetworkLimitError, match="fit no 12 bits and an exponent"):
        replace(good, bias=good.bias - (1 << 13) - 1).check()
    with pytest.raises(NetworkLimitError, match="makes its neuron spike without input"):
        replace(good, bias=held_biases(np.full_like(good.bias, 2 * good.highest_bias))).check()
    with pytest.raises(NetworkLimitError, match="cannot hear cells directly"):
        replace(good, rising=good.steps).check()
    with pytest.raises(NetworkLimitError, match="does not hear the cells of this front end"):
        WholeNetwork.of(spec_of(levels=13), good)
    with pytest.raises(ConfigError, match="at most 7 spikes"):
        spec_of(most=8)


def test_counts_do_not_depend_on_other_images_or_threads() -> None:
    spec = spec_of()
    network, shown = network_of(spec, 6, threshold=5, rise=200), images(7, spec)
    bursts = np.array([spec.burst_codes(spec.bursts(image)).ravel() for image in shown])
    keys = np.zeros(len(shown), np.uint64)
    together = count_spikes(network, bursts, keys, threads=2)
    alone = [count_spikes(network, bursts[k : k + 1], keys[:1])[0][0] for k in range(len(shown))]
    assert together[0].any()
    assert np.array_equal(together[0], np.array(alone))
    assert together[1]["input_spikes"] == (bursts % BURST).sum()
    assert together[1]["exc_spikes"] == together[0].sum()
