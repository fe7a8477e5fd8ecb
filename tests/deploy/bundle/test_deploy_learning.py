"""Learning as Loihi 2 can do it: thresholds folded into the weights, all of it in the bundle, and the same in Lava."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.literal.integers import mixed

from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.bundle.folder import ReadBundle, json_bytes
from lava_vpr.deploy.bundle.learning import (
    SETTINGS,
    ChipLearning,
    check_learning,
    chip_learning,
    learned_on_chip,
    learning_files,
)
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.inference.biases import bias_input_spikes
from lava_vpr.engine.learning.integer import present
from lava_vpr.engine.learning.integer_kernels import StepDraws
from lava_vpr.engine.learning.lava_order import FoldedPhase, LibraryDraws, fold, folded_phases, laterals, unfold
from lava_vpr.engine.learning.stdp import PlasticState
from lava_vpr.engine.random import GOLDEN, derived_key
from lava_vpr.engine.rates import draw_spikes, rates16
from lava_vpr.errors import BundleError, ConfigError, NetworkLimitError
from lava_vpr.isolated.runner import run_isolated
from lava_vpr.loihi import INPUT_LIMIT
from lava_vpr.model import Model
from lava_vpr.training.loop import train

PLACES, STEPS = 8, 60


def small_config(**learning: Any) -> Config:
    """Short presentations of few inputs."""
    changes = {"epochs": 4, "competition_epochs": 2, "steps": STEPS, **learning}
    encoder = {"image_size": 32, "cell": 8, "orientations": 4}
    return update(preset("loihi"), {"encoder": encoder, "learning": changes, "network": {"steps": 64}, "stretch": 4})


def traverse(config: Config, seed: int) -> EncodedTraverse:
    """Made-up responses of the input channels: what each place looks like, and some noise."""
    inputs = config.encoder.inputs
    looks = np.random.default_rng(0).random((PLACES, inputs)) ** 4
    noise = np.random.default_rng(seed).random((PLACES, inputs)) * 0.02
    return EncodedTraverse(
        tuple(f"{i}.png" for i in range(PLACES)),
        np.arange(PLACES),
        (looks + noise).astype(np.float32),
        np.zeros((PLACES, 28, 28), np.uint8),
        np.zeros((PLACES, 48, 64, 3), np.uint8),
    )


@pytest.fixture(scope="module", params=["regular", "poisson"])
def model(request: pytest.FixtureRequest) -> Model:
    """A model of two stretches, from two traverses."""
    config = small_config(trains=request.param)
    return train([traverse(config, 1), traverse(config, 2)], config)


def bundle_of(model: Model, **changes: Any) -> ReadBundle:
    """Its learning files, as a bundle would hold them, the description of the first stretch with ``changes``."""
    files = learning_files(model)
    told = json.loads(files[SETTINGS])
    told["stretches"][0] |= changes
    return ReadBundle(Path("memory"), {}, files | {SETTINGS: json_bytes(told)})


def test_what_is_written_is_of_the_model(model: Model) -> None:
    assert learning_files(model) == learning_files(model), "not the same bytes"
    check_learning(bundle_of(model), model)
    with pytest.raises(BundleError, match=r"learning.json: contradicts the rest of the bundle; deploy the model again"):
        check_learning(bundle_of(model, again=9), model)
    other = replace(model, config=small_config(trains=model.config.learning.trains, eta=0.7))
    with pytest.raises(BundleError, match=r"learning/\S+: contradicts the rest of the bundle; deploy the model again"):
        check_learning(bundle_of(other), model)
    fractional = replace(model, config=small_config(tau_trace=10.5))
    with pytest.raises(BundleError, match=r"learning.json: cannot be used \(learning.tau_trace is 10.5, .*\); deploy"):
        check_learning(bundle_of(model), fractional)


def test_rates_may_differ_by_what_machines_do(model: Model) -> None:
    """A rate of another machine is another key of its image, so that all that follows from it is another, too."""
    rates = rates16(model.activity, model.config.encoder.learning_spikes)
    rates[0] += 1
    files = learning_files(model, rates)
    assert files["learning/stretch000/keys.npy"] != learning_files(model)["learning/stretch000/keys.npy"]
    check_learning(ReadBundle(Path("memory"), {}, files), model)
    rates[0] += 1
    with pytest.raises(BundleError, match=r"learning/rates.npy: are not the rates of the references; deploy"):
        check_learning(ReadBundle(Path("memory"), {}, learning_files(model, rates)), model)


def test_the_schedule_is_trainings_own(model: Model) -> None:
    first, second = chip_learning(model)
    # Two epochs of the first traverse alone, then two of both; four places a stretch.
    assert np.bincount(first.epochs).tolist() == [4, 4, 8, 8]
    assert first.images[:4].tolist() == [0, 1, 2, 3]
    assert second.images[8:16].tolist() == [4, 5, 6, 7, 12, 13, 14, 15]
    assert len(set(first.keys.tolist()) | set(second.keys.tolist())) == 48, "two presentations share their noise"


def test_every_stretch_is_shown_its_own_view() -> None:
    config = update(small_config(), {"views": {"shifts": 3}})
    model = train([traverse(config, seed) for seed in range(6)], config)  # two traverses in three views
    parts = chip_learning(model)
    assert [(stretch.view, stretch.first_place) for stretch in model.stretches] == [
        (view, first) for view in range(3) for first in (0, 4)
    ]
    for part, stretch in zip(parts, model.stretches, strict=True):
        shown = [stretch.view * PLACES, (3 + stretch.view) * PLACES]  # where both traverses begin, in this view
        first, second = ([start + stretch.first_place + k for k in range(4)] for start in shown)
        assert part.images.tolist() == [*first, *first, *first, *second, *first, *second]
    assert len({int(key) for part in parts for key in part.keys}) == 6 * 24, "two presentations share their noise"


def slow_fold(weights: NDArray[np.uint8], theta: NDArray[np.int32], common: int, key: int) -> NDArray[np.uint8]:
    """`fold` in Python's integers."""
    own, folded = derived_key(key, "fold"), np.zeros(weights.shape, np.uint8)
    for j in range(weights.shape[0]):
        for i in range(weights.shape[1]):
            draw = mixed(own + int(GOLDEN) * ((i << 32) + j)) >> 32
            whole, rest = divmod(int(weights[j, i]) * common, int(theta[i]))
            folded[j, i] = min(255, whole + (draw * int(theta[i]) < rest << 32))
    return folded


