"""Words and numbers of the report."""

from __future__ import annotations

from lava_vpr.matching.decoders import DECODERS, MATCHERS
from lava_vpr.show.numbers import is_number, named

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
    return _EVENTS.get(name, named(name))


def number(value: float) -> str:
    """A count with thousands separated; three significant digits below 100 if it is no whole number."""
    if not is_number(value):
        return "–"
    if float(value).is_integer():
        return f"{int(value):,}"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
