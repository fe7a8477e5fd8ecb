"""A NIR graph of one population, simulated node by node from NIR's equations.

Used by exchange.
"""

from __future__ import annotations

import nir
import numpy as np
from numpy.typing import NDArray


def spikes_of(graph: nir.NIRGraph, trains: NDArray[np.uint8], *, truncates: bool) -> NDArray[np.uint8]:
    """Every spike of the population, by forward Euler with the graph's own time step.

    Args:
        graph: Input -> Affine -> LIF -> Output, the LIF with a recurrent Linear; ``time_step``, ``input_delay`` and
            ``interval`` in its metadata.
        trains: Input spikes, (presentations, steps, inputs); steps beyond these are silent.
        truncates: Whether the decayed membrane is cut towards 0 to a whole number, as the graph's metadata say.
    Returns:
        (presentations, interval, population).
    """
    synapses, lif, back = (graph.nodes[name] for name in ("synapses", "population.lif", "population.w_rec"))
    kept = graph.metadata
    delay, interval = int(kept["input_delay"]), int(kept["interval"])
    keep = 1 - float(kept["time_step"]) / lif.tau
    gain = lif.r * float(kept["time_step"]) / lif.tau
    membrane = np.zeros((len(trains), len(lif.tau)))
    spikes = np.zeros((len(trains), interval, len(lif.tau)), np.uint8)
    for step in range(interval):
        shown = 0 <= step - delay < trains.shape[1]
        given = trains[:, step - delay] if shown else np.zeros_like(trains[:, 0])
        last = spikes[:, step - 1] if step else spikes[:, 0]
        current = given @ synapses.weight.T.astype(np.float64) + synapses.bias + last @ back.weight.T.astype(np.float64)
        decayed = membrane * keep
        # A quotient of seconds is off by some 1e-16 of the value; a whole number of registers is not.
        membrane = (np.trunc(np.round(decayed, 6)) if truncates else decayed) + gain * current
        fired = membrane > lif.v_threshold
        membrane[fired] = np.broadcast_to(lif.v_reset, membrane.shape)[fired]
        spikes[:, step] = fired
    return spikes