def test_folding_is_division_with_stochastic_rounding() -> None:
    rng = np.random.default_rng(3)
    weights = rng.integers(0, 256, (40, 9)).astype(np.uint8)
    theta = rng.integers(1, 2000, 9).astype(np.int32)
    for key in (1, 2**63 - 1):
        assert np.array_equal(fold(weights, theta, 700, key), slow_fold(weights, theta, 700, key))
    same = np.full(9, 700, np.int32)
    assert np.array_equal(fold(weights, same, 700, 5), weights)
    half = np.mean([fold(np.full((40, 9), 101, np.uint8), 2 * same, 700, key) for key in range(200)])
    assert abs(half - 50.5) < 0.02


def test_what_the_chip_learned_is_added_in_full() -> None:
    host = np.array([[100, 250, 3]], np.uint8)
    unfold(host, np.array([[50, 10, 9]], np.uint8), np.array([[57, 20, 0]], np.uint8))
    assert host.tolist() == [[107, 255, 0]]


def test_lateral_weights_are_scaled_and_never_overflow() -> None:
    mantissas, exponent = laterals(400, np.array([100, 200, 400], np.int32), 200)
    assert exponent == 1
    assert mantissas.tolist() == [255, 200, 100]
    crowd, exponent = laterals(255 << 7, np.full(300, 10, np.int32), 200)
    assert crowd.tolist() == [255] * 300
    assert int(crowd[0]) << exponent < INPUT_LIMIT


