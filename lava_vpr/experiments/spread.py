"""How a figure scatters over seeds, or over the sections of a route."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple


class Spread(NamedTuple):
    """A figure over repetitions: seeds, or sections.

    Attributes:
        mean: Of all repetitions.
        deviation: The sample standard deviation; None of one repetition.
        by_seed: The figure by the number of the repetition, in order.
    """

    mean: float
    deviation: float | None
    by_seed: Mapping[int, float]

    @classmethod
    def of(cls, by_seed: Mapping[int, float]) -> Spread:
        """That of figures by seed, at least one; sums are exact, so that every Python rounds them alike."""
        mean = mean_of(by_seed.values())
        if len(by_seed) == 1:
            return cls(mean, None, by_seed)
        squares = math.fsum((value - mean) ** 2 for value in by_seed.values())
        return cls(mean, math.sqrt(squares / (len(by_seed) - 1)), by_seed)

    @classmethod
    def over(cls, figures: Iterable[tuple[int, float]]) -> Spread:
        """That of figures, each with its seed; several of one seed count as their mean."""
        by_seed: dict[int, list[float]] = {}
        for seed, value in figures:
            by_seed.setdefault(seed, []).append(float(value))
        return cls.of({seed: mean_of(values) for seed, values in by_seed.items()})


def mean_of(values: Iterable[float]) -> float:
    """The mean of at least one value, the same in any order."""
    some = list(values)
    return math.fsum(some) / len(some)
