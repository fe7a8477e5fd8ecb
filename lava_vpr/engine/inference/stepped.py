"""The network with any neuron model, step by step in numpy; all but the neurons is as in `fixed_kernels.present`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.draw import poisson_spikes
from lava_vpr.engine.inference.biases import schedule
from lava_vpr.engine.inference.fixed_kernels import KernelNumbers
from lava_vpr.errors import PluginError
from lava_vpr.loihi import DECAY_UNITY, INPUT_SHIFT
from lava_vpr.neurons.models import NeuronConstants, NeuronModel, State

TOGETHER = 16
"""Presentations that advance together: the drives of all their steps are in memory at once."""


def present_stepped(
    model: NeuronModel,
    weights: NDArray[Any],
    row_sizes: NDArray[np.int64],
    numbers: KernelNumbers,
    rates: NDArray[np.uint16],
    slopes: NDArray[np.int32],
    keys: NDArray[np.uint64],
    bias: NDArray[np.int32],
    counts: NDArray[np.int32],
    events: NDArray[np.int64],
    raster: NDArray[np.uint8],
) -> None:
    """Run the presentations; arguments as of `fixed_kernels.present`, and the ``model`` of the neurons.

    Raises:
        PluginError: the model's step fails, or returns other arrays than it must.
    """
    for start in range(0, len(rates), TOGETHER):
        some = slice(start, start + TOGETHER)
        drives = np.zeros((len(rates[some]), numbers.total, counts.shape[1]), np.int64)
        for drive, own, key in zip(drives, rates[some], keys[some], strict=True):
            starts, members = (
                schedule(slopes[own], key, numbers.steps)
                if numbers.regular
                else poisson_spikes(own, key, numbers.steps)
            )
            for step in range(numbers.steps):
                rows = weights[members[starts[step] : starts[step + 1]], : counts.shape[1]]
                drive[step + numbers.input_delay] = rows.sum(axis=0, dtype=np.int64)
            events[:2] += row_sizes[members].sum(), len(members)
        film = _spikes(model, drives, numbers, bias if len(bias) == 1 else bias[some])
        leaves = range(0, counts.shape[1], numbers.leaf) if numbers.leaf else ()
        events[2] += film.sum()
        events[3] += sum(film[:, :, leaf : leaf + numbers.leaf].any(axis=2).sum() for leaf in leaves)
        events[4] += film.any(axis=2).sum()
        counts[some] = film.sum(axis=1)
        if raster.size:
            raster[some] = film


def _spikes(
    model: NeuronModel, drives: NDArray[np.int64], numbers: KernelNumbers, bias: NDArray[np.int32]
) -> NDArray[np.bool_]:
    """Every spike of presentations whose inputs bring ``drives`` (n, total, neurons); as many bool."""
    if model.step is None:
        raise PluginError(f"neuron model {model.name!r} has no step to take; use another network.model")
    n, total, neurons = drives.shape
    constants = NeuronConstants(int(numbers.threshold), DECAY_UNITY - int(numbers.keep))
    state: State = np.zeros((model.states, n, neurons), np.int64)
    film = np.zeros(drives.shape, np.bool_)
    for step in range(total):
        before = step - numbers.inhibition_delay
        pull = film[:, before].any(axis=1, keepdims=True) * int(numbers.lateral) if before >= 0 else 0
        state, spikes = model.step(constants, state, (drives[:, step] - pull << INPUT_SHIFT) + bias)
        got = [(np.asarray(each).dtype.kind, np.shape(each)) for each in (state, spikes)]
        if got != [("i", (model.states, n, neurons)), ("b", (n, neurons))]:
            raise PluginError(
                f"neuron model {model.name!r} must return whole numbers (states, n, neurons) and bool (n, neurons), "
                f"here {(model.states, n, neurons)}, but its step returned {got}; update or uninstall that package"
            )
        film[:, step] = spikes
    return film
