"""Words and numbers of the report, as a person writes them, safe to put in a page."""

from __future__ import annotations

import math
from typing import Any, TypeGuard

from lava_vpr.matching.decoders import DECODERS
from lava_vpr.matching.matchers import MATCHERS

_EVENTS = {
    "synaptic_operations": "synaptic operations",
    "neuron_updates": "neuron updates",
    "input_spikes": "input spikes",
    "exc_spikes": "excitatory spikes",
    "inh_spikes": "inhibitory spikes",
}


def label(name: str) -> str:
    """What a matcher or a counted event is called in the report."""
    for matchers in (DECODERS, MATCHERS):
        if name in matchers:
            return str(matchers[name].title)
    return _EVENTS.get(name, name.replace("_", " "))


def is_number(value: Any) -> TypeGuard[float]:
    """Whether ``value`` is a figure and not None or NaN, which stand for "cannot be computed"."""
    return value is not None and math.isfinite(value)


def fraction(value: float | None, digits: int) -> str:
    """A fraction with ``digits`` decimals, a dash if it cannot be computed."""
    return f"{value:.{digits}f}" if is_number(value) else "–"


def number(value: float) -> str:
    """A count with thousands separated; three significant digits below 100 if it is no whole number."""
    if not is_number(value):
        return "–"
    if float(value).is_integer():
        return f"{int(value):,}"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def counted(count: int, noun: str) -> str:
    """``count`` with its noun, in the plural if need be."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
