"""Learning as Lava Processes, our own and the library's, against the host engine: every spike, weight and threshold."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.places import encoded
from lava_vpr.config import Config, preset
from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.learning.integer import (
    IntegerLearning,
    WeightRule,
    initial_state,
    phases,
    present,
    scale_thresholds,
)
from lava_vpr.engine.learning.integer_kernels import SILENT_STEPS
from lava_vpr.engine.learning.lava_order import LibraryDraws
from lava_vpr.engine.learning.stdp import PlasticState
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.rates import draw_spikes, rates16
from lava_vpr.errors import NetworkLimitError
from lava_vpr.isolated.runner import run_isolated
from lava_vpr.processes.jobs.learning import LEARNING, LIBRARY
from lava_vpr.processes.networks.process import LearningPlaceNetwork
from lava_vpr.processes.plastic_dense.process import FloatRule, PlasticDense

pytestmark = pytest.mark.lava

INPUTS, NEURONS, IMAGES = 30, 6, 5
COMPETITION = IntegerLearning(
    rule=WeightRule(((6, -6), (1, -7)), 15, 0, 20.0),
    inhibition=240,
    neurons=LifParameters(dv=205, floor=-480, hold_steps=1, theta_plus=32),
    weight_sum=13 * INPUTS,
    steps=80,
)
CONSOLIDATION = dataclasses.replace(
    COMPETITION,
    rule=WeightRule(((5, -7), (-2, -7)), 20, 1, 10.0),
    neurons=dataclasses.replace(COMPETITION.neurons, theta_plus=0),
)
LATE = dataclasses.replace(COMPETITION, late_theta=True, regular=True)
PLAIN = dataclasses.replace(COMPETITION, neurons=LifParameters(dv=205), weight_sum=0)


Start = tuple[PlasticState, NDArray[np.uint16], NDArray[np.uint64]]


def start() -> Start:
    """A state, and rates and keys of `IMAGES` presentations."""
    rng = np.random.default_rng(0)
    state = PlasticState(rng.integers(0, 40, (INPUTS, NEURONS)).astype(np.uint8), np.full(NEURONS, 480, np.int32))
    rates = np.minimum(rng.gamma(1.0, 7000.0, (IMAGES, INPUTS)), 65535).astype(np.uint16)
    return state, rates, presentation_keys(0, "train", np.arange(IMAGES))


def through_lava(
    phase: IntegerLearning, state: PlasticState, rates: NDArray[np.uint16], keys: NDArray[np.uint64], **options: Any
) -> dict[str, NDArray[Any]]:
    """What `LearningPlaceNetwork` makes of the presentations."""
    arrays = {"weights": state.weights, "theta": state.theta, "rates": rates, "keys": keys}
    reports: list[int] = []
    found = run_isolated(
        LEARNING, arrays, {"learning": dataclasses.asdict(phase), **options}, timeout=240, progress=reports.append
    )
    assert sum(reports) <= len(keys)
    return found


def hold_against_host(
    phase: IntegerLearning, state: PlasticState, rates: NDArray[np.uint16], keys: NDArray[np.uint64]
) -> int:
    """Compare each presentation with the host engine's, which changes ``state``; how many spikes there were."""
    found = through_lava(phase, state, rates, keys)
    spikes = 0
    for k, key in enumerate(keys):
        before, traces = state.weights.copy(), np.zeros(len(state.weights), np.uint8)
        counts, _, raster = present(state, phase, rates[k], int(key), traces=traces, raster=True)
        assert np.array_equal(found["raster"][k], raster)
        assert np.array_equal(found["weights"][k], state.weights)
        assert np.array_equal(found["traces"][k], traces)
        assert np.array_equal(found["theta"][k], state.theta)
        assert not np.array_equal(before, state.weights)
        spikes += int(counts.sum())
    return spikes


