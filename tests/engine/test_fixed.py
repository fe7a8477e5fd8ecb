"""The integer network against a literal version, and its limits."""

from __future__ import annotations

import dataclasses
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from support.literal.integers import as_populations, present_fixed

from lava_vpr.engine.general.simulation import simulate
from lava_vpr.engine.inference import counting, fixed
from lava_vpr.engine.inference.biases import bias_input_spikes
from lava_vpr.engine.inference.counting import count_spikes, inhibitory_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.membranes import membranes
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.rates import draw_spikes
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import INPUT_LIMIT, LOIHI_1_INPUT_LIMIT, STATE_LIMIT

IMAGES = 2


def registers(rng: np.random.Generator, neurons: int, highest: int) -> NDArray[np.int32]:
    """Biases as registers hold them, mantissas of 12 bits and one exponent; some as high as they may be."""
    exponent = int(rng.integers(0, 8))
    top = min(4095, highest >> exponent)
    mantissas = rng.choice([-4095, -1, 0, top, int(rng.integers(-4095, top + 1))], neurons)
    return (mantissas << exponent).astype(np.int32)


def random_network(seed: int, **changes: Any) -> FixedNetwork:
    rng = np.random.default_rng(seed)
    signed, regular = bool(rng.integers(2)), bool(rng.integers(2))
    bits = int(rng.integers(1, 8 if signed else 9))
    inputs, neurons = int(rng.integers(1, 40)), int(rng.integers(1, 12))
    top = 1 << bits
    weights = rng.integers(1 - top if signed else 0, top, (inputs, neurons))
    weights *= rng.random((inputs, neurons)) < rng.random()
    network = FixedNetwork(
        weights=weights.astype(np.int16),
        bias=np.zeros(neurons, np.int32),
        bits=bits,
        signed=signed,
        threshold=int(rng.integers(1, 60)),
        inhibition=int(rng.integers(0, 256)),
        inhibition_exponent=int(rng.choice([0, 0, 0, 2, 7])),
        decay=int(rng.integers(0, 4097)),
        steps=int(rng.integers(1, 40)),
        regular=regular,
        bias_input=regular and bool(rng.integers(2)),
    )
    network = dataclasses.replace(network, **changes)
    return dataclasses.replace(network, bias=registers(rng, neurons, network.highest_bias))


def wired(fan_in: int, direct: int) -> Any:
    """The network as if inhibitory neurons listened to so few, and injected spikes reached so few directly."""
    return mock.patch.multiple(fixed, FAN_IN=fan_in, DIRECT=direct)


def shown(network: FixedNetwork, seed: int) -> tuple[NDArray[np.uint16], NDArray[np.uint64], NDArray[np.bool_]]:
    """Rates, keys, and the input spikes of each presentation, bool (n, steps, inputs), by their definitions."""
    rates = np.random.default_rng(seed + 1).integers(0, 40000, (IMAGES, network.inputs)).astype(np.uint16)
    keys = presentation_keys(seed, "query", np.arange(IMAGES))
    spikes_of = bias_input_spikes if network.regular else draw_spikes
    return rates, keys, np.array([spikes_of(r, int(k), network.steps) for r, k in zip(rates, keys, strict=True)])


def counted(network: FixedNetwork, spikes: NDArray[np.bool_], exc: NDArray[Any], inh: NDArray[Any]) -> dict[str, int]:
    """The events, spike by spike."""
    events = dict.fromkeys(counting.EVENTS, 0)
    for presentation, step, j in np.argwhere(spikes):
        assert step < network.steps <= network.interval, presentation
        reached = [i for i in range(network.neurons) if network.weights[j, i] != 0]
        relays = 1 if network.relayed else 0
        events["synaptic_operations"] += len(reached) + relays
        events["synaptic_operations_dense"] += network.neurons + relays
        events["neuron_updates"] += relays
        events["input_spikes"] += 1
        events["messages"] += 1 + relays
    for _ in np.argwhere(exc):  # each to its leaf, or to the root
        for name in ("synaptic_operations", "synaptic_operations_dense", "exc_spikes", "messages"):
            events[name] += 1
    for _, _, neuron in np.argwhere(inh):  # a leaf to the root, the root to all
        reached_by = network.neurons if neuron == network.inhibitory - 1 else 1
        events["synaptic_operations"] += reached_by
        events["synaptic_operations_dense"] += reached_by
        for name in ("neuron_updates", "inh_spikes", "messages"):
            events[name] += 1
    events["steps"] = len(spikes) * network.interval
    events["neuron_updates"] += len(spikes) * network.neurons * (network.interval - 1)
    return events


