"""Ranges of settings: a value outside its range is refused, with its name and the range."""

from __future__ import annotations

import dataclasses
import math
import numbers
from typing import Any

from lava_vpr.errors import ConfigError, brief

CHANGE_IT = "change it in the options or the --config file"
"""The remedy for a setting that cannot be."""


def need(condition: bool, name: str, value: object, limit: str) -> None:
    """Refuse a setting outside its range, naming it, its value and its range (NaN fails every comparison).

    Raises:
        ConfigError: the condition does not hold.
    """
    if not condition:
        raise ConfigError(f"{name} is {brief(value)}, but must be {limit}; {CHANGE_IT}")


def whole(value: object) -> bool:
    """Whether ``value`` is a whole number, which a truth value is not."""
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)


def real(value: object) -> bool:
    """Whether ``value`` is a finite number."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool) and (whole(value) or math.isfinite(value))


def within(part: Any, section: str, **ranges: str) -> None:
    """Refuse settings outside their ranges, written ``[least, most]`` or, without the end itself, ``(least, most)``.

    A setting that is annotated as an ``int`` must be a whole number, any other a finite one.

    Raises:
        ConfigError: naming the first attribute of ``part``, a dataclass, that lies outside its range.
    """
    types = {field.name: field.type for field in dataclasses.fields(part)}
    for name, limits in ranges.items():
        value = getattr(part, name)
        kind = "a whole number " if types[name] in ("int", int) else "a number "
        fits = whole(value) if kind == "a whole number " else real(value)
        if fits:
            kind = ""
            low, high = (float(end) for end in limits[1:-1].split(","))
            above = value > low if limits[0] == "(" else value >= low
            below = value < high if limits[-1] == ")" else value <= high
            fits = above and below
        need(fits, f"{section}.{name}", value, f"{kind}in {limits}")
