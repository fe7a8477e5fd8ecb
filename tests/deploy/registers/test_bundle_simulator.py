"""Registers, run step by step, spike as the engine does; and what they do wrong is seen."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from support.boards.plans import busy_plan, chips_of, pictures, random_biases, random_network, simple_plan
from support.literal.integers import shrink, wrap

from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.registers.core_images import CoreImage, core_images, host_tables
from lava_vpr.deploy.registers.simulator import Chips
from lava_vpr.deploy.registers.simulator_kernels import State, Wiring, update
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.counting import count_spikes, inhibitory_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.rates import draw_trains
from lava_vpr.errors import ModelFileError, NetworkLimitError


def compare(plan: Plan, seed: int) -> tuple[int, Chips]:
    """Every spike equals the engine's; how many of exc there were."""
    network, chips = plan.network, chips_of(plan)
    rates, keys = pictures(network, 3, seed)
    exc, inh, inputs, _ = chips.present(rates, keys)
    _, _, film = count_spikes(network, rates, keys, raster=True)
    drawn = draw_trains(rates, keys, network.steps, network.interval, regular=network.regular)
    assert np.array_equal(inputs, drawn)
    assert np.array_equal(exc, film)
    assert np.array_equal(inh, inhibitory_spikes(network, film))
    assert {array.dtype for array in (exc, inh, inputs)} == {np.dtype(np.uint8)}
    return int(film.sum()), chips


INPUTS = {
    "poisson": {"regular": False, "bias_input": False},
    "regular": {"regular": True, "bias_input": False},
    "bias": {"regular": True, "bias_input": True},
}


