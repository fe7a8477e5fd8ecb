"""How far the probabilities of answers can be trusted, once it is known which answers were right."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.matching.answers import Answers, Together, accepted, least_probability
from lava_vpr.matching.probability import HALF, Bin, reliability

TARGETS = (0.9, 0.95, 0.98, 0.99)
"""The precisions whose thresholds tables show."""


class Threshold(NamedTuple):
    """What a target precision gave.

    Attributes:
        target: The precision that was aimed at.
        probability: The least probability that is accepted.
        accepted: Accepted, as a share of all queries.
        precision: Share of the accepted that were right; NaN where none was accepted.
        kept: Accepted and right, as a share of the queries on the map; NaN without such.
        false_accepts: Accepted, as a share of the queries off the map; NaN without such.
    """

    target: float
    probability: float
    accepted: float
    precision: float
    kept: float
    false_accepts: float


@dataclass(frozen=True)
class Trust:
    """What became of answers with probabilities.

    Attributes:
        error: The expected calibration error.
        bins: Answers of like probability.
        thresholds: A row for each of `TARGETS`.
        off_map: Share of the queries that are off the map.
        prior: The share that was taken to be.
    """

    error: float
    bins: tuple[Bin, ...]
    thresholds: tuple[Threshold, ...]
    off_map: float
    prior: float = HALF

    @property
    def taken(self) -> str:
        """The share that was taken to be off the map, in words."""
        return "half" if self.prior == HALF else f"{100 * self.prior:g} %"

    def as_json(self) -> dict[str, Any]:
        """Plain JSON values; NaN and infinity become None."""
        return {
            "expected_calibration_error": _plain(self.error),
            "off_map": _plain(self.off_map),
            "reliability": [{name: _plain(value) for name, value in bin_._asdict().items()} for bin_ in self.bins],
            "thresholds": [{name: _plain(value) for name, value in row._asdict().items()} for row in self.thresholds],
        }


def trust(answers: Answers, truth: NDArray[np.bool_], together: Together) -> Trust | None:
    """How far the probabilities of ``answers`` can be trusted; None where there are none.

    Args:
        answers: Answers of n queries.
        truth: bool (n, places); a row without a place is a query off the map.
        together: How the queries were matched.
    """
    if len(answers.matches) == 0 or np.isnan(answers.probability).any():
        return None
    on_map = truth.any(axis=1)
    right = is_right(answers.matches, truth, together.radius)
    bins, error = reliability(answers.probability, right)
    rows = []
    for target in TARGETS:
        least = least_probability(together, target)
        good = accepted(answers, least)
        rows.append(
            Threshold(
                target,
                least,
                float(good.mean()),
                _share(right & good, good),
                _share(right & good & on_map, on_map),
                _share(good & ~on_map, ~on_map),
            )
        )
    return Trust(error, bins, tuple(rows), float((~on_map).mean()), together.off_map)


def is_right(matches: NDArray[np.int64], truth: NDArray[np.bool_], radius: int) -> NDArray[np.bool_]:
    """Whether a true place is within ``radius`` places of each match, bool (n,); a match of -1 is never right."""
    right = np.zeros(len(matches), np.bool_)
    for number, match in enumerate(matches):
        right[number] = match >= 0 and truth[number, max(0, match - radius) : match + radius + 1].any()
    return right


def _share(some: NDArray[np.bool_], of: NDArray[np.bool_]) -> float:
    return float(some.sum() / of.sum()) if of.any() else math.nan


def _plain(value: float) -> float | int | None:
    return value if math.isfinite(value) else None