def compare(network: FixedNetwork, seed: int, *, checked: bool = True) -> NDArray[np.int32]:
    """Every spike and event against the literal version; spike counts int32 (IMAGES, neurons).

    Of a network that `FixedNetwork.check` would refuse, inhibition can excite for ever, and events are not compared.
    """
    rates, keys, spikes = shown(network, seed)
    counts, events, film = count_spikes(network, rates, keys, raster=True)
    literal = [present_fixed(network, train) for train in spikes]
    exc, inh = (np.array(films) for films in zip(*literal, strict=True))
    assert film.shape == (IMAGES, network.interval, network.neurons)
    assert np.array_equal(film, exc)
    assert np.array_equal(inhibitory_spikes(network, film), inh)
    assert np.array_equal(counts, exc.sum(axis=1))
    assert not checked or events == counted(network, spikes, exc, inh)
    return counts


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 2**31))
def test_equals_the_literal_network(seed: int) -> None:
    compare(random_network(seed), seed)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 2**31), st.integers(1, 6), st.integers(0, 12))
def test_leaves_and_relays_equal_the_literal_network(seed: int, fan_in: int, direct: int) -> None:
    with wired(fan_in, direct):
        compare(random_network(seed), seed)


@pytest.mark.parametrize(
    ("bits", "signed"), [*((bits, False) for bits in range(1, 9)), *((bits, True) for bits in range(1, 8))]
)
def test_every_width_equals_the_literal_network(bits: int, signed: bool) -> None:
    rng = np.random.default_rng(bits)
    top = (1 << bits) - 1
    weights = rng.choice([-top if signed else 0, 0, top, top], (20, 5)).astype(np.int16)
    base = random_network(5, decay=300, threshold=5 * top, inhibition=4 * bits, inhibition_exponent=0, steps=29)
    network = dataclasses.replace(
        base, weights=weights, bits=bits, signed=signed, bias=registers(rng, 5, base.highest_bias)
    )
    network.check()
    assert compare(network, bits).any()


def test_random_networks_spike_often_enough_to_mean_something() -> None:
    spiked = sum(bool(compare(random_network(seed), seed).any()) for seed in range(20))
    assert spiked >= 10


def test_currents_wrap_as_lavas_do() -> None:
    wrapping = random_network(12, inhibition=255, inhibition_exponent=10, threshold=1)
    assert wrapping.lateral > INPUT_LIMIT
    assert compare(wrapping, 12, checked=False).sum() > 20


def test_a_bounded_network_needs_no_register_ends_and_others_are_watched() -> None:
    bounded = 0
    for seed in range(60):
        network = random_network(seed, decay=4 * seed, inhibition=255, inhibition_exponent=seed % 9)
        rates, keys, _ = shown(network, seed)
        found = count_spikes(network, rates, keys, raster=True)[2]
        with mock.patch.object(FixedNetwork, "bounded", return_value=False):
            assert np.array_equal(count_spikes(network, rates, keys, raster=True)[2], found)
        bounded += network.bounded(network.bias)
    assert 10 < bounded < 50
    network = random_network(3, decay=4096)
    assert network.bounded(network.bias)
    assert not network.bounded(np.full((1, network.neurons), -STATE_LIMIT, np.int32))
    assert not dataclasses.replace(network, decay=0).bounded(network.bias)


