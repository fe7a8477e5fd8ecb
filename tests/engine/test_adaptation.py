"""Adaptation: running means of drives against their definition, batches that change nothing, and the guard."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.small_models import small_model

from lava_vpr.engine.adaptation import Adaptation, Motion, RunningMean
from lava_vpr.engine.inference.fixed import FixedNetwork

TAU = 7.0


def network() -> FixedNetwork:
    learned = small_model().network
    assert learned.signed
    return learned


def rates(n: int, seed: int = 0) -> NDArray[np.uint16]:
    rng = np.random.default_rng(seed)
    shape = (n, network().inputs)
    return (rng.integers(0, 3000, shape) * (rng.random(shape) < 0.3)).astype(np.uint16)


def literal(spec: FixedNetwork, shown: NDArray[np.uint16], tau: float) -> list[list[int]]:
    """Biases by the words of the definition, neuron by neuron in plain Python."""
    weights = spec.weights.astype(int)
    mean = [-float(bias) / 64 for bias in spec.bias]
    biases = []
    for row in shown.astype(int):
        # Mantissas of 12 bits and one exponent for all, as `bias_registers` says.
        wanted = [min(round(-value * 64), spec.safe_bias) for value in mean]
        exponent = max(0, max(abs(value) for value in wanted).bit_length() - 12)
        biases.append([(abs(v) >> exponent << exponent) * (1 if v >= 0 else -1) for v in wanted])
        drives = [int(row @ weights[:, i]) / 65536 for i in range(spec.neurons)]
        mean = [value + (drive - value) / tau for value, drive in zip(mean, drives, strict=True)]
    return biases


def test_biases_are_running_mean_drives() -> None:
    spec, shown = network(), rates(12)
    biases = Adaptation(spec, TAU).biases(shown)
    assert biases.dtype == np.int32
    assert np.array_equal(biases[0], spec.bias)  # nothing has been seen yet
    assert biases.tolist() == literal(spec, shown, TAU)
    assert (biases[1:] != biases[0]).any(axis=1).all()


@pytest.mark.parametrize(("inputs", "narrow"), [(258, True), (259, False)])
def test_a_product_is_the_one_of_all_inputs(inputs: int, narrow: bool) -> None:
    """At the ends of what rates and weights can be, too: 65,535 x 127 x 258 is the most that 32 bits hold."""
    rng = np.random.default_rng(0)
    weights = rng.integers(-127, 127, (inputs, 45), np.int16, endpoint=True)
    weights[:, 0], weights[:, 1] = 127, -127
    spec = dataclasses.replace(network(), weights=weights, bits=7)
    assert spec.narrow == narrow
    shown = rng.integers(0, 65536, (4, inputs)).astype(np.uint16) * (rng.random((4, inputs)) < 0.4)
    shown[0], shown[1] = 65535, 0
    assert np.array_equal(spec.drives(shown), shown.astype(np.int64) @ weights.astype(np.int64))


@pytest.mark.parametrize("sizes", [(1,) * 12, (5, 7), (0, 12), (11, 0, 1)])
def test_batches_change_nothing(sizes: tuple[int, ...]) -> None:
    spec, shown = network(), rates(12)
    whole = Adaptation(spec, TAU).biases(shown)
    some, start = Adaptation(spec, TAU), 0
    parts = []
    for size in sizes:
        parts.append(some.biases(shown[start : start + size]))
        start += size
    assert np.array_equal(np.concatenate(parts), whole)


def test_what_was_seen_long_ago_is_forgotten() -> None:
    spec = network()
    steady = np.concatenate([rates(20)] * 10)
    one, two = (Adaptation(spec, 3.0).biases(np.concatenate([rates(20, seed), steady])) for seed in (5, 6))
    assert (one[21] != two[21]).any()
    assert np.array_equal(one[-1], two[-1])


def test_a_robot_that_stands_still_unlearns_nothing() -> None:
    spec, shown = network(), rates(4)
    standing = np.concatenate([shown[:3], np.repeat(shown[2:3], 50, axis=0), shown[3:]])
    biases = Adaptation(spec, TAU).biases(standing)
    moving = Adaptation(spec, TAU).biases(shown)
    assert np.array_equal(biases[-1], moving[-1])
    assert (biases[3:-1] == biases[3]).all()


def test_one_place_never_fills_the_mean_though_noise_hides_that_the_robot_stands() -> None:
    drive, place, other = rates(10, 1), rates(1, 2), rates(300, 3)
    shown = np.where(np.random.default_rng(4).random(other.shape) < 0.8, place, other)
    assert Motion().moving(shown).mean() > 0.9
    biases = Adaptation(network(), TAU).biases(np.concatenate([drive, shown]))
    assert len(np.unique(biases[10:], axis=0)) < 30


def test_frames_count_from_the_overlap_of_standing_on() -> None:
    row = np.full(100, 1000, np.uint16)

    def sharing(part: float) -> NDArray[np.uint16]:
        """Rates of the same sum, of which so much is where it was."""
        kept = np.zeros(200, np.uint16)
        kept[: int(100 * part)] = 1000
        kept[100 : 200 - int(100 * part)] = 1000
        return kept

    first = np.append(row, np.zeros(100, np.uint16))
    for part, counts in ((0.79, True), (0.8, False), (1.0, False), (0.0, True)):
        assert Motion().moving(np.stack([first, sharing(part)])).tolist() == [True, counts]


@pytest.mark.parametrize(("inputs", "counts"), [(126, True), (125, False), (100, False), (80, False), (79, True)])
def test_the_overlap_is_a_share_of_the_brighter_frame(inputs: int, counts: bool) -> None:
    """100 inputs spike, then so many, these or the first of them: 100 of 125 is 0.8, and so is 80 of 100."""
    shown = np.zeros((2, 130), np.uint16)
    shown[0, :100] = shown[1, :inputs] = 500
    assert Motion().moving(shown).tolist() == [True, counts]


def test_a_slow_drift_counts_again_when_it_has_left_the_last_frame_that_did() -> None:
    shown = np.zeros((30, 130), np.uint16)
    for i, row in enumerate(shown):
        row[i : i + 100] = 500  # one input further each frame
    moving = Motion().moving(shown)
    assert moving[0]
    assert np.flatnonzero(moving).tolist() == [0, 21]


def test_a_mean_moves_by_its_share() -> None:
    values = np.array([[1.0, 0.0], [1.0, 4.0], [1.0, 0.0]])
    means = RunningMean(np.zeros(2), 4.0).before(values, np.array([True, False, True]))
    assert means.tolist() == [[0.0, 0.0], [0.25, 0.0], [0.25, 0.0]]
