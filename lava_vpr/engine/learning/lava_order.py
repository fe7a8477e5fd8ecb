"""Integer learning within the limits of Lava's library: one threshold for all neurons, no floor, hold or normalisation.

Rising thresholds are folded into the weights. The membrane is linear and reset to 0, so a neuron with threshold T
spikes exactly when a neuron with threshold ``common`` and all inputs scaled by common / T would. The host does this
scaling between presentations, together with the normalisation, which no learning engine can do::

    W      = normalised(W)                   to ``weight_sum``, as `lava_vpr.engine.learning.integer.normalise`
    w = min(255, W common / T) the chip's weight, rounded stochastically
    L      = min(255, (2 M common + T) // 2T) 2^E     its lateral weight, M 2^E the inhibition at T = common
    ...      one presentation on the chip, from cleared states: w becomes w', neuron i spikes n_i times
    W      = clip(W + w' - w, 0, 255)        what was learned, in full
    T      = T + theta_plus n                at most 17 bits

The host keeps W and T; the chip has w, L and the one threshold. ``common`` is the upper median of T at the start of an
epoch: for a neuron with T = ``common`` all 8 bits of a weight are used, and the chip's rule, which adds an absolute
amount, adds the right one. A neuron with a larger T learns too fast within a presentation, one with a smaller T too
slowly; but the host adds the chip's amount to W as it is, not divided by the scale.

Random numbers within a presentation are those of Lava's fixed-point ``LearningDense``, in one run of Lava an epoch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import StdpLearning
from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.inference.quantise import mantissa_of
from lava_vpr.engine.learning.integer import (
    AGAIN,
    IntegerLearning,
    normalise,
    phases,
    present,
    scale_thresholds,
)
from lava_vpr.engine.learning.integer_kernels import SILENT_STEPS, StepDraws, scale_columns
from lava_vpr.engine.learning.recruiting import Thresholds
from lava_vpr.engine.learning.stdp import PlasticState
from lava_vpr.engine.presentations import check_array
from lava_vpr.engine.random import derived_key, presentation_key
from lava_vpr.errors import ConfigError, InputError, NetworkLimitError
from lava_vpr.loihi import LOIHI_2_RESET_LIMIT, THRESHOLD_LIMIT, WEIGHT_LIMIT, reset_interval

FACTOR_BITS = 8
"""`FoldedPhase.threshold_factor` is in units of 2^-8."""


@dataclass(frozen=True)
class FoldedPhase:
    """One phase of folded learning.

    Attributes:
        chip: The phase as the chip runs it: without floor, hold or normalisation, with constant thresholds, and with
            silent steps up to an interval at which the chip can reset.
        weight_sum: Sum to which the host normalises each neuron's weights.
        theta_plus: Amount that the host adds to a neuron's threshold for each of its spikes.
        threshold_factor: All thresholds are multiplied by it / 256 when the phase begins.
        epochs: Number of epochs.
    """

    chip: IntegerLearning
    weight_sum: int
    theta_plus: int
    threshold_factor: int
    epochs: int


def settings(learning: StdpLearning) -> StdpLearning:
    """The settings that folded learning derives its integers from; see `ETA` and `THETA_PLUS`."""
    return replace(
        learning,
        arithmetic="integer",
        theta_update="presentation",
        eta=learning.eta * ETA,
        theta_plus=learning.theta_plus * THETA_PLUS,
    )


def silent_steps(steps: int) -> int:
    """Silent steps after ``steps`` with input: at least `SILENT_STEPS`, up to an interval at which Loihi 2 can reset.

    Raises:
        NetworkLimitError: no interval between two resets is so long.
    """
    interval = reset_interval(steps + SILENT_STEPS)
    if interval > LOIHI_2_RESET_LIMIT:
        raise NetworkLimitError(
            f"presentations of {steps:,} steps and {SILENT_STEPS} silent ones are longer than the "
            f"{LOIHI_2_RESET_LIMIT:,} between two resets on Loihi 2; train with learning.steps of at most "
            f"{LOIHI_2_RESET_LIMIT - SILENT_STEPS:,}"
        )
    return interval - steps


ETA, THETA_PLUS = 0.6, 1.0
"""Factors on ``learning.eta`` (first phase) and ``learning.theta_plus``. Chosen on Nordland 0:500, seeds 0 to 2, so
recall there is optimistic. Without a hold after a spike, and with a constant threshold, a neuron spikes more often in a
presentation; at the full rate it would overfit to that one presentation
(`python -m benchmarks recall chip-learning`)."""


def folded_phases(learning: StdpLearning, inputs: int, spikes_per_step: float) -> tuple[FoldedPhase, FoldedPhase]:
    """The two phases of folded learning under the settings of float learning.

    Raises:
        ConfigError: a setting that the chip cannot express.
        NetworkLimitError: the network could overflow.
    """
    folded = settings(learning)
    for name in ("tau_trace", "consolidation_tau_trace"):
        tau = getattr(folded, name)
        if tau != int(tau):  # Lava keeps it in an integer Var, and reads it whenever one is set
            raise ConfigError(f"learning.{name} is {tau!r}, but must be a whole number of steps to learn on the chip")
    first, second = (
        FoldedPhase(
            chip=replace(
                part,
                neurons=LifParameters(dv=part.neurons.dv),
                weight_sum=0,
                late_theta=False,
                silent_steps=silent_steps(part.steps),
            ),
            weight_sum=part.weight_sum,
            theta_plus=part.neurons.theta_plus,
            threshold_factor=factor,
            epochs=epochs,
        )
        for part, factor, epochs in zip(
            phases(folded, inputs, spikes_per_step),
            (1 << FACTOR_BITS, round(folded.consolidation_threshold * (1 << FACTOR_BITS))),
            (folded.competing, folded.epochs - folded.competing),
            strict=True,
        )
    )
    return first, second


def library_seed(seed: int, stretch: int, epoch: int) -> int:
    """Lava's ``rng_seed`` of the run of an epoch of the stretch with the key ``stretch``, 31 bits."""
    return derived_key(presentation_key(seed, "start", stretch, epoch), "library") >> 33