@pytest.mark.parametrize(
    "phase",
    [
        pytest.param(COMPETITION, id="competition"),
        pytest.param(CONSOLIDATION, id="consolidation", marks=pytest.mark.slow),
        pytest.param(LATE, id="late theta, regular trains", marks=pytest.mark.slow),
    ],
)
def test_every_weight_trace_threshold_and_spike_equals_the_host_engine(phase: IntegerLearning) -> None:
    assert hold_against_host(phase, *start()) > 30


def untrained(config: Config, neurons: int) -> tuple[IntegerLearning, IntegerLearning, PlasticState]:
    """Both phases of learning, and the state at its start."""
    learning, inputs, spikes = config.learning, config.encoder.inputs, config.encoder.learning_spikes
    return *phases(learning, inputs, spikes), initial_state(inputs, neurons, learning, spikes, config.seed, 0)


@pytest.mark.slow
@pytest.mark.data
def test_the_first_real_images_of_both_phases_equal_the_host_engine(data_root: Path) -> None:
    config = preset("loihi")
    images = encoded("summer", config.encoder).take(slice(0, 5))
    rates = rates16(images.activity, config.encoder.learning_spikes)
    keys = presentation_keys(config.seed, "train", images.indices)
    competition, consolidation, state = untrained(config, 100)
    assert hold_against_host(competition, state, rates, keys) > 50
    scale_thresholds(state.theta, config.learning.consolidation_threshold)
    assert hold_against_host(consolidation, state, rates[:5], keys[:5] + np.uint64(1)) > 20


def one_presentation(phase: IntegerLearning, given: Start | None = None, **options: Any) -> dict[str, NDArray[Any]]:
    """What Lava's library, or ``own`` models with its random numbers, make of the first presentation."""
    state, rates, keys = given or start()
    arrays = {"weights": state.weights, "theta": state.theta, "rates": rates[:1], "keys": keys[:1]}
    return run_isolated(LIBRARY, arrays, {"learning": dataclasses.asdict(phase), "rng_seed": 7, **options}, timeout=120)


@pytest.mark.slow
def test_the_library_alone_equals_the_host_engine() -> None:
    state, rates, keys = start()
    found, own = one_presentation(PLAIN), one_presentation(PLAIN, own=True)
    before, traces = state.weights.copy(), np.zeros(INPUTS, np.uint8)
    draws = LibraryDraws(7).next(PLAIN.steps + SILENT_STEPS)
    counts, _, raster = present(state, PLAIN, rates[0], int(keys[0]), draws=draws, traces=traces, raster=True)
    for side in (found, own):
        assert np.array_equal(side["raster"], raster)
        assert np.array_equal(side["weights"], state.weights)
        assert np.array_equal(side["traces"], traces)
    assert counts.sum() > 10
    assert (state.weights != before).mean() > 0.2


@pytest.mark.slow
@pytest.mark.data
def test_a_real_image_is_learned_alike_by_the_library(data_root: Path) -> None:
    config = preset("loihi")
    images = encoded("summer", config.encoder).take(slice(0, 1))
    rates = rates16(images.activity, config.encoder.learning_spikes)
    keys = presentation_keys(config.seed, "train", images.indices)
    competition, _, state = untrained(config, 25)
    phase = dataclasses.replace(competition, neurons=LifParameters(dv=competition.neurons.dv), weight_sum=0)
    found, own = (one_presentation(phase, (state, rates, keys), own=own) for own in (False, True))
    for name in ("raster", "weights", "traces"):
        assert np.array_equal(found[name], own[name]), name
    assert own["raster"].sum() > 5
    changed = own["weights"] != state.weights
    assert changed.mean() > 0.01
    print(f"{own['raster'].sum()} spikes, {changed.sum()} weights learned, all equal")  # shown with pytest's -s