@pytest.mark.parametrize(
    ("bits", "signed", "mode"),
    list(product(range(1, 8), (False, True), INPUTS)),
)
def test_spikes_are_those_of_the_engine(bits: int, signed: bool, mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    spikes, chips, dense, cores, deep, biased = 0, set(), set(), set(), set(), 0
    for seed in range(6):
        monkeypatch.setattr(fixed, "FAN_IN", 4096 if seed % 2 else 4)
        monkeypatch.setattr(fixed, "DIRECT", 1024 if seed % 3 else 2)
        size = (20 + seed, 6 + 3 * seed)
        network = random_network(100 * bits + seed, bits=bits, signed=signed, size=size, **INPUTS[mode])
        network = network if signed else replace(network, bias=random_biases(network, np.random.default_rng(seed)))
        plan = simple_plan(network, 1 + (bits + seed) % 6, seed)
        found, machine = compare(plan, seed)
        spikes += found
        chips |= {chip for chip, _ in machine.wired.cores}
        dense |= {bool(row) for core in plan.cores for row in core.dense_inputs}
        cores.add(len(machine.wired.cores))
        deep.add((network.depth, network.input_delay))
        biased += bool(network.bias.any())
    assert spikes > 100
    assert chips == dense == {0, 1}
    assert len(cores) > 3
    assert len(deep) == (2 if mode == "bias" else 4)
    assert biased > 2


@pytest.mark.parametrize("bias_input", [False, True])
def test_each_presentation_stands_alone(bias_input: bool) -> None:
    plan = busy_plan(bias_input=bias_input, signed=True)
    chips = chips_of(plan)
    rates, keys = pictures(plan.network, 5, 7)
    whole = chips.present(rates, keys)
    assert whole.counts.sum() > 50
    assert plan.network.bias.any()
    assert np.array_equal(whole.counts, whole.exc.sum(axis=1))
    assert np.array_equal(whole.counts, count_spikes(plan.network, rates, keys)[0])
    for q in (4, 0, 2):
        assert np.array_equal(chips.present(rates[[q]], keys[[q]])[0][0], whole.exc[q])
    assert chips.present(rates[:0], keys[:0]).counts.shape == (0, 20)


def literal_step(x: dict[str, int]) -> tuple[int, int, int, bool]:
    """u, v and refractory steps of one compartment after one step, and whether it spikes."""
    u = wrap(shrink(x["u"], x["keep_u"]) + x["sums"])
    v = max(x["low"], min(x["high"], shrink(x["v"], x["keep_v"]) + u + x["bias"]))
    held = x["held"]
    if held:
        v, held = 0, held - 1
    return (u, 0, x["refract"] - 1, True) if v > x["threshold"] else (u, v, held, False)


def test_one_step_of_any_registers() -> None:
    rng = np.random.default_rng(0)
    n, top = 4000, 1 << 23
    names = ("u", "v", "sums", "held", "bias", "keep_u", "keep_v", "refract", "threshold")
    x = {
        "u": rng.integers(1 - top, top, n),
        "v": rng.integers(1 - top, top, n),
        "sums": rng.integers(1 - (1 << 21), 1 << 21, n),
        "held": rng.integers(0, 3, n),
        "bias": rng.integers(-4095, 4096, n) << rng.integers(0, 8, n),
        "keep_u": rng.choice([0, 4095, 4096 - 1, 17, 3000], n),
        "keep_v": rng.choice([4096, 1, 2000, 4000], n),
        "refract": rng.integers(1, 64, n),
        "threshold": rng.integers(0, 1 << 17, n) << 6,
    }
    for name in ("u", "v", "sums", "held", "bias"):
        x[name][rng.random(n) < 0.4] = 0
    low, high = np.array([1 - top, 1 - (1 << 20)]), np.array([top - 1, (1 << 19) - 1])
    expected = [
        literal_step({name: int(x[name][i]) for name in names} | {"low": int(low[i % 2]), "high": int(high[i % 2])})
        for i in range(n)
    ]
    order = np.concatenate([np.arange(0, n, 2), np.arange(1, n, 2)])
    state = State(*(x[name][order].astype(np.int64) for name in ("u", "v", "sums", "held", "bias")))
    empty = np.zeros(0, np.int64)
    registers = [x[name][order] for name in ("keep_u", "keep_v", "refract")]
    synapses = (empty, empty, empty.astype(np.int32), empty.astype(np.int32))
    wiring = Wiring(np.array([0, n // 2, n]), *registers, low, high, empty, empty, *synapses)
    fired = np.empty(n, np.int64)
    spikes, overflow = update(wiring, state, x["threshold"][order], fired)
    assert overflow == -1
    assert not state.sums.any()
    for got, column in ((state.u, 0), (state.v, 1), (state.held, 2)):
        assert got.tolist() == [expected[i][column] for i in order]
    assert fired[:spikes].tolist() == [k for k, i in enumerate(order) if expected[i][3]]
    assert 100 < spikes < n - 100


def saturated(excitation: int, signed: bool = False, **changes: int) -> Plan:
    """Three neurons on three cores, which receive at most ``excitation``: above 0 they spike in every step."""
    top = 127
    rows = -(-abs(excitation) // top)
    weights = np.full((rows, 3), top, np.int16)
    weights[-1] = abs(excitation) - top * (rows - 1)
    network = FixedNetwork(
        weights=weights if excitation > 0 else -weights,
        bias=np.zeros(3, np.int32),
        bits=7,
        signed=signed,
        threshold=1,
        inhibition=0,
        inhibition_exponent=0,
        decay=0,
        steps=6,
    )
    return simple_plan(replace(network, **changes), 3, 1)


def test_an_accumulator_that_overflows_is_an_error() -> None:
    always = np.full((2, 300), 65535, np.uint16)
    keys = np.arange(2, dtype=np.uint64)
    below = saturated((1 << 15) - 1)
    shown = always[:, : below.network.inputs]
    counts = chips_of(below).present(shown, keys).counts
    assert np.array_equal(counts, count_spikes(below.network, shown, keys)[0])
    assert (counts >= 5).all()
    text = (
        r"^chip 0 core 1 compartment 0: receives 32,768 in step \d of presentation 0, but its accumulator holds less "
        "than 32,768; lower network.inhibition or use fewer weight bits$"
    )
    for excitation, signed in ((1 << 15, False), (1 << 15, True), (-(1 << 15), True)):
        plan = saturated(excitation, signed)
        shown = always[:, : plan.network.inputs]
        with pytest.raises(NetworkLimitError, match=text):
            chips_of(plan).present(shown, keys)
        chips_of(plan).present(shown // 40000, keys)  # where they do not meet
    weights = np.array([[127, -127, -127], *[[0, -127, -127]] * 130], np.int16)
    inhibited = replace(saturated(1, signed=True).network, weights=weights, inhibition=127, inhibition_exponent=7)
    with pytest.raises(NetworkLimitError, match="receives 32,893 in step 3 of presentation 0"):
        chips_of(simple_plan(inhibited, 3, 1)).present(always[:, :131], keys)


def with_registers(image: CoreImage, group: str, index: int | None, **values: Any) -> CoreImage:
    """``image`` with registers of one group changed."""
    groups = image.registers[group]
    if index is None:
        return replace(image, registers=image.registers | {group: groups | values})
    changed = [g | values if k == index else g for k, g in enumerate(groups)]
    return replace(image, registers=image.registers | {group: changed})


def test_what_does_not_come_to_rest_is_an_error() -> None:
    plan = busy_plan(bias_input=False)
    rates, keys = pictures(plan.network, 2, 1)
    with pytest.raises(
        ModelFileError, match=r"^presentation 0: \d+ spikes are still on their way after its last step;"
    ):
        chips_of(plan, silent_steps=0).present(rates, keys)
    images = core_images(plan)
    chip, core, _ = host_tables(plan).inh[0]
    last = [(image.chip, image.core) for image in images].index((chip, core))

    def refused(image: CoreImage) -> None:
        with pytest.raises(
            ModelFileError, match=r"^chip \d core \d+ compartment \d+: is not at rest after presentation"
        ):
            chips_of(plan, (*images[:last], image, *images[last + 1 :])).present(rates, keys)

    slow = with_registers(images[last], "cxProfileCfg", 2, decayV=0)
    refused(with_registers(slow, "vthProfileCfg", 2, vth=100000))  # an inhibitory neuron that only adds up
    refused(with_registers(images[last], "cxProfileCfg", 0, decayU=0))
    refused(with_registers(images[last], "cxProfileCfg", 0, refractDelay=63))


def test_inputs_are_silent_because_their_bias_is_off() -> None:
    plan = busy_plan(bias_input=True)
    rates, keys = pictures(plan.network, 20, 1)
    good = chips_of(plan)
    _, late, sent = (train[:, plan.network.steps :] for train in good.present(rates, keys)[:3])
    assert late.any(), "nothing happens in the silent steps"
    assert not sent.any()
    # Inputs that nobody switches off go on, and their spikes are then seen to be still on their way.
    never = replace(good, steps=good.steps + good.silent_steps, silent_steps=0)
    with pytest.raises(ModelFileError, match="spikes are still on their way after its last step"):
        never.present(rates, keys)