@pytest.mark.parametrize("sign", [1, -1])
def test_32_bit_accumulator_takes_over_where_16_bits_would_overflow(sign: int) -> None:
    weights = np.full((500, 2), 127, np.int16)
    weights[:, 0] *= sign
    base = FixedNetwork(weights, np.zeros(2, np.int32), 7, True, 20_000, 5, 0, 100, 6)
    assert not base.narrow
    assert dataclasses.replace(base, weights=weights[:200]).narrow
    rates = np.full((1, 500), 50_000, np.uint16)
    keys = presentation_keys(0, "query", np.arange(1))
    spikes = draw_spikes(rates[0], int(keys[0]), base.steps)
    assert 127 * spikes.sum(axis=1).min() > 1 << 15
    counts, _, film = count_spikes(base, rates, keys, raster=True)
    assert counts[0, 1] > 0
    assert (counts[0, 0] > 0) == (sign > 0)
    assert np.array_equal(film[0], present_fixed(base, spikes)[0])


@pytest.mark.parametrize("fan_in", [3, 4096])
def test_membranes_are_worked_out_again(fan_in: int) -> None:
    with wired(fan_in, 4):
        network = random_network(21, threshold=9)
        rates, keys, spikes = shown(network, 21)
        _, _, film = count_spikes(network, rates, keys, raster=True)
        assert film.any()
        inh = inhibitory_spikes(network, film)
        silence = np.zeros((network.silent_steps, network.inputs), bool)
        for one, train in enumerate(spikes):
            whole = np.concatenate([train, silence])
            found = membranes(network, whole.view(np.uint8), inh[one])
            assert np.array_equal(found.fired, film[one])
            assert np.array_equal(found.after, simulate(as_populations(network), whole, record=True).film_v[0])


def test_a_bias_of_each_presentation_is_that_of_a_network() -> None:
    network = random_network(6, steps=30, decay=400, threshold=30)
    rates, keys, _ = shown(network, 6)
    rng = np.random.default_rng(4)
    bias = np.stack([registers(rng, network.neurons, network.highest_bias) for _ in range(IMAGES)])
    bias = (np.sign(bias) * (np.abs(bias) >> 7 << 7)).astype(np.int32)  # one exponent holds both rows
    counts, events, film = count_spikes(network, rates, keys, bias=bias, raster=True)
    alone = [
        count_spikes(dataclasses.replace(network, bias=row), rates[k : k + 1], keys[k : k + 1], raster=True)
        for k, row in enumerate(bias)
    ]
    assert not np.array_equal(counts, count_spikes(network, rates, keys)[0])
    assert np.array_equal(counts, np.concatenate([one[0] for one in alone]))
    assert np.array_equal(film, np.concatenate([one[2] for one in alone]))
    assert events == {name: sum(one[1][name] for one in alone) for name in events}
    for threads in (1, 2):
        assert np.array_equal(count_spikes(network, rates, keys, bias=bias, threads=threads)[0], counts)
    with pytest.raises(NetworkLimitError, match="makes its neuron spike without input"):
        count_spikes(network, rates, keys, bias=np.full_like(bias, (network.highest_bias >> 7) + 1 << 7))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.integers(0, 2**31))
def test_no_neuron_spikes_by_its_bias_alone_but_with_one_more_it_does(seed: int) -> None:
    network = random_network(seed, steps=2000, decay=int(np.random.default_rng(seed).integers(20, 4096)), threshold=7)
    rates, keys = np.zeros((1, network.inputs), np.uint16), np.ones(1, np.uint64)
    highest = np.full(network.neurons, network.highest_bias, np.int32)
    assert not count_spikes(dataclasses.replace(network, bias=highest), rates, keys)[0].any()
    # What the decay's rounding leaves standing lets the membrane rise above: at most a unit a step is lost.
    beyond = highest + np.int32(2)
    assert count_spikes(dataclasses.replace(network, bias=beyond), rates, keys)[0].any()


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.integers(0, 2**31), st.integers(20, 370))
def test_a_safe_bias_is_silent_where_the_chip_decays_a_unit_less_and_the_highest_is_not(seed: int, decay: int) -> None:
    network = random_network(seed, steps=2000, decay=decay, threshold=700)
    rates, keys = np.zeros((1, network.inputs), np.uint16), np.ones(1, np.uint64)
    spikes = []
    for bias in (network.safe_bias, network.highest_bias):
        slower = dataclasses.replace(network, bias=np.full(network.neurons, bias, np.int32), decay=decay - 1)
        with mock.patch.object(FixedNetwork, "check"):  # the highest is refused at that decay
            spikes.append(count_spikes(slower, rates, keys)[0].any())
    assert spikes == [False, True]