class LibraryDraws:
    """The random numbers of Lava's LearningDense, presentation after presentation of one run.

    Source: lava-nc 0.10, ``magma/core/learning/random.py``: either generator draws once when it is made; traces then
    draw twice a step, weights once, with a seed of 2 that cannot be changed.
    """

    def __init__(self, rng_seed: int) -> None:
        self._traces, self._weights = np.random.default_rng(rng_seed), np.random.default_rng(2)
        self._traces.random()
        self._weights.random()

    def next(self, steps: int) -> StepDraws:
        """The random numbers of the next ``steps`` steps."""
        traces, weights = self._traces.random(2 * steps)[1::2], self._weights.random(steps)
        return StepDraws((traces * 2.0**53).astype(np.uint64), (weights * 2.0**53).astype(np.uint64))


def common_threshold(thresholds: NDArray[np.int32]) -> int:
    """The one threshold of an epoch: the upper median of the neurons' own."""
    return int(np.sort(thresholds)[len(thresholds) // 2])


def fold(weights: NDArray[np.uint8], thresholds: NDArray[np.int32], common: int, key: int) -> NDArray[np.uint8]:
    """The chip's weights, ``min(255, W common / T)``, rounded stochastically.

    Args:
        weights: The host's, uint8 (inputs, neurons).
        thresholds: Thresholds of the neurons, int32 (neurons,), at least 1.
        common: The chip's one threshold.
        key: Key of the presentation.
    Raises:
        InputError: an array of another type or shape, or a threshold below 1.
    """
    check_array(weights, "weights", np.uint8, (len(weights), len(thresholds)), AGAIN)
    check_array(thresholds, "thresholds", np.int32, (len(thresholds),), AGAIN)
    if thresholds.min(initial=1) < 1:
        raise InputError(f"thresholds down to {thresholds.min()}, but they are at least 1; {AGAIN}")
    folded = weights.copy()
    scale_columns(folded, common, thresholds.astype(np.int64), np.uint64(derived_key(key, "fold")))
    return folded


def unfold(weights: NDArray[np.uint8], before: NDArray[np.uint8], after: NDArray[np.uint8]) -> None:
    """Add to the host's ``weights``, in place, how the chip's changed in a presentation."""
    weights[...] = np.clip(weights.astype(np.int16) + after - before.astype(np.int16), 0, WEIGHT_LIMIT)


def laterals(inhibition: int, thresholds: NDArray[np.int32], common: int) -> tuple[NDArray[np.int64], int]:
    """Each neuron's lateral weight, as mantissas int64 (neurons,) of 8 bits and one exponent."""
    mantissa, exponent = mantissa_of(inhibition, WEIGHT_LIMIT)
    divisors = thresholds.astype(np.int64)
    return np.minimum((2 * mantissa * common + divisors) // (2 * divisors), WEIGHT_LIMIT), exponent


@dataclass(frozen=True)
class Boundary:
    """What the host writes to the chip before a presentation: weights, uint8 (inputs, neurons), and lateral weights."""

    weights: NDArray[np.uint8]
    mantissas: NDArray[np.int64]
    exponent: int


class FoldedTrainer:
    """The plastic network of one stretch as Lava's library runs it, on a board or simulated.

    `present` is `begin`, a presentation on the host's model of the chip, and `end`. A host program for a chip, or for
    Lava, calls `begin` and `end` around its own presentation.
    """

    def __init__(self, learning: Sequence[FoldedPhase], state: PlasticState, seeds: Sequence[int]) -> None:
        """Make the trainer at the start of the first phase; `begin_epoch` chooses the phase and the draws of an epoch.

        Args:
            learning: The phases.
            state: Weights and thresholds at the start, changed in place.
            seeds: Lava's ``rng_seed`` of each epoch (`library_seed`).
        """
        self.learning, self._state, self.seeds = tuple(learning), state, tuple(seeds)
        self.phase, self.common = self.learning[0], common_threshold(state.theta)
        self.draws = LibraryDraws(0)
        self._start = float(state.theta.min())

    def begin_epoch(self, epoch: int) -> None:
        """Choose phase and common threshold of ``epoch`` (from 0); call it before the epoch's first image."""
        first = 0
        for phase in self.learning:
            if first <= epoch < first + phase.epochs:
                self.phase = phase
                if epoch == first:
                    scale_thresholds(self._state.theta, phase.threshold_factor / (1 << FACTOR_BITS))
            first += phase.epochs
        self.common = common_threshold(self._state.theta)
        self.draws = LibraryDraws(self.seeds[epoch])

    def begin(self, key: int) -> Boundary:
        """Normalise and fold, for the presentation with this key."""
        normalise(self._state.weights, self.phase.weight_sum, key)
        mantissas, exponent = laterals(self.phase.chip.inhibition, self._state.theta, self.common)
        return Boundary(fold(self._state.weights, self._state.theta, self.common, key), mantissas, exponent)

    def end(self, boundary: Boundary, weights: NDArray[np.uint8], counts: NDArray[np.int32]) -> None:
        """Add what the chip learned, from its ``weights`` after the presentation and its spike counts."""
        unfold(self._state.weights, boundary.weights, weights)
        raised = self._state.theta + counts.astype(np.int64) * self.phase.theta_plus
        self._state.theta[:] = np.minimum(raised, THRESHOLD_LIMIT - 1)

    def present(self, rates: NDArray[np.uint16], key: int, place: int = 0, epoch: int = 0) -> NDArray[np.int32]:
        """Show one image, learn; spike counts int32 (neurons,). ``place`` and ``epoch`` are not needed."""
        counts, _, _ = self.record(rates, key)
        return counts

    def record(
        self, rates: NDArray[np.uint16], key: int, raster: bool = False
    ) -> tuple[NDArray[np.int32], dict[str, NDArray[np.uint8]], NDArray[np.uint8]]:
        """`present`; also the chip's ``weights`` and ``traces`` after it, and the raster (interval, neurons)."""
        boundary = self.begin(key)
        chip = PlasticState(boundary.weights.copy(), np.full(len(self._state.theta), self.common, np.int32))
        traces = np.zeros(len(chip.weights), np.uint8)
        counts, _, film = present(
            chip,
            self.phase.chip,
            rates,
            key,
            draws=self.draws.next(self.phase.chip.interval),
            traces=traces,
            inhibition=boundary.mantissas << boundary.exponent,
            raster=raster,
        )
        self.end(boundary, chip.weights, counts)
        return counts, {"weights": chip.weights, "traces": traces}, film

    def thresholds(self) -> Thresholds:
        """The thresholds that the host keeps; a neuron at the highest one gets next to no weights."""
        return Thresholds(self._state.theta, self._start, THRESHOLD_LIMIT - 1)

    def state(self) -> dict[str, NDArray[np.uint8] | NDArray[np.int32]]:
        """The host's ``weights`` and ``theta``, not copied."""
        return {"weights": self._state.weights, "theta": self._state.theta}