def float_presentation(
    phase: IntegerLearning,
    weights: NDArray[np.float64],
    theta: NDArray[np.float64],
    spikes: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """A presentation without rounding, literally; changes ``weights`` (inputs, neurons) and ``theta``."""
    lif, rule, total = phase.neurons, phase.rule, phase.steps + SILENT_STEPS
    rate = sum(mantissa * 2.0**exponent for mantissa, exponent in rule.products) / 2 ** max(0, 9 * rule.mu - 4)
    weights *= phase.weight_sum / weights.sum(axis=0)
    x, v, held = np.zeros(len(weights)), np.zeros(len(theta)), np.zeros(len(theta), int)
    drive, raster = np.zeros(len(theta)), np.zeros((total, len(theta)), np.uint8)
    for t in range(total):
        lost = raster[t - 2].any() & (raster[t - 2] == 0) if t >= 2 else 0  # winners are spared
        v = np.maximum(v * (1 - lif.dv / 4096) + drive - phase.inhibition * lost, lif.floor)
        v[held > 0] = 0
        held = np.maximum(held - 1, 0)
        fired = v > theta
        v[fired], held[fired], raster[t] = 0, lif.hold_steps, fired
        theta[fired] += lif.theta_plus
        now = spikes[t] if t < phase.steps else np.zeros(len(x), bool)
        drive = weights[now].sum(axis=0)
        x = np.where(now, 127.0, x * np.exp(-1 / rule.tau))
        change = rate * (x - rule.target)[:, None] * (255 - weights) ** rule.mu
        weights[:, fired] = np.clip(weights + change, 0, 255)[:, fired]
    return x / 127, raster


@pytest.mark.slow
@pytest.mark.parametrize("phase", [COMPETITION, CONSOLIDATION], ids=["competition", "consolidation"])
def test_the_floating_point_models_run_the_same_spec_without_rounding(phase: IntegerLearning) -> None:
    state, rates, keys = start()
    found = through_lava(phase, state, rates[:3], keys[:3], tag="floating_pt")
    weights, theta = state.weights.astype(float), state.theta.astype(float)
    for k in range(3):
        traces, raster = float_presentation(phase, weights, theta, draw_spikes(rates[k], int(keys[k]), phase.steps))
        assert np.array_equal(found["raster"][k], raster)
        assert raster.any()
        for name, wanted in (("weights", weights), ("theta", theta), ("traces", traces)):
            assert np.allclose(found[name][k], wanted, rtol=1e-9, atol=1e-9)
    assert not np.array_equal(weights, np.round(weights))


RULE = FloatRule(eta=0.1, target=0.2, mu=0.5, tau=5.0, w_max=2.0)


def float_rule_in_lava(tag: str, weights: NDArray[np.float64]) -> tuple[dict[str, NDArray[Any]], NDArray[np.bool_]]:
    rng = np.random.default_rng(3)
    spikes = rng.random((2 * (20 + SILENT_STEPS) + 4, 12)) < 0.2
    arrays = {"pre": spikes[:, :8], "post": spikes[:, 8:], "weights": weights, "keys": np.arange(2, dtype=np.uint64)}
    plastic = {"steps": 20, "weight_sum": 4.0, "weight_exp": -1}
    options = {"tag": tag, "rule": RULE._asdict(), "plastic": plastic}
    return run_isolated("support.lava.learning_dense:float_rule", arrays, options, timeout=60), spikes


def test_a_float_rule_is_the_papers_equation() -> None:
    weights = np.random.default_rng(4).random((4, 8))
    found, spikes = float_rule_in_lava("floating_pt", weights)
    steps = 20 + SILENT_STEPS
    for t, row in enumerate(spikes):
        pre, post = row[:8], np.flatnonzero(row[8:])
        if t < 2 * steps:
            if t % steps == 0:
                x = np.zeros(8)
                weights = weights * 4.0 / weights.sum(axis=1, keepdims=True)
            sums = weights @ pre / 2
            x = np.where(pre, 1.0, x * np.exp(-1 / RULE.tau))
            for i in post:
                weights[i] = np.clip(weights[i] + RULE.eta * (x - RULE.target) * np.sqrt(2.0 - weights[i]), 0, 2)
            if t % steps == steps - 1:
                assert np.allclose(found["weights"][t // steps], weights, rtol=1e-12)
                assert np.allclose(found["traces"][t // steps], x, rtol=1e-12)
        else:  # after the last presentation it passes spikes on, and learns nothing
            sums = weights @ pre / 2
    assert np.allclose(found["x1"], x, rtol=1e-12)
    assert np.allclose(found["a_buff"], sums, rtol=1e-12)


def test_a_float_rule_has_no_integer_model() -> None:
    with pytest.raises(NetworkLimitError, match="rule is a FloatRule"):
        float_rule_in_lava("fixed_pt", np.ones((4, 8)))


KEYS = np.zeros(2, np.uint64)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"weights": np.full((2, 3), 256)}, "weight is 256"),
        ({"weights": np.full((2, 3), 0.5)}, "weight is 0.5"),
        ({"weights": np.zeros(3, int)}, r"weights' shape is \(3,\)"),
        ({"rule": WeightRule(((9, 0),), 10, 0, 20.0)}, "product 9 x"),
        ({"rule": FloatRule(0.1, 0.2, 0.0, 20.0, 2.0), "weights": np.full((2, 3), 2.5)}, "weight is 2.5"),
        ({"rule": FloatRule(0.1, 0.2, 0.0, 0.0, 2.0)}, "tau is 0.0"),
        ({"rule": FloatRule(-0.1, 0.2, 0.0, 1.0, 2.0)}, "eta is -0.1"),
        ({"weight_exp": -8}, "weight_exp is -8"),
        ({"steps": -1}, "steps is -1"),
        ({"steps": 0}, "steps is 0"),
        ({"weight_sum": -1}, "weight_sum is -1"),
        ({"keys": None}, "keys is None"),
        ({"keys": np.zeros(2, np.int64)}, "keys is int64"),
        ({"rng_seed": -1}, "rng_seed is -1"),
        ({"silent_steps": -1}, "silent_steps is -1"),
        ({"record_traces": np.zeros((1, 3), np.uint8)}, r"record_traces is uint8 \(1, 3\)"),
    ],
)
def test_a_connection_that_cannot_be_is_refused(changes: dict[str, Any], text: str) -> None:
    usual = {"weights": np.ones((2, 3), np.uint8), "rule": WeightRule(((1, 0),), 10, 0, 20.0), "steps": 5, "keys": KEYS}
    PlasticDense(**usual)
    with pytest.raises(NetworkLimitError, match=text):
        PlasticDense(**{**usual, **changes})


def test_a_network_that_cannot_be_is_refused() -> None:
    state, _, keys = start()
    for inhibition, text in (
        (1 << 17, "inhibition is 131,072 while learning"),
        (511, "inhibition is 511, but must be m"),
    ):
        changed = dataclasses.replace(COMPETITION, inhibition=inhibition)
        with pytest.raises(NetworkLimitError, match=text):
            LearningPlaceNetwork(learning=changed, state=state, keys=keys)
    high = PlasticState(state.weights, np.full(NEURONS, 1 << 17, np.int32))
    with pytest.raises(NetworkLimitError, match="threshold is 131072"):
        LearningPlaceNetwork(learning=COMPETITION, state=high, keys=keys)


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("phase", "text"),
    [
        (dataclasses.replace(PLAIN, neurons=LifParameters(floor=-5)), "floor is -5"),
        (dataclasses.replace(PLAIN, neurons=LifParameters(hold_steps=1)), "hold_steps is 1"),
        (dataclasses.replace(PLAIN, neurons=LifParameters(theta_plus=3)), "theta_plus is 3"),
        (dataclasses.replace(PLAIN, weight_sum=100), "weight_sum is 100"),
    ],
)
def test_what_lavas_library_lacks_is_refused(phase: IntegerLearning, text: str) -> None:
    with pytest.raises(NetworkLimitError, match=text):
        one_presentation(phase)
