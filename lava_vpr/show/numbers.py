"""Number formats of all tables and pages; what cannot be computed is a dash."""

from __future__ import annotations

import math
from typing import Any, Protocol, TypeGuard

NONE = "-"
"""A figure of a table that cannot be computed."""

UNKNOWN = "unknown"
"""A figure that nobody has published."""


class Levels(Protocol):
    """An estimate with its bounds, such as `Estimate` and `Constant`."""

    @property
    def low(self) -> float: ...

    @property
    def nominal(self) -> float: ...

    @property
    def high(self) -> float: ...


def is_number(value: Any) -> TypeGuard[float]:
    """Whether ``value`` is a figure: not None, NaN or infinite, which stand for "cannot be computed"."""
    return value is not None and math.isfinite(value)


def figure(value: float | None, digits: int = 3) -> str:
    """A number with ``digits`` significant digits, thousands separated; a dash for none."""
    if not is_number(value):
        return NONE
    if value == 0:
        return "0"
    rounded = float(f"{value:.{digits - 1}e}")
    places = digits - 1 - math.floor(math.log10(abs(rounded)))
    if abs(rounded) < 1e-4:
        return f"{value:.{digits - 1}e}"
    return f"{rounded:,.{max(0, places)}f}"


def count(value: float | None) -> str:
    """A mean count: whole numbers as such, others with four digits."""
    if is_number(value) and float(value).is_integer():
        return f"{int(value):,}"
    return figure(value, 4)


def percent(value: float | None) -> str:
    """A fraction in percent with one decimal; a dash for none."""
    return f"{100 * value:.1f}" if is_number(value) else NONE


def fraction(value: float | None, digits: int) -> str:
    """A fraction on a page, with ``digits`` decimals; a long dash for none."""
    return f"{value:.{digits}f}" if is_number(value) else "–"


def levels(value: Levels | None) -> tuple[str, str, str]:
    """Cells for low, nominal and high; three dashes for none."""
    return (NONE, NONE, NONE) if value is None else (figure(value.low), figure(value.nominal), figure(value.high))


def ranged(value: Levels | None, unit: str = "") -> str:
    """An estimate in one cell: nominal with its unit, then low to high in brackets where they differ."""
    low, nominal, high = levels(value)
    nominal += f" {unit}" if unit else ""
    return nominal if low == high else f"{nominal} ({low} to {high})"


def size(count: int | None) -> str:
    """Bytes in GB, MB or kB."""
    if count is None:
        return NONE
    for unit, scale in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= scale:
            return f"{figure(count / scale)} {unit}"
    return f"{count} B"


def counted(count: int, noun: str) -> str:
    """``count`` with its noun, in the plural if need be."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def agreeing(count: int, one: str, more: str) -> str:
    """The words that follow ``count``: ``one`` after 1, else ``more``."""
    return one if count == 1 else more


def named(name: str) -> str:
    """A key as words."""
    return name.replace("_", " ")