def test_threads_batches_and_order_do_not_matter() -> None:
    network = random_network(12, steps=50, threshold=5)
    rates = np.random.default_rng(1).integers(0, 20000, (65, network.inputs)).astype(np.uint16)
    ids = np.arange(65)
    keys = presentation_keys(0, "query", ids)
    whole, events, _ = count_spikes(network, rates, keys)
    assert whole.any()
    two, two_events, _ = count_spikes(network, rates, keys, threads=2)
    assert np.array_equal(whole, two)
    assert events == two_events
    singles = np.concatenate([count_spikes(network, rates[i : i + 1], keys[i : i + 1])[0] for i in ids])
    assert np.array_equal(whole, singles)
    order = np.random.default_rng(2).permutation(65)
    assert np.array_equal(count_spikes(network, rates[order], keys[order])[0], whole[order])
    empty, none, _ = count_spikes(network, rates[:0], keys[:0])
    assert empty.shape == (0, network.neurons)
    assert not any(none.values())


@pytest.mark.parametrize(
    ("neurons", "bias_input", "leaves", "delays", "silent"),
    [
        (1, False, 0, (1, 2), 3),
        (1024, False, 0, (1, 2), 3),
        (1025, False, 0, (2, 2), 4),
        (1025, True, 0, (1, 2), 3),
        (4096, False, 0, (2, 2), 4),
        (4097, False, 2, (2, 3), 5),
        (4097, True, 2, (1, 3), 4),
        (8193, True, 3, (1, 3), 4),
    ],
)
def test_delays_follow_from_the_number_of_neurons(
    neurons: int, bias_input: bool, leaves: int, delays: tuple[int, int], silent: int
) -> None:
    bias = np.zeros(neurons, np.int32)
    weights = np.ones((2, neurons), np.int16)
    network = FixedNetwork(weights, bias, 1, False, 1, 1, 0, 0, 60, bias_input, bias_input)
    assert (network.leaves, network.inhibitory) == (leaves, leaves + 1)
    assert (network.input_delay, network.inhibition_delay) == delays
    assert network.silent_steps == fixed.silent_steps(neurons, bias_input) == silent
    assert network.interval == 60 + silent
    assert network.relayed == (delays[0] == 2)
    assert network.input_compartments == (2 if bias_input or network.relayed else 0)


def test_what_is_stored_is_what_lava_reads_back() -> None:
    for bits in range(1, 9):
        for signed in (False, True)[: 2 if bits < 8 else 1]:
            top = (1 << bits) - 1
            weights = np.arange(-top if signed else 0, top + 1)[:, None].astype(np.int16)
            network = FixedNetwork(weights, np.zeros(1, np.int32), bits, signed, 1, 0, 0, 0, 1)
            stored, width, exponent = network.stored
            assert stored.shape == (1, network.inputs)
            assert width == network.stored_bits == bits + signed <= 8
            # Lava keeps multiples of 2^(8 - n), with a sign of twice that, in 9 bits and a sign.
            unit = 2 ** (8 - width + signed)
            assert not (stored % unit).any()
            assert np.abs(stored).max() < 256
            assert np.array_equal(stored.T * 2.0**exponent, weights)


GOOD = FixedNetwork(np.ones((5, 6), np.int16), np.zeros(6, np.int32), 3, False, 87, 87, 0, 137, 5)


def bias(*values: int) -> NDArray[np.int32]:
    return np.array([*values, *[0] * (6 - len(values))], np.int32)


