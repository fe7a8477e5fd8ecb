"""The spiking front end in the general simulator: every neuron in every step.

Used by deploy, engine, inputs and report.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.general.simulation import INPUTS, GeneralNetwork, Population, Synapses, simulate
from lava_vpr.engine.inference.biases import bias_registers
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_network import BIAS_EXPONENT, event_synapses, populations, synapses


def network(spec: FrontEnd, grey: NDArray[np.uint8], bias: NDArray[np.int32] | None = None) -> GeneralNetwork:
    """The network that is shown what `FrontEnd.seen` made (n, rows, columns), one after the other; with biases of the
    neurons of places in each presentation, (n, neurons), if they have any."""
    found, places = populations(spec), list(spec.populations)
    pixels = grey.reshape(len(grey), -1).astype(np.int64), np.full((len(grey), 1), BIAS_EXPONENT)
    shown: dict[str, tuple[Any, Any]] = {} if spec.window else {"pixels": pixels}
    if bias is not None:
        mantissas, exponents = bias_registers(bias)
        shown["exc"] = mantissas, exponents[:, None]
    rows = (
        Population(
            np.full(one.size, one.threshold),
            *shown.get(name, (0 if one.bias is None else one.bias, one.bias_exp)),
            LifParameters(one.du, one.dv),
            spec.steps,
        )
        for name, one in found.items()
    )
    between = (
        Synapses(
            places.index(one.source),
            places.index(one.target),
            one.weights.T.toarray(),
            exponent=one.exponent,
            sign="excitatory" if one.weights.data[0] > 0 else "inhibitory",
        )
        for one in synapses(spec)
    )
    if not spec.window:
        return GeneralNetwork(1, tuple(rows), tuple(between))
    arriving = Synapses(INPUTS, places.index("pixels"), event_synapses(spec).T.toarray())
    return GeneralNetwork(math.prod(spec.shape), tuple(rows), (arriving, *between))


def trains(
    spec: FrontEnd, grey: NDArray[np.uint8], bias: NDArray[np.int32] | None = None
) -> dict[str, NDArray[np.uint8]]:
    """Every spike of each population, uint8 (n, steps, neurons), by name."""
    axons = spec.events(grey) if spec.window else np.zeros((len(grey), spec.steps, 1), bool)
    films = simulate(network(spec, grey, bias), axons.reshape(len(grey) * spec.steps, -1)).spikes
    shape = len(grey), spec.steps, -1
    return {name: film.reshape(shape).astype(np.uint8) for name, film in zip(spec.populations, films, strict=True)}
