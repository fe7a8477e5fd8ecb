"""Figures over repetitions, the seeds or the sections of a route: what tasks measured, put together row by row."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

Figures = Mapping[str, Mapping[str, float]]
"""Figures by name, in groups: of the network, of a baseline, modelled costs."""


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

    def as_json(self) -> dict[str, Any]:
        """It as plain JSON values."""
        return self._asdict() | {"by_seed": {str(seed): value for seed, value in self.by_seed.items()}}


def mean_of(values: Iterable[float]) -> float:
    """The mean of at least one value, the same in any order."""
    some = list(values)
    return math.fsum(some) / len(some)


class Outcome(NamedTuple):
    """What a task measured of one row.

    Attributes:
        label: The row, as tables call it.
        value: Its place on an axis; None: it has none.
        seed: The number of the repetition.
        figures: The figures; a repetition need not have those of the others.
    """

    label: str
    value: float | None
    seed: int
    figures: Figures


@dataclass(frozen=True)
class Row:
    """A row over all repetitions.

    Attributes:
        label, value: As in `Outcome`.
        figures: The figures that any repetition has, in groups.
    """

    label: str
    value: float | None
    figures: Mapping[str, Mapping[str, Spread]]

    def mean(self, group: str, name: str) -> float | None:
        """The mean of a figure; None if no repetition has it."""
        found = self.figures.get(group, {}).get(name)
        return None if found is None else found.mean


def rows(outcomes: Iterable[Outcome]) -> tuple[Row, ...]:
    """Outcomes by label, in the order of their first; of one label and seed the mean is taken."""
    by_label: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        by_label.setdefault(outcome.label, []).append(outcome)
    return tuple(Row(label, some[0].value, _spreads(some)) for label, some in by_label.items())


def _spreads(some: list[Outcome]) -> dict[str, dict[str, Spread]]:
    """Every figure of the outcomes of a row over their seeds."""
    seen: dict[str, dict[str, list[tuple[int, float]]]] = {}
    for one in some:
        for group, figures in one.figures.items():
            for name, value in figures.items():
                seen.setdefault(group, {}).setdefault(name, []).append((one.seed, value))
    return {group: {name: Spread.over(values) for name, values in figures.items()} for group, figures in seen.items()}
