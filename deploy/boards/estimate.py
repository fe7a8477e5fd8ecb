"""A modelled figure: low, nominal and high."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """What a model says at its cheapest, its best guess, and at its dearest; in the unit that its holder names."""

    low: float
    nominal: float
    high: float

    def __add__(self, other: Estimate) -> Estimate:
        return Estimate(self.low + other.low, self.nominal + other.nominal, self.high + other.high)

    def __mul__(self, factor: float) -> Estimate:
        return Estimate(self.low * factor, self.nominal * factor, self.high * factor)

    def as_json(self) -> dict[str, float]:
        """As scripts read it."""
        return {"low": self.low, "nominal": self.nominal, "high": self.high}


def total(parts: Iterable[Estimate]) -> Estimate:
    """Sum of ``parts``; of none: 0."""
    return sum(parts, Estimate(0.0, 0.0, 0.0))
