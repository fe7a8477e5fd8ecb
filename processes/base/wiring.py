"""The wiring that every place network has in common, whatever its parts are."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import need
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.quantise import mantissa_of
from lava_vpr.loihi import WEIGHT_EXPONENT_LIMIT, WEIGHT_LIMIT

RELAY_WEIGHT = 2
"""Weight of the synapses to inhibitory neurons and relays: any positive one makes them spike, an even one with any sign
mode."""


def listening(network: FixedNetwork) -> NDArray[np.int32]:
    """Weights (inhibitory, neurons) from exc to the inhibitory neurons that listen to it: the leaves, or the root."""
    weights = np.full((1, network.neurons), RELAY_WEIGHT, np.int32)
    if network.leaves:
        weights = np.zeros((network.inhibitory, network.neurons), np.int32)
        weights[np.arange(network.neurons) // fixed.FAN_IN, np.arange(network.neurons)] = RELAY_WEIGHT
    return weights


def gathering(network: FixedNetwork) -> NDArray[np.int32]:
    """Weights (inhibitory, inhibitory) from the leaves to the root, the last of them."""
    weights = np.zeros((network.inhibitory, network.inhibitory), np.int32)
    weights[-1, :-1] = RELAY_WEIGHT
    return weights


def inhibiting(network: FixedNetwork) -> NDArray[np.int32]:
    """Mantissas (neurons, inhibitory) of what the root takes from each neuron, 0 or below."""
    weights = np.zeros((network.neurons, network.inhibitory), np.int32)
    weights[:, -1] = -network.inhibition
    return weights


def exact_mantissa(inhibition: int) -> tuple[int, int]:
    """``inhibition`` as mantissa 2^exponent of the synapses that take it.

    Raises:
        NetworkLimitError: it takes more than 8 bits, or an exponent beyond 7.
    """
    mantissa, exponent = mantissa_of(inhibition, WEIGHT_LIMIT)
    fits = exponent <= WEIGHT_EXPONENT_LIMIT and mantissa << exponent == inhibition
    need(fits, "inhibition", inhibition, f"m 2^e with m in 0..{WEIGHT_LIMIT} and e in 0..{WEIGHT_EXPONENT_LIMIT}")
    return mantissa, exponent


_ARROWS = (
    ("exc", "listen", "inh"),
    ("inh", "gather", "inh"),
    ("inh", "inhibit", "exc"),
    ("exc", "echo", "own"),
    ("own", "give_back", "exc"),
)
"""Populations, and the synapses by which one reaches another; each takes one step."""

_VARS = (
    ("weights", "excite", "weights"),
    ("u", "exc", "u"),
    ("v", "exc", "v"),
    ("vth", "exc", "vth"),
    ("v_inh", "inh", "v"),
    ("lateral_weights", "inhibit", "weights"),
)
"""Vars of a network, and the parts and their Vars that these are."""


def wire(proc: Any, parts: Any) -> None:
    """Connect the parts of a place network, and let the network's ports and Vars be theirs.

    Args:
        proc: The network, with the ports ``s_in``, ``s_out``, ``s_out_inh`` and the Vars ``weights``, ``u``, ``v``,
            ``vth``, ``v_inh`` and ``lateral_weights``, which become those of its parts.
        parts: What holds them: the populations ``exc`` and ``inh``, the synapses ``excite`` (inputs to exc), ``listen``
            (exc to inh) and ``inhibit`` (inh to exc); and where there are any ``gather`` (inh to inh), ``relays`` of
            the inputs with their synapses ``forward``, or one relay for each neuron, ``own``, with the synapses
            ``echo`` (exc to own) and ``give_back`` (own to exc).
    """
    entrance = parts.excite
    if hasattr(parts, "relays"):
        entrance = parts.forward
        parts.forward.a_out.connect(parts.relays.a_in)
        parts.relays.s_out.connect(parts.excite.s_in)
    proc.s_in.connect(entrance.s_in)
    parts.excite.a_out.connect(parts.exc.a_in)
    for source, synapses, target in _ARROWS:
        if hasattr(parts, synapses):
            getattr(parts, source).s_out.connect(getattr(parts, synapses).s_in)
            getattr(parts, synapses).a_out.connect(getattr(parts, target).a_in)
    parts.exc.s_out.connect(proc.s_out)
    parts.inh.s_out.connect(proc.s_out_inh)
    for name, part, var in _VARS:
        getattr(proc.vars, name).alias(getattr(getattr(parts, part), var))
