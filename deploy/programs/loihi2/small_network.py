"""The small network of a rung in the parameters and arrays that the worker takes."""

from __future__ import annotations

from typing import Any

import numpy as np

from input_draws import draw_spikes
from lava_network import Arrays
from rungs import Rung

LEVEL, KEEPS_NOTHING = 8000 << 6, 4095  # threshold of inputs that integrate a bias, in units of v; their du
FEW = ("one neuron", "one axon", "reset")
"""Rungs that are climbed in both input modes."""
ALWAYS = 65535  # of 65536: an input that integrates this bias spikes in every step


def in_mode(parameters: dict[str, Any], bias: bool) -> dict[str, Any]:
    """The network of ``parameters`` with inputs that integrate a bias, or whose spikes are injected; these are the same
    where they are regular."""
    inputs = {"du": KEEPS_NOTHING, "dv": 0, "vth": LEVEL >> 6} if bias else None
    return parameters | {"inputs": inputs, "level": LEVEL}


def small_network(parameters: dict[str, Any], rung: Rung) -> tuple[dict[str, Any], Arrays]:
    """Parameters of the network, from those of the bundle; weights, bias, and rates and keys of its presentations."""
    stored = np.array(rung.weights, np.int64).T * 2.0 ** -parameters["excite"]["weight_exp"]
    changes: dict[str, Any] = {"leaves": 0, "relayed": 0}
    changes["exc"] = parameters["exc"] | {"vth": rung.threshold, "dv": rung.decay, "bias_exp": 0}
    if not rung.lateral:
        changes["inhibit"] = parameters["inhibit"] | {"weight": 0}
    rates = np.where(rung.active, ALWAYS, 0).astype(np.uint16)
    key = 0
    while not draw_spikes(rates, key, parameters["steps"])[:, rung.active].all():  # one draw of 65536 is not below
        key += 1
    n = rung.presentations
    return parameters | changes, {
        "weights": stored.astype(np.int16),
        "bias": np.zeros(len(stored), np.int32),
        "rates": np.tile(rates, (n, 1)),
        "keys": np.full(n, key, np.uint64),
    }
