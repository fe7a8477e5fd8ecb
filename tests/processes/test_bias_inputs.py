"""Inputs that integrate a bias, in Lava: the Process, and networks on such inputs on every backend."""

from __future__ import annotations

import numpy as np
import pytest
from lava.proc.lif.models import PyLifModelBitAcc
from numpy.typing import NDArray
from support.lava.model_harness import build, drive
from support.lava.small_networks import FIXED, FLOAT, Arrays, Runs, hold_in_lava, random_network

from lava_vpr.engine.inference.biases import LEVEL, bias_input_spikes, biases, start_membranes
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.rates import draw_trains
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import STATE_LIMIT
from lava_vpr.processes.base.shared_memory import shared_array
from lava_vpr.processes.encoders.process import BiasInputs, PyBiasInputsFixed, PyBiasInputsFloat, SubBiasInputsFixed
from lava_vpr.processes.jobs.inference import input_spikes

pytestmark = pytest.mark.lava
EVERY_RATE = np.arange(1 << 16).astype(np.uint16)
MODELS = {"fixed": PyBiasInputsFixed, "float": PyBiasInputsFloat}


def some_rates(n: int, inputs: int) -> NDArray[np.uint16]:
    """Mostly what images give, and the extremes: silent inputs, a silent image, inputs that spike in every step."""
    rng = np.random.default_rng(n)
    rates = rng.integers(0, 13_000, (n, inputs)) * (rng.random((n, inputs)) < 0.7)
    rates[:, :2] = 65_535, 0
    rates[-1, ::3] = 65_535
    rates[n // 2] = 0
    return rates.astype(np.uint16)


@pytest.mark.parametrize("kind", MODELS)
def test_the_process_sends_the_definition(kind: str) -> None:
    rates, keys, steps = some_rates(5, 60), presentation_keys(0, "query", np.arange(5)), 40
    emitted = shared_array((60,), np.int64)
    process = BiasInputs(rates=rates, keys=keys, steps=steps, silent_steps=4, emitted=emitted)
    model = build(process, MODELS[kind])
    expected = draw_trains(rates, keys, steps, process.interval, regular=True)
    assert process.interval == steps + 4
    sent = drive(model, 5 * process.interval + 7, port_out="s_out")
    assert sent.dtype == bool
    assert np.array_equal(sent[:-7], expected.reshape(-1, 60))
    assert not sent[-7:].any()
    assert expected[:, :steps, 0].all(axis=1).tolist() == [True, True, False, True, True]
    for counted in (model.emitted, emitted):
        assert np.array_equal(counted, expected.sum(axis=(0, 1)))
    unit = 64 if kind == "float" else 1
    bias = np.ldexp(model.bias_mant, model.bias_exp.astype(int))
    assert np.array_equal(bias, np.left_shift(*biases(rates[-1])))
    assert (model.v * unit <= LEVEL).all()
    assert (model.v * unit == np.floor(model.v * unit)).all()


def test_a_new_bias_counts_at_once() -> None:
    rates = np.full((1, 3), 700, np.uint16)
    process = BiasInputs(rates=rates, keys=np.ones(1, np.uint64), steps=50, silent_steps=3)
    model = build(process, PyBiasInputsFixed)
    drive(model, 1)
    model.v[:], model.bias_mant[:], model.bias_exp[:] = LEVEL, (0, 1, 4095), 7
    model.time_step = 2
    model.run_spk()
    assert model.s_out.sent.tolist() == [False, True, True]
    for var, value in (("v", STATE_LIMIT), ("bias_mant", 4096), ("bias_mant", -1), ("bias_exp", 8)):
        with pytest.raises(NetworkLimitError, match=rf"^{var} is {value}, but must be a whole number in .*\.\."):
            getattr(process, var).check(np.array([0, value]))


@pytest.mark.parametrize("silent_steps", [3, 4])
def test_what_is_written_reaches_the_phase_without_a_spike(silent_steps: int) -> None:
    """The library's LIF, from the pause before the silent steps to the end of the next presentation."""
    rates, keys = np.stack([EVERY_RATE[::16], EVERY_RATE[::16][::-1]]), presentation_keys(5, "query", np.arange(2))
    inputs = BiasInputs(rates=rates, keys=keys, steps=30, silent_steps=silent_steps)
    values = inputs.values(1, silent_steps)
    assert abs(values["v"]).max() < STATE_LIMIT
    model = build(SubBiasInputsFixed(inputs).neurons, PyLifModelBitAcc)
    model.v[:], model.bias_mant[:], model.bias_exp[:] = values["v"], values["bias_mant"], values["bias_exp"]
    assert not drive(model, silent_steps, port_out="s_out").any()
    assert np.array_equal(model.v, start_membranes(int(keys[1]), rates.shape[1]))
    spikes = drive(model, 30, port_out="s_out")
    assert np.array_equal(spikes, bias_input_spikes(rates[1], int(keys[1]), 30))


@pytest.mark.slow
def test_every_network_on_every_backend_equals_the_host() -> None:
    cases: dict[str, tuple[FixedNetwork, Arrays, Runs]] = {}
    for name, runs, network in (
        ("b3", FIXED + FLOAT, random_network(3, seed=7, signed=True, regular=True, bias_input=True)),
        # presentations with more silence than input
        ("b8", FIXED, random_network(8, seed=7, regular=True, bias_input=True, steps=2)),
    ):
        keys = presentation_keys(2, "query", np.arange(4))
        cases[name] = network, {"rates": some_rates(4, network.inputs), "keys": keys}, runs
    got = hold_in_lava(cases, board="b3")
    assert got["b3_fused_fixed_pt_counts"].sum() > 60
    check_board(*cases["b3"][:2], got)


def check_board(network: FixedNetwork, shown: Arrays, got: Arrays) -> None:
    """As wired for a board: inputs are on the chip with all the rest; spikes of exc and inh alone leave it."""
    rates, keys = shown["rates"].copy(), shown["keys"]
    rates[1] = rates[0]
    counts, _, _ = count_spikes(network, rates, keys)
    assert np.array_equal(got["board_counts"], counts)
    assert np.array_equal(got["board_input_spikes"], input_spikes(rates, keys, network.steps))
    assert got["board_input_spikes"].sum() > 0
    network_out = [f"PlaceNetwork.{port} NxToPyAdapter" for port in ("s_out", "s_out_inh")]
    assert got["crossed"].tolist() == ["BiasInputs.s_out None", *network_out]
    assert got["writes"].tolist() == [1, 3, 3, 1]
