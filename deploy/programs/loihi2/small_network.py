"""The small network of a rung in the files and arrays that the worker takes, in the bundle's own formats."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np

from input_draws import draw_spikes
from lava_network import Arrays
from rungs import Rung

ALWAYS = 65535  # of 65536: an input that integrates this bias spikes in every step


def array_bytes(array: Any) -> bytes:
    """The content of a ``.npy`` file."""
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def small_network(files: dict[str, bytes], rung: Rung) -> tuple[dict[str, bytes], Arrays]:
    """Files of the network, and the rates and keys of its presentations."""
    parameters = json.loads(files["network/parameters.json"])
    exponent = parameters["excite"]["weight_exp"]
    stored = np.array(rung.weights, np.int64).T * 2.0**-exponent
    parameters.update(leaves=0, relayed=0)
    parameters["exc"].update(vth=rung.threshold, dv=rung.decay, bias_exp=0)
    if not rung.lateral:
        parameters["inhibit"]["weight"] = 0
    own = {
        "network/parameters.json": json.dumps(parameters).encode(),
        "network/weights.npy": array_bytes(stored.astype(np.int16)),
        "network/bias.npy": array_bytes(np.zeros(len(stored), np.int32)),
    }
    rates = np.where(rung.active, ALWAYS, 0).astype(np.uint16)
    key = 0
    while not draw_spikes(rates, key, parameters["steps"])[:, rung.active].all():  # one draw of 65536 is not below
        key += 1
    n = rung.presentations
    return {**files, **own}, {"rates": np.tile(rates, (n, 1)), "keys": np.full(n, key, np.uint64)}
