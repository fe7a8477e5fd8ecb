"""The network of places that hears the cells of the spiking front end themselves: the kernel of these presentations.

One run takes an image from pixels to places. Cells spike in bursts (`lava_vpr.inputs.front_end.FrontEnd.burst_codes`).
Currents of the neurons of places keep what bursts and inhibition add, but for what rounding takes, so that a current is
a neuron's whole drive; membranes keep nothing, so that the bias takes off what all places share once, as a part of that
drive. From the step ``rising`` on the clock raises all currents alike, step by step, until the most driven neurons
spike; the root then lowers all. So currents move up and down around the threshold, and a neuron spikes in the more of
these steps the more it is driven. Per step, as `lava_vpr.engine.general.lif` has it::

    a  = sum of weights of the cells that spiked in the step before - inhibition, if the root spiked in the step before
         + rise, from the step ``rising`` on; - `SILENCING`, once, in ``steps``
    u' = sign(u) (|u| 4095 >> 12) + (a << 6), wrapped into 24 bits
    v' = clip(sign(v) (|v| (4096 - dv) >> 12) + u' + bias, +-(2^23 - 1))
    spike if v' > vth << 6, then v' = 0

The clock of the front end adds rise and silencing: no neuron spikes after the last step but two.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.fixed_kernels import KernelNumbers, add_rows, fire, kept
from lava_vpr.inputs.front_end import BURST, BURST_STEPS
from lava_vpr.kernelcache import compiled
from lava_vpr.loihi import DECAY_BITS, DECAY_UNITY, INPUT_SHIFT, STATE_LIMIT, WEIGHT_EXPONENT_LIMIT

SILENCING = 2 * (96 << WEIGHT_EXPONENT_LIMIT)
"""What silences a neuron for the rest of a presentation, in units of the weights: two synapses take it, and leave a
quarter of what the input sum of a step holds on Loihi 1 to inhibition in the same step."""


def strengths(rates: NDArray[Any], direct: bool) -> NDArray[Any]:
    """What is compared of the rates of queries, (n, inputs), and averaged over them: these; of cells that neurons hear
    directly, rates that bring in `BURST_STEPS` steps as many spikes as their bursts have."""
    return (rates % BURST * (65536 // BURST_STEPS)).astype(np.uint16) if direct else rates


@compiled(nogil=True)
def _in_steps(bursts: NDArray[np.uint16], total: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """The cells that spike in each step, one step after another, int32 (spikes,), and where each step's begin, int64
    (total + 1,)."""
    begins = np.zeros(total + 1, np.int64)
    for burst in bursts:
        for step in range(burst // BURST, burst // BURST + burst % BURST):
            begins[step + 1] += 1
    begins = np.cumsum(begins)
    cells, filled = np.empty(begins[-1], np.int32), begins.copy()
    for cell in range(bursts.size):
        for step in range(bursts[cell] // BURST, bursts[cell] // BURST + bursts[cell] % BURST):
            cells[filled[step]] = cell
            filled[step] += 1
    return begins, cells


@compiled(inline="always")
def _integrate(
    u: NDArray[np.int32],
    v: NDArray[np.int32],
    drive: NDArray[Any],
    own: NDArray[np.int32],
    added: np.int32,
    pull: np.int32,
    keep: np.int32,
) -> np.int32:
    """One step of all currents and membranes; returns the highest membrane."""
    top, span = STATE_LIMIT, 2 * STATE_LIMIT
    highest = np.int32(1 - STATE_LIMIT)
    for i in range(v.size):
        lost = (abs(u[i]) + (DECAY_UNITY - 1)) >> DECAY_BITS
        current = (u[i] - lost if u[i] > 0 else u[i] + lost) + ((np.int64(drive[i]) - pull) << INPUT_SHIFT) + added
        current = current - span if current > top else current
        current = current + span if current <= -top else current
        u[i] = current
        v[i] = min(max(np.int64(kept(v[i], keep)) + current + own[i], 1 - STATE_LIMIT), STATE_LIMIT - 1)
        highest = max(highest, v[i])
    return highest


@compiled(nogil=True)
def present_direct(
    weights: NDArray[Any],
    row_sizes: NDArray[np.int64],
    numbers: KernelNumbers,
    bursts: NDArray[np.uint16],
    bias: NDArray[np.int32],
    acc: NDArray[np.int32],
    counts: NDArray[np.int32],
    events: NDArray[np.int64],
    raster: NDArray[np.uint8],
) -> None:
    """Present every image of ``bursts`` (n, inputs) to the network; the others as
    `lava_vpr.engine.inference.fixed_kernels.present` has them."""
    no_row, neurons, width = np.zeros(0, np.uint8), counts.shape[1], weights.shape[1]
    u, v, own = np.zeros(width, np.int32), np.zeros(width, np.int32), np.zeros(width, np.int32)
    for q in range(bursts.shape[0]):
        begins, cells = _in_steps(bursts[q], numbers.total)
        u[:] = 0
        own[:neurons] = bias[q if bias.shape[0] > 1 else 0]
        v[:] = own
        volley, fired = False, 0
        for step in range(1, numbers.total):
            arriving = cells[begins[step - 1] : begins[step]]
            events[0] += add_rows(weights, row_sizes, arriving, acc)
            events[1] += arriving.size
            added = numbers.rise if numbers.rising <= step < numbers.steps else np.int32(0)
            added = np.int32(-SILENCING) if step == numbers.steps else added
            pull = numbers.lateral if volley else np.int32(0)
            volley = fired > 0  # the root spikes now
            fired = 0
            if _integrate(u, v, acc, own, added << INPUT_SHIFT, pull, numbers.keep) > numbers.threshold:
                row = raster[q, step] if raster.size > 0 else no_row
                fired, _ = fire(v, numbers.threshold, 0, counts[q], row)
                events[2] += fired
                events[4] += fired > 0
