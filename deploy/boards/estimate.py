"""A modelled figure: low, nominal and high."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

Level = Literal["low", "nominal", "high"]
LEVELS: tuple[Level, ...] = ("low", "nominal", "high")


@dataclass(frozen=True)
class Estimate:
    """What a model says at its cheapest, its best guess, and at its dearest; in the unit that its holder names."""

    low: float
    nominal: float
    high: float

    @classmethod
    def of(cls, value: Callable[[Level], float]) -> Estimate:
        """The estimate whose figure at each level is ``value`` of that level."""
        return cls(*(value(level) for level in LEVELS))

    def __add__(self, other: Estimate) -> Estimate:
        return Estimate(self.low + other.low, self.nominal + other.nominal, self.high + other.high)

    def __mul__(self, factor: float) -> Estimate:
        return Estimate(self.low * factor, self.nominal * factor, self.high * factor)

    def at(self, level: Level) -> float:
        """The estimate's figure at ``level``: low, nominal or high."""
        return float(getattr(self, level))

    def as_json(self) -> dict[str, float]:
        """The estimate as scripts read it."""
        return {"low": self.low, "nominal": self.nominal, "high": self.high}


def total(parts: Iterable[Estimate]) -> Estimate:
    """The sum of ``parts``; of none: 0."""
    return sum(parts, Estimate(0.0, 0.0, 0.0))