def weights(value: int) -> NDArray[np.int16]:
    return np.full((5, 6), value, np.int16)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"bits": 9}, "weights need 9 bits to hold 1; use 1 to 8 bits"),
        ({"bits": 0}, "weights need 0 bits to hold 1; use 1 to 8 bits"),
        ({"bits": 8, "signed": True}, "weights need 8 bits to hold 1; use 1 to 7 bits"),
        ({"weights": weights(8)}, "weights need 3 bits to hold 8"),
        ({"weights": weights(-8), "signed": True}, "weights need 3 bits to hold 8"),
        ({"weights": weights(-32_768), "signed": True}, "weights need 3 bits to hold 32768"),
        ({"weights": weights(-1)}, "a weight of -1 has a sign; set network.signed"),
        ({"bias_input": True}, "inputs that integrate a bias spike regularly; set network.trains to regular"),
        ({"decay": -1}, r"decay -1 does not fit 0\.\.4096; train the model again"),
        ({"decay": 4097}, r"decay 4097 does not fit 0\.\.4096"),
        ({"inhibition_exponent": 8}, r"inhibition_exponent 8 does not fit 0\.\.7; lower network.inhibition"),
        ({"inhibition_exponent": -1}, r"inhibition_exponent -1 does not fit"),
        ({"steps": 0}, "a presentation of 0 steps holds no input"),
        ({"threshold": 0}, r"threshold 0 does not fit 1\.\.131071"),
        ({"threshold": 1 << 17}, "threshold 131072 does not fit .*; lower network.threshold"),
        ({"inhibition": 256}, r"inhibition 256 does not fit 0\.\.255; raise its exponent"),
        ({"inhibition": -1}, "inhibition -1 does not fit"),
        ({"bias": bias(4097, -1)}, "biases up to 4097 fit no 12 bits and an exponent; train the model again"),
        ({"bias": bias(0, -4096 << 7)}, "biases up to 524288 fit no 12 bits and an exponent"),
        ({"bias": bias(-(2**31))}, "biases up to 2147483648 fit no 12 bits and an exponent"),
        ({"bias": bias(187)}, "a bias of 187 makes its neuron spike without input, above 186; train the model again"),
        ({"bias": bias(1), "decay": 0}, "a bias of 1 makes its neuron spike without input, above 0"),
    ],
)
def test_limits_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(NetworkLimitError, match=message):
        dataclasses.replace(GOOD, **changes).check()


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"bias": bias(1 << 7, -4095 << 7)},
        {"bias": bias(186, -4095)},
        {"signed": True, "bits": 7, "weights": weights(-127)},
        {"bits": 8, "weights": weights(255)},
        {"decay": 4096, "threshold": (1 << 17) - 1, "inhibition": 255, "inhibition_exponent": 7},
        {"regular": True, "bias_input": True},
    ],
)
def test_what_registers_hold_is_taken(changes: dict[str, Any]) -> None:
    dataclasses.replace(GOOD, **changes).check()


@pytest.mark.parametrize("weights", [(3, 250), (-250, -3), (-7, 2, 9), (0,), ()])
def test_the_span_holds_0_and_every_weight(weights: tuple[int, ...]) -> None:
    least = most = 0
    for weight in weights:
        least, most = weight if weight < least else least, weight if weight > most else most
    network = dataclasses.replace(GOOD, weights=np.array([weights], np.int16))
    assert network.span == (least, most)


def test_sums_that_could_overflow_are_refused() -> None:
    ones = np.full((1100, 1), 127, np.int16)
    many = dataclasses.replace(GOOD, weights=ones, bias=np.zeros(1, np.int32), bits=7, signed=True)
    assert many.extremes == (139_700, 87)
    with pytest.raises(NetworkLimitError, match="the weights above 0 of one neuron sum to 139,700, but Loihi's 24-bit"):
        many.check()
    below = dataclasses.replace(many, weights=-ones)
    assert below.extremes == (0, 139_787)
    with pytest.raises(NetworkLimitError, match="the weights below 0 and inhibition of one neuron sum to 139,787, but"):
        below.check()
    # Positive and negative weights do not make up for each other: both may be silent.
    both = dataclasses.replace(many, weights=np.concatenate([ones[:300], -ones[:250]]))
    both.check()
    with pytest.raises(NetworkLimitError, match="sum to 38,100, but Loihi 1 holds less than 32,768; use fewer weight"):
        both.check(LOIHI_1_INPUT_LIMIT, "Loihi 1")
