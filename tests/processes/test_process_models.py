"""Each of our Processes against Lava's own models or a literal version, and what it refuses."""

from __future__ import annotations

import multiprocessing
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from lava.proc.dense.models import PyDenseModelBitAcc
from lava.proc.dense.process import Dense
from lava.proc.lif.models import PyLifResetModelBitAcc
from lava.proc.lif.process import LIFReset
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray
from support.lava.model_harness import build, drive

from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.rates import draw_trains
from lava_vpr.errors import NetworkLimitError
from lava_vpr.processes.base.shared_memory import shared_array
from lava_vpr.processes.encoders.process import (
    FinePoissonEncoder,
    PoissonEncoder,
    PyFinePoissonEncoder,
    PyPoissonEncoder,
    PyRegularEncoder,
    RegularEncoder,
)
from lava_vpr.processes.lif.process import (
    ExcitatoryLIF,
    InhibitoryLIF,
    PyExcitatoryLIFFixed,
    PyExcitatoryLIFFloat,
    PyInhibitoryLIFFixed,
    PyInhibitoryLIFFloat,
)
from lava_vpr.processes.networks.process import FusedPlaceNetwork, PlaceNetwork
from lava_vpr.processes.spike_counter.process import PySpikeCounter, SpikeCounter
from lava_vpr.processes.synapses.process import (
    DenseSynapses,
    LateralInhibition,
    OneToOne,
    PyDenseSynapsesFixed,
    PyDenseSynapsesFloat,
    PyLateralInhibitionFloat,
    PyOneToOneFixed,
    PyOneToOneFloat,
)

pytestmark = pytest.mark.lava


def some_spikes(rng: np.random.Generator, steps: int, n: int, share: float = 0.3) -> NDArray[np.bool_]:
    return rng.random((steps, n)) < share


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 1000),
    mode=st.sampled_from([SignMode.NULL, SignMode.MIXED, SignMode.EXCITATORY, SignMode.INHIBITORY, None]),
    bits=st.integers(1, 8),
    exponent=st.integers(-7, 7),
)
def test_dense_equals_lavas(seed: int, mode: SignMode | None, bits: int, exponent: int) -> None:
    rng = np.random.default_rng(seed)
    low, high = {SignMode.MIXED: (-256, 256), SignMode.INHIBITORY: (-255, 1), None: (-200, 200)}.get(mode, (0, 256))
    weights = rng.integers(low, high, (int(rng.integers(1, 9)), int(rng.integers(1, 12))))
    spikes = some_spikes(rng, 12, weights.shape[1])
    lava = Dense(weights=weights, num_weight_bits=bits, weight_exp=exponent, sign_mode=mode)
    ours = DenseSynapses(weights=weights, num_weight_bits=bits, weight_exp=exponent, sign_mode=mode)
    model = build(ours, PyDenseSynapsesFixed)
    expected = drive(build(lava, PyDenseModelBitAcc), spikes, "s_in", "a_out")
    assert np.array_equal(drive(model, spikes, "s_in", "a_out"), expected)
    named = DenseSynapses(weights=weights, num_weight_bits=bits, sign_mode=mode and mode.name.lower())
    assert named.sign == ours.sign
    floating = drive(build(ours, PyDenseSynapsesFloat), spikes, "s_in", "a_out")
    exact = (spikes.astype(float) @ weights.T) * 2.0**exponent
    assert np.allclose(floating[1:], exact[:-1])
    assert not floating[0].any()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 1000),
    du=st.sampled_from([0, 1, 400, 4094, 4095]),
    dv=st.sampled_from([0, 1, 137, 4095]),
    size=st.sampled_from([100, 5000, 131_000, 6_528_000]),
    interval=st.sampled_from([1, 7, 1000]),
)
def test_lif_equals_lavas(seed: int, du: int, dv: int, size: int, interval: int) -> None:
    rng = np.random.default_rng(seed)
    n, vth = 6, int(rng.integers(0, min(131_072, 4 * size)))
    drives = rng.integers(-size, size, (25, n)).astype(np.int32)
    bias = {"bias_mant": rng.integers(-4096, 4096, n), "bias_exp": rng.integers(0, 8, n)}
    lava = LIFReset(shape=(n,), du=du, dv=dv, vth=vth, reset_interval=interval, reset_offset=1, **bias)
    ours = ExcitatoryLIF(shape=(n,), du=du, dv=dv, vth=vth, reset_interval=interval, **bias)
    theirs, model = build(lava, PyLifResetModelBitAcc), build(ours, PyExcitatoryLIFFixed)
    for step in range(25):
        for one in (theirs, model):
            one.time_step = step + 1
            one.a_in.waiting = drives[step]
            one.run_spk()
        assert np.array_equal(theirs.s_out.sent, model.s_out.sent)
        assert np.array_equal(theirs.u, model.u)
        assert np.array_equal(theirs.v, model.v)


