"""Probability: how likely it is that a single query shows the place that matches it best, from its margin alone.

The margin is the best score less the second. How it is distributed is measured on the references, without any query
(`lava_vpr.training.measuring`): of references that were altered, right and wrong; and of references whose places were
left out of the map, which is what an image off the map looks like. A logistic curve through both, each with half of the
weight, is the probability **if half of the queries are off the map** (`HALF`). A curve through references that were
varied, in more ways and by more and less, is the probability if none is. The two say how many times as likely a margin
is on the map as off it, and so any other share P, the prior, enters by Bayes' rule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError
from lava_vpr.matching.decoders import margin
from lava_vpr.matching.equations import Scores

RIGHT, WRONG, OFF_MAP, VARIED_RIGHT, VARIED_WRONG = KINDS = (1.0, 0.0, -1.0, 3.0, 2.0)
"""What a sample of a calibration was: an altered reference matched by its place or by another, one off the map, or a
varied one matched by its place or by another."""
PRECISION = 0.95
"""The share of accepted matches that shall be right, unless another is asked for."""
ASSUMED = (
    "Probabilities assume the camera and viewpoint of the references, and the share off the map that was given: where "
    "these differ, more of the accepted may be wrong."
)
"""What the calibration knows nothing of, and takes for granted."""
UNREACHED = (
    "No probability is high enough for the precision that is aimed at. If all images were taken along the route, say "
    "so with --off-map 0; otherwise give query a lower --target-precision."
)
"""Why a calibration accepts no match at all, and the remedies."""
HALF = 0.5
"""The share of the queries that is taken to be off the map, unless another is said."""
_ROUNDS, _RIDGE, _LEAST = 50, 1e-3, 1e-12


class Fit(NamedTuple):
    """The logistic curve ``1 / (1 + exp(-(offset + slope margin)))``."""

    offset: float
    slope: float

    def at(self, margins: NDArray[np.float64]) -> NDArray[np.float64]:
        """Its values at ``margins``."""
        return _logistic(self.offset + self.slope * margins)


class Kept(NamedTuple):
    """What a threshold keeps of the samples of a calibration.

    Attributes:
        probability: The least probability that is accepted.
        precision: Share of what is accepted that is right, by the curve.
        kept: Share of the samples on the map that are accepted.
        false_accepts: Share of the samples off the map that are accepted.
    """

    probability: float
    precision: float
    kept: float
    false_accepts: float


@dataclass(frozen=True, eq=False)
class Calibration:
    """Margins of references, and what became of them.

    Attributes:
        samples: float32 (k, 2): the margin of each, and which of `KINDS` it was; some on the map and some off it. Of
            vectors, and in older files, none is varied: the altered ones stand for them.
    """

    samples: NDArray[np.float32] = field(repr=False)

    def _weighed(self, off_map: float) -> tuple[NDArray[np.float64], NDArray[np.float32], NDArray[np.float64]]:
        """Margins, kinds and weights of the samples that count. Those off the map have ``off_map`` of the weight, those
        on it the rest: from `HALF` on the altered ones, and the less is off the map, the more of it the varied ones."""
        kinds = self.samples[:, 1]
        off, varied = kinds == OFF_MAP, kinds >= VARIED_WRONG
        share = max(0.0, 1.0 - off_map / HALF) if varied.any() else 0.0
        weights = np.zeros(len(kinds))
        for those, weight in (
            (off, off_map),
            (varied, (1 - off_map) * share),
            (~off & ~varied, (1 - off_map) * (1 - share)),
        ):
            weights[those] = weight / max(1, int(those.sum()))
        used = off | (weights > 0)
        return self.samples[used, 0].astype(np.float64), kinds[used], weights[used]

    @cached_property
    def curve(self) -> Fit:
        """The curve of being right where half of the queries are off the map."""
        return self._fitted(HALF)

    @cached_property
    def on_map(self) -> Fit:
        """The curve of being right where all queries are on the map."""
        return self._fitted(0.0)

    def _fitted(self, off_map: float) -> Fit:
        """The logistic curve that fits the samples best (Newton's method; a little ridge keeps the slope finite)."""
        margins, kinds, weights = self._weighed(off_map)
        right = np.isin(kinds, (RIGHT, VARIED_RIGHT))
        centre, spread = float(margins.mean()), float(margins.std()) or 1.0
        terms = np.stack([np.ones(len(margins)), (margins - centre) / spread])
        ridge, at = np.diag([0.0, 2 * _RIDGE]), np.zeros(2)
        for _ in range(_ROUNDS):
            chance = _logistic(at @ terms)
            slope = terms @ (weights * (chance - right)) + ridge @ at
            bend = (terms * (weights * np.maximum(chance * (1 - chance), 1e-9))) @ terms.T + ridge
            step = np.linalg.solve(bend, slope)
            step /= max(1.0, float(np.abs(step).max()))  # never further than one unit at a time
            at = at - step
            if float(np.abs(step).max()) < 1e-10:
                break
        slope_ = max(0.0, float(at[1]) / spread)  # a surer match is never less probable
        return Fit(float(at[0]) - slope_ * centre, slope_)

    def _ratios(self, margins: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """How many times as likely as off the map a query on it has each of these margins, with the right place as its
        best, and with a wrong one."""
        half = np.maximum(self.curve.at(margins), _LEAST)
        right = np.maximum(self.on_map.at(margins), half)
        on_map = half / (right - half + _LEAST)  # half = right P(on the map | margin)
        return right * on_map, (1.0 - right) * on_map

    def probabilities(self, scores: Scores, off_map: float = HALF) -> NDArray[np.float64]:
        """How likely the best place of each query is the right one, float64 (n,); 0 where none matches.

        Args:
            scores: Scores of single queries (n, places) by the decoder that was calibrated.
            off_map: The share of the queries that is taken to be off the map, at least 0 and below 1.
        """
        return np.where(scores.any(axis=1), self._chances(margin(scores), off_map), 0.0)

    def _chances(self, margins: NDArray[np.float64], off_map: float) -> NDArray[np.float64]:
        """The probabilities of margins."""
        right, wrong = self._ratios(margins)
        chance: NDArray[np.float64] = right / (right + wrong + off_map / (1.0 - off_map))
        return np.round(chance, 9)

    def keeping(self, precision: float, off_map: float = HALF) -> Kept:
        """The least probability with which, by the curve, so many of the accepted samples are right.

        The samples themselves are not counted: one pair of places that look the same would decide about 0.99.

        Args:
            precision: Share of the accepted that shall be right, above 0 and below 1.
            off_map: As in `probabilities`.
        Returns:
            A threshold above 1, which keeps nothing, where no threshold is as precise.
        Raises:
            ConfigError: the precision is out of its range.
        """
        check_precision(precision)
        margins, kinds, weights = self._weighed(off_map)
        chance, off = self._chances(margins, off_map), kinds == OFF_MAP
        order = np.argsort(-chance, kind="stable")
        accepted, hits = np.cumsum(weights[order]), np.cumsum((weights * chance)[order])
        last = np.append(np.diff(chance[order]) != 0, True)  # equal ones are accepted together
        good = np.flatnonzero(last & (hits >= precision * accepted))
        if len(good) == 0:
            return Kept(math.inf, math.nan, 0.0, 0.0)
        least, reached = float(chance[order][good[-1]]), float(hits[good[-1]] / accepted[good[-1]])
        kept, false_accepts = (float((chance[those] >= least).mean()) if those.any() else 0.0 for those in (~off, off))
        return Kept(least, reached, kept, false_accepts)


def check_precision(precision: float) -> None:
    """Refuse a precision that is not above 0 and below 1.

    Raises:
        ConfigError: it is not.
    """
    if not 0 < precision < 1:
        raise ConfigError(f"a precision of {precision:g} cannot be aimed at; give one above 0 and below 1")


def check_off_map(share: float) -> None:
    """Refuse what can be no share of the queries that are off the map: below 0, or all of them.

    Raises:
        ConfigError: it is one.
    """
    if not 0 <= share < 1:
        raise ConfigError(f"{share:g} is no share of the images that are off the map; give one of at least 0, below 1")


def _logistic(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """``1 / (1 + exp(-x))``, rounded to 9 digits, so that it is the same number on every machine."""
    return np.round(1.0 / (1.0 + np.exp(-np.clip(x, -30.0, 30.0))), 9)


class Bin(NamedTuple):
    """Answers of like probability: how many, how probable on average, and how many of them were right."""

    answers: int
    probability: float
    right: float


def reliability(
    probability: NDArray[np.float64], right: NDArray[np.bool_], bins: int = 10
) -> tuple[tuple[Bin, ...], float]:
    """Bins of equal width that are not empty, and the expected calibration error (Naeini et al., AAAI 2015).

    Args:
        probability: Of each answer, float64 (n,), in [0, 1].
        right: Whether the answer was right, bool (n,).
        bins: Number of bins.
    Returns:
        The bins by rising probability; and the error: how far probability and share of the right are apart, weighted by
        the number of answers; NaN without answers.
    """
    number = np.clip((probability * bins).astype(np.int64), 0, bins - 1)
    found = []
    for chosen in (number == k for k in range(bins)):
        if chosen.any():
            answers = int(chosen.sum())
            found.append(Bin(answers, math.fsum(probability[chosen]) / answers, int(right[chosen].sum()) / answers))
    if not found:
        return (), math.nan
    # Exact sums: ``sum`` rounds otherwise since Python 3.12, and the order of numpy's sums is its own.
    error = math.fsum(bin_.answers * abs(bin_.probability - bin_.right) for bin_ in found) / len(probability)
    return tuple(found), error
