"""Membranes of one presentation, recomputed from the spikes that reached the neurons.

The engine returns spike counts, or every spike, but no membranes, since answering queries needs none. The cost model
needs them to count what a chip updates; this module computes them with the engine's own membrane step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.fixed_kernels import integrate
from lava_vpr.engine.presentations import check_array
from lava_vpr.kernelcache import compiled
from lava_vpr.loihi import DECAY_BITS, INPUT_SHIFT


class Membranes(NamedTuple):
    """Excitatory neurons step by step.

    Attributes:
        after: Membranes after each step, in the units of v, 0 where a neuron has just spiked, int32 (steps, neurons).
        fired: Which neurons spiked, uint8 (steps, neurons).
    """

    after: NDArray[np.int32]
    fired: NDArray[np.uint8]


@compiled(nogil=True)
def _replay(
    weights: NDArray[np.int16],
    bias: NDArray[np.int32],
    threshold: np.int32,
    lateral: np.int32,
    keep: np.int32,
    delay: int,
    inputs: NDArray[np.uint8],
    root: NDArray[np.uint8],
    after: NDArray[np.int32],
    fired: NDArray[np.uint8],
) -> None:
    """Fill ``after`` and ``fired``; input spikes arrive ``delay`` steps later, the root's one step later."""
    (steps, width), neurons = inputs.shape, after.shape[1]
    v, drive = np.zeros(neurons, np.int32), np.zeros(neurons, np.int32)
    for step in range(steps):
        drive[:] = 0
        if step >= delay:
            for j in range(width):
                if inputs[step - delay, j]:
                    for i in range(neurons):
                        drive[i] += np.int32(weights[j, i])
        pull = lateral if step > 0 and root[step - 1] else np.int32(0)
        if integrate(v, drive, bias, pull, keep, False) > threshold:
            for i in range(neurons):
                if v[i] > threshold:
                    v[i] = 0
                    fired[step, i] = 1
        after[step] = v


def membranes(
    network: FixedNetwork,
    inputs: NDArray[np.uint8],
    inh: NDArray[np.uint8],
    bias: NDArray[np.int32] | None = None,
) -> Membranes:
    """Membranes and spikes of exc in one presentation, from the spikes that reach them; recorded spikes of exc are not
    used.

    Args:
        network: The network, checked.
        inputs: Spikes of the inputs, uint8 (interval, inputs).
        inh: Spikes of the inhibitory neurons, the root the last, uint8 (interval, inhibitory).
        bias: Biases of the neurons in this presentation, int32 (neurons,); None: the network's.
    Raises:
        InputError: spikes of another shape.
    """
    steps = len(inputs)
    for name, spikes, width in (
        ("input spikes", inputs, network.inputs),
        ("spikes of inhibitory neurons", inh, network.inhibitory),
    ):
        check_array(spikes.view(np.uint8), name, np.uint8, (steps, width), "record them with this network")
    result = Membranes(
        np.zeros((steps, network.neurons), np.int32),
        np.zeros((steps, network.neurons), np.uint8),
    )
    _replay(
        network.weights,
        network.bias if bias is None else bias,
        np.int32(network.threshold << INPUT_SHIFT),
        np.int32(network.lateral),
        np.int32((1 << DECAY_BITS) - network.decay),
        network.input_delay,
        np.ascontiguousarray(inputs).view(np.uint8),
        np.ascontiguousarray(inh[:, -1]).view(np.uint8),
        *result,
    )
    return result
