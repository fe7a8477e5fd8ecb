"""A NIR graph of one population, simulated step by step from NIR's equations, in the arithmetic that is asked for."""

from __future__ import annotations

import nir
import numpy as np
from numpy.typing import NDArray


def spikes_of(graph: nir.NIRGraph, trains: NDArray[np.uint8], *, single: bool, truncates: bool) -> NDArray[np.uint8]:
    """Every spike of the population, by forward Euler with the graph's own time step.

    Args:
        graph: Input -> Affine -> LIF -> Output, the LIF with a recurrent Linear; ``time_step``, ``input_delay`` and
            ``interval`` in its metadata.
        trains: Input spikes, (presentations, steps, inputs); steps beyond these are silent.
        single: Whether membranes are of single precision, rounded after the leak and after the sum, as torch's are;
            else of double.
        truncates: Whether the decayed membrane is cut towards 0 to a whole number, as the graph's metadata say.
    Returns:
        uint8 (presentations, interval, population).
    """
    synapses, lif, back = (graph.nodes[name] for name in ("synapses", "population.lif", "population.w_rec"))
    kept, kind = graph.metadata, np.float32 if single else np.float64
    delay, interval, step_s = int(kept["input_delay"]), int(kept["interval"]), float(kept["time_step"])
    keep = (1 - step_s / lif.tau).astype(kind)
    gain = lif.r * step_s / lif.tau
    weights, recurrent = (node.weight.T.astype(np.float64) for node in (synapses, back))
    membrane = np.zeros((len(trains), len(lif.tau)), kind)
    spikes = np.zeros((len(trains), interval, len(lif.tau)), np.uint8)
    for step in range(interval):
        current = np.tile(synapses.bias.astype(np.float64), (len(trains), 1))
        if 0 <= step - delay < trains.shape[1]:
            current += trains[:, step - delay].astype(np.float64) @ weights
        if step:
            current += spikes[:, step - 1].astype(np.float64) @ recurrent
        decayed = membrane * keep
        # A quotient of seconds is off by 1e-16 of it; what is truncated has 12 bits behind the point.
        membrane = (np.trunc(np.round(decayed, 6)) if truncates else decayed) + (gain * current).astype(kind)
        fired = membrane > lif.v_threshold
        membrane[fired] = 0
        spikes[:, step] = fired
    return spikes