def slow_presentation(
    part: ChipLearning, phase: FoldedPhase, weights: NDArray[np.uint8], common: int, lateral: NDArray[np.int64], k: int
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """One presentation on the chip, step by step in plain numpy; the weights and spike counts after it."""
    chip, rule = phase.chip, phase.chip.rule
    draws = LibraryDraws(part.seeds[0])
    for _ in range(k + 1):
        trace_draws, weight_draws = draws.next(chip.interval)
    spikes_of = bias_input_spikes if chip.regular else draw_spikes
    spikes = spikes_of(part.rates[part.images[k]], int(part.keys[k]), chip.steps)
    w, neurons = weights.astype(np.int64), weights.shape[1]
    v, x = np.zeros(neurons, np.int64), np.zeros(len(w), np.int64)
    arrived, fired, relayed = np.zeros(neurons, np.int64), np.zeros(neurons, bool), np.zeros(neurons, bool)
    counts = np.zeros(neurons, np.int64)
    for step in range(chip.interval):
        drive = arrived - lateral * (relayed.any() & ~relayed)
        v = np.sign(v) * (np.abs(v) * (4096 - chip.neurons.dv) >> 12) + (drive << 6)
        relayed, fired = fired, v > common << 6
        v[fired] = 0
        counts += fired
        now = spikes[step] if step < chip.steps else np.zeros(len(w), bool)
        arrived = w[now].sum(axis=0)
        whole, chance = np.divmod(np.exp(-1 / rule.tau) * x, 1)
        x = whole.astype(np.int64) + (int(trace_draws[step]) < np.ceil(chance * 2.0**53))
        x[now] = 127
        change = sum(m * 2.0**e for m, e in rule.products) * (x - rule.target)
        for i in np.flatnonzero(fired):
            total = w[:, i] + change
            low = np.floor(total)
            w[:, i] = np.clip(low + (int(weight_draws[step]) < np.ceil((total - low) * 2.0**53)), 0, 255)
    return w.astype(np.uint8), counts


def test_a_presentation_equals_a_literal_one(model: Model) -> None:
    part = chip_learning(model)[0]
    trainer = part.trainer()
    trainer.begin_epoch(0)
    learned = 0
    for k in range(4):
        before = trainer.state()["theta"].copy()
        given = trainer.begin(int(part.keys[k]))
        lateral = given.mantissas << given.exponent
        weights, counts = slow_presentation(part, trainer.phase, given.weights, trainer.common, lateral, k)
        again = part.trainer()
        again.begin_epoch(0)
        for j in range(k):
            again.record(part.rates[part.images[j]], int(part.keys[j]))
        seen, after, _ = again.record(part.rates[part.images[k]], int(part.keys[k]))
        assert np.array_equal(seen, counts)
        assert np.array_equal(after["weights"], weights)
        trainer.end(given, weights, counts.astype(np.int32))
        assert np.array_equal(trainer.state()["theta"], before + counts * trainer.phase.theta_plus)
        assert np.array_equal(trainer.state()["weights"], again.state()["weights"])
        learned += int(counts.sum())
    assert learned > 0, "nothing was learned"


@pytest.mark.lava
@pytest.mark.parametrize("epoch", [pytest.param(0, marks=pytest.mark.slow), 3])
def test_lavas_library_learns_the_same(model: Model, epoch: int) -> None:
    """LearningDense and LIFReset alone, both phases: every spike, weight and trace of several presentations."""
    from lava_vpr.processes.jobs.learning import FOLDED

    part = chip_learning(model)[1]
    trainer = part.trainer()
    trainer.begin_epoch(0)
    for image, key in zip(part.images[:4], part.keys[:4], strict=True):
        trainer.present(part.rates[image], int(key))
    state = {name: value.copy() for name, value in trainer.state().items()}
    arrays = {"weights": state["weights"], "theta": state["theta"], "rates": part.rates[part.images[:3]]}
    arrays["keys"] = part.keys[:3]
    options = {"phases": [asdict(phase) for phase in part.phases], "seeds": list(part.seeds), "epoch": epoch}
    got = run_isolated(FOLDED, arrays, options, timeout=300)
    trainer.begin_epoch(epoch)
    spikes = 0
    for k in range(3):
        counts, after, film = trainer.record(arrays["rates"][k], int(arrays["keys"][k]), raster=True)
        assert np.array_equal(got["raster"][k], film)
        assert np.array_equal(got["weights"][k], after["weights"])
        assert np.array_equal(got["traces"][k], after["traces"])
        spikes += int(counts.sum())
    assert spikes > 0
    assert np.array_equal(got["host_weights"], trainer.state()["weights"])
    assert np.array_equal(got["host_theta"], trainer.state()["theta"])


@pytest.mark.parametrize(("steps", "interval"), [(STEPS, 64), (61, 64), (62, 128), (350, 512), (65533, 65536)])
def test_presentations_are_as_long_as_the_chip_can_reset(steps: int, interval: int) -> None:
    for phase in folded_phases(small_config(steps=steps).learning, 128, 5.0):  # type: ignore[arg-type]
        assert (phase.chip.steps, phase.chip.interval) == (steps, interval)
        assert phase.chip.silent_steps >= 3


def test_presentations_that_are_too_long_to_reset_are_refused() -> None:
    with pytest.raises(NetworkLimitError, match=r"65,534 steps .* train with learning.steps of at most 65,533$"):
        folded_phases(small_config(steps=65534).learning, 128, 5.0)  # type: ignore[arg-type]


def test_silent_steps_change_nothing_but_what_is_drawn(model: Model) -> None:
    """Nothing is in flight after three silent steps: with as many and with more, the same spikes, the same weights."""
    part = chip_learning(model)[0]
    chip = part.phases[0].chip
    results = []
    for silent in (3, chip.silent_steps + 64):
        state = PlasticState(part.start.weights.copy(), part.start.theta.copy())
        learned = replace(chip, silent_steps=silent)
        draws = LibraryDraws(1).next(chip.steps + 3 + 64 + chip.silent_steps)
        own = StepDraws(draws.traces[: learned.interval], draws.weights[: learned.interval])
        counts, _, film = present(state, learned, part.rates[0], int(part.keys[0]), draws=own, raster=True)
        assert film.shape[0] == learned.interval
        assert not film[chip.steps + 3 :].any()
        results.append((counts, state.weights))
    assert results[0][0].sum() > 0
    for one, other in zip(*results, strict=True):
        assert np.array_equal(one, other)


def test_what_is_learned_recognises_its_places(model: Model) -> None:
    learned = learned_on_chip(model, 1)
    assert learned.network.weights.shape == model.network.weights.shape
    own = learned.responses.argmax(axis=0)
    assert len(set(own.tolist())) >= PLACES - 2, "places share their neurons"


def test_what_cannot_be_learned_on_the_chip_is_told(model: Model) -> None:
    fractional = replace(model, config=small_config(tau_trace=10.5))
    with pytest.raises(ConfigError, match=r"learning.tau_trace is 10.5, but must be a whole number of steps"):
        learning_files(fractional)
    with pytest.raises(
        ConfigError,
        match=r"^learning on the chip needs an integer network, but preset paper is the float conductance model",
    ):
        learning_files(replace(model, config=preset("paper")))