def literal_lif(drives: NDArray[Any], process: ExcitatoryLIF, fixed: bool) -> NDArray[np.bool_]:
    """Neuron by neuron, in Python numbers."""
    get = {var.name: np.ravel(var.init).tolist() for var in process.vars}
    scale = 64 if fixed else 1
    spikes = np.zeros(drives.shape, bool)
    for i in range(drives.shape[1]):
        u, v, held, vth = 0, 0, 0, get["vth"][i]
        bias = get["bias_mant"][i] * 2.0 ** get["bias_exp"][i] / (1 if fixed else 64)
        for t in range(len(drives)):
            if process.proc_params["reset_interval"] and t % process.proc_params["reset_interval"] == 0:
                u = v = held = 0
            u, v = u * (4095 - get["du"][0]) / 4096, v * (4096 - get["dv"][0]) / 4096
            if fixed:
                u, v, bias = int(u), int(v), int(np.floor(bias))
            u += scale * drives[t, i]
            v = max(v + u + bias, scale * get["floor"][0])
            if held:
                held, v = held - 1, 0
            if v > scale * vth:
                spikes[t, i], v, held, vth = True, 0, get["hold_steps"][0], vth + get["theta_plus"][0]
    return spikes


@pytest.mark.parametrize("kind", [PyExcitatoryLIFFixed, PyExcitatoryLIFFloat])
@pytest.mark.parametrize("seed", range(6))
def test_what_lavas_lif_lacks_equals_a_literal_version(kind: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    drives = rng.integers(-120, 160, (60, 5))
    process = ExcitatoryLIF(
        shape=(5,),
        du=int(rng.choice([4095, 3000])),
        dv=137,
        vth=rng.integers(50, 200, 5),
        floor=[None, -30, -5][seed % 3],
        hold_steps=seed % 4,
        theta_plus=seed % 3 * 7,
        bias_mant=rng.integers(-100, 100, 5),
        bias_exp=rng.integers(-2, 3, 5),
        reset_interval=[0, 13][seed % 2],
    )
    model = build(process, kind)
    spikes = drive(model, drives, "a_in", "s_out")
    expected = literal_lif(drives, process, kind is PyExcitatoryLIFFixed)
    assert expected.sum() > 10
    assert np.array_equal(spikes, expected)
    assert np.array_equal(model.vth, process.vth.init + process.theta_plus.init * spikes.sum(axis=0))


@pytest.mark.parametrize("kind", [PyInhibitoryLIFFixed, PyInhibitoryLIFFloat])
@pytest.mark.parametrize("spikes", [1, 4096])
def test_inhibitory_neurons_fire_in_the_step_of_any_input(kind: Any, spikes: int) -> None:
    given = some_spikes(np.random.default_rng(0), 30, 4)
    model = build(InhibitoryLIF(shape=(4,), reset_interval=9), kind)
    assert np.array_equal(drive(model, given * 2 * spikes, "a_in", "s_out"), given)


@pytest.mark.parametrize("kind", [PyOneToOneFixed, PyOneToOneFloat])
@pytest.mark.parametrize(("weight", "exponent"), [(2, 0), (-255, 7), (255, 7)])
def test_one_to_one_takes_one_step(kind: Any, weight: int, exponent: int) -> None:
    spikes = some_spikes(np.random.default_rng(1), 20, 5)
    process = OneToOne(shape=(5,), weight=weight, weight_exp=exponent)
    sent = drive(build(process, kind), spikes, "s_in", "a_out")
    assert np.array_equal(sent[1:], (weight << exponent) * spikes[:-1])
    assert not sent[0].any()


@pytest.mark.parametrize("inhibition", [0, 87, 17.25])
def test_lateral_inhibition_is_a_matrix_without_diagonal(inhibition: float) -> None:
    spikes = some_spikes(np.random.default_rng(2), 20, 6)
    process = LateralInhibition(shape=(6,), inhibition=inhibition)
    sent = drive(build(process, PyLateralInhibitionFloat), spikes, "s_in", "a_out")
    assert np.array_equal(sent[1:], spikes[:-1].astype(int) @ (inhibition * (np.eye(6) - 1)))
    assert not sent[0].any()


ENCODERS = [
    (PoissonEncoder, PyPoissonEncoder, np.uint16, False),
    (RegularEncoder, PyRegularEncoder, np.uint16, True),
    (FinePoissonEncoder, PyFinePoissonEncoder, np.uint32, False),
]


@pytest.mark.parametrize(("encoder", "kind", "unit", "regular"), ENCODERS)
@pytest.mark.parametrize(("steps", "inputs"), [(1, 3), (6, 1), (13, 40), (29, 40)])
def test_an_encoder_sends_the_spikes_of_its_trains_then_nothing(
    encoder: Any, kind: Any, unit: Any, regular: bool, steps: int, inputs: int
) -> None:
    rng = np.random.default_rng(steps)
    rates = (rng.integers(0, np.iinfo(unit).max, (3, inputs)) * (rng.random((3, inputs)) < 0.7)).astype(unit)
    keys, emitted = presentation_keys(1, "query", np.arange(3)), np.zeros(inputs, np.int64)
    process = encoder(rates=rates, keys=keys, steps=steps, silent_steps=2, emitted=emitted)
    process.compile_kernels()
    model = build(process, kind)
    sent = drive(model, 4 * (steps + 2), port_out="s_out").reshape(4, steps + 2, inputs)
    assert np.array_equal(sent[:3], draw_trains(rates, keys, steps, steps + 2, regular=regular))
    assert not sent[3].any()
    assert sent.any()
    assert np.array_equal(emitted, sent.sum(axis=(0, 1)))
    assert np.array_equal(model.emitted, emitted)


def test_the_counter_counts_and_records() -> None:
    spikes = some_spikes(np.random.default_rng(3), 30, 4)
    counts, raster = np.zeros((3, 4), np.int32), np.zeros((3, 7, 4), np.uint8)
    model = build(SpikeCounter(shape=(4,), presentations=3, interval=7, counts=counts, raster=raster), PySpikeCounter)
    drive(model, spikes, "s_in")
    assert np.array_equal(raster, spikes[:21].reshape(3, 7, 4))
    assert np.array_equal(counts, raster.sum(axis=1))
    assert np.array_equal(model.counts, counts)


def test_shared_memory_is_shared_with_forks() -> None:
    array = shared_array((3, 2), np.int32)
    assert not array.any()
    child = multiprocessing.get_context("fork").Process(target=array.__setitem__, args=((1, 1), 7), daemon=True)
    child.start()
    child.join(60)
    assert array.sum() == array[1, 1] == 7
    assert shared_array((0, 4), np.uint8).shape == (0, 4)


def dense(**changes: Any) -> DenseSynapses:
    return DenseSynapses(**{"weights": np.ones((2, 3), int)} | changes)


def lif(**changes: Any) -> ExcitatoryLIF:
    return ExcitatoryLIF(**{"shape": (3,), "dv": 137, "vth": 80} | changes)


PRESENTED = {"rates": np.ones((2, 3), np.uint16), "keys": np.ones(2, np.uint64), "steps": 4, "silent_steps": 3}


def regular(**changes: Any) -> RegularEncoder:
    return RegularEncoder(**PRESENTED | changes)


def encoder(**changes: Any) -> PoissonEncoder:
    return PoissonEncoder(**PRESENTED | changes)


def counter(**changes: Any) -> SpikeCounter:
    return SpikeCounter(**{"shape": (3,), "presentations": 2, "interval": 4} | changes)


def place(weights: NDArray[np.int16], **changes: Any) -> FixedNetwork:
    numbers: dict[str, Any] = {"threshold": 5, "inhibition": 5, "inhibition_exponent": 0, "decay": 137, "steps": 4}
    return FixedNetwork(weights, np.zeros(weights.shape[1], np.int32), 1, False, **numbers | changes)


def fused(**changes: Any) -> FusedPlaceNetwork:
    network = place(np.ones((3, 2), np.int16))
    return FusedPlaceNetwork(
        **{"network": network, "rates": np.ones((2, 3), np.uint16), "keys": np.ones(2, np.uint64)} | changes
    )


REFUSED: list[tuple[Any, dict[str, Any], str]] = [
    (dense, {"weights": np.full((2, 3), 256)}, "excitatory weight is 256, but must be a whole number in 0..255"),
    (dense, {"weights": np.full((2, 3), -256)}, "inhibitory weight is -256"),
    (dense, {"weights": np.array([[300, -1]])}, "mixed weight is 300, but must be a whole number in -256..255"),
    (dense, {"sign_mode": "inhibitory"}, "inhibitory weight is 1"),
    (dense, {"sign_mode": SignMode.NULL, "weights": np.array([[-1]])}, "null weight is -1"),
    (dense, {"sign_mode": "both"}, "sign_mode is 'both', but must be null, mixed"),
    (dense, {"weights": np.ones(3, int)}, "weights are int64 (3,), but must be numbers (post, pre)"),
    (dense, {"weights": np.array([[np.nan]])}, "a weight is nan, but must be finite"),
    (dense, {"num_weight_bits": 9}, "num_weight_bits is 9, but must be in 1..8"),
    (dense, {"weight_exp": -8}, "weight_exp is -8, but must be in -7..7"),
    (dense, {"weight_exp": 0.5}, "weight_exp is 0.5"),
    (lif, {"vth": 1 << 17}, "threshold is 131072, but must be a whole number in 0..131071"),
    (lif, {"vth": np.array([1, -1, 1])}, "threshold is -1"),
    (lif, {"vth": np.ones(2, int)}, "vth has shape (2,), but must be one number or one each: (3,)"),
    (lif, {"vth": float("nan")}, "vth is nan, but must be finite"),
    (lif, {"vth": "high"}, "vth is 'high', but must be a number"),
    (lif, {"du": 4096}, "du is 4096, but must be in 0..4095"),
    (lif, {"dv": -1}, "dv is -1, but must be in 0..4096"),
    (lif, {"floor": 1}, "floor is 1, but must be in -131071..0"),
    (lif, {"hold_steps": -1}, "hold_steps is -1, but must be a whole number, at least 0"),
    (lif, {"reset_interval": 0.5}, "reset_interval is 0.5"),
    (lif, {"theta_plus": 1 << 17}, "theta_plus is 131072"),
    (lif, {"bias_mant": 4096}, "bias mantissa is"),
    (lif, {"bias_exp": 8}, "bias exponent is"),
    (lif, {"shape": (3, 2)}, "ExcitatoryLIF: shape is (3, 2), but must be (neurons,)"),
    (InhibitoryLIF, {"shape": (3,), "vth": -1}, "threshold is -1"),
    (OneToOne, {"shape": (3,), "weight": 256}, "weight is 256, but must be a whole number in -255..255"),
    (OneToOne, {"shape": (), "weight": 1}, "OneToOne: shape is ()"),
    (OneToOne, {"shape": (3,), "weight": 1, "weight_exp": 8}, "weight_exp is 8, but must be in 0..7"),
    (LateralInhibition, {"shape": (3,), "inhibition": -1}, "inhibition is -1, but must be at least 0"),
    (encoder, {"rates": np.ones((2, 3))}, "rates are float64 (2, 3), but must be uint16 (n, inputs)"),
    (encoder, {"rates": np.ones((2, 0), np.uint16)}, "PoissonEncoder: rates are uint16 (2, 0), but must be"),
    (
        encoder,
        {"keys": np.ones(2, int)},
        "keys are int64 (2,), but must be uint64 (2,), one for each row of rates",
    ),
    (encoder, {"silent_steps": -1}, "4 steps and -1 silent ones"),
    (encoder, {"keys": np.ones(3, np.uint64)}, "keys are uint64 (3,), but must be uint64 (2,)"),
    (encoder, {"steps": 0}, "0 steps and 3 silent ones, but at least 1 and 0 are needed"),
    (regular, {"steps": 2.5}, "RegularEncoder: 2.5 steps and 3 silent ones, but at least 1 and 0 are needed"),
    (regular, {"keys": np.ones(3, np.uint64)}, "RegularEncoder: keys are uint64 (3,), but must be uint64 (2,)"),
    (encoder, {"emitted": np.zeros(3, np.int32)}, "emitted is int32 (3,), but must be int64 (3,)"),
    (counter, {"presentations": 0}, "presentations is 0"),
    (counter, {"interval": 0}, "interval is 0"),
    (counter, {"raster": np.zeros((2, 5, 3), np.uint8)}, "raster is uint8 (2, 5, 3), but must be uint8 (2, 4, 3)"),
    (fused, {"batch": 0}, "batch is 0, but must be a whole number, at least 1"),
    (fused, {"rates": np.ones((2, 4), np.uint16)}, "rates' shape is (2, 4), but must be (n, 3)"),
    (fused, {"keys": np.ones(2)}, "keys are float64 (2,), but must be uint64 (2,)"),
    (fused, {"counts": np.zeros((2, 2))}, "counts is float64 (2, 2), but must be int32 (2, 2)"),
]


@pytest.mark.parametrize(("make", "changes", "text"), REFUSED)
def test_what_cannot_be_is_refused_when_it_is_made(make: Any, changes: dict[str, Any], text: str) -> None:
    with pytest.raises(NetworkLimitError) as caught:
        make(**changes)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_networks_that_could_overflow_are_refused() -> None:
    weights = np.full((140_000, 1), 1, np.int16)
    with pytest.raises(NetworkLimitError, match=r"weights above 0 of one neuron sum to 140,000, but Loihi's 24-bit"):
        PlaceNetwork(network=place(weights))
    with pytest.raises(NetworkLimitError, match="a bias of 700 makes its neuron spike without input"):
        PlaceNetwork(network=replace(place(weights[:3]), bias=np.array([700], np.int32)))


FLOATS = [
    (lambda: lif(vth=10.5), PyExcitatoryLIFFixed, PyExcitatoryLIFFloat, "vth is "),
    (lambda: lif(vth=2e5), PyExcitatoryLIFFixed, PyExcitatoryLIFFloat, "threshold is 200000"),
    (lambda: lif(floor=-60.5), PyExcitatoryLIFFixed, PyExcitatoryLIFFloat, "floor is "),
    (lambda: dense(weights=np.array([[0.5]])), PyDenseSynapsesFixed, PyDenseSynapsesFloat, "weight is 0.5"),
    (lambda: OneToOne(shape=(2,), weight=1.5), PyOneToOneFixed, PyOneToOneFloat, "weight is 1.5"),
]


@pytest.mark.parametrize(("make", "fixed", "floating", "text"), FLOATS)
def test_floats_are_for_the_float_model_only(make: Any, fixed: Any, floating: Any, text: str) -> None:
    make()._model_class = floating  # what Lava's compiler does when it has picked a model
    with pytest.raises(NetworkLimitError, match=text):
        make()._model_class = fixed
