"""The excitatory population: leaky integrate-and-fire neurons, with what learning needs."""

from __future__ import annotations

from lava_vpr.processes.base.neurons import LifProcess


class ExcitatoryLIF(LifProcess):
    """Leaky integrate-and-fire neurons; ports, Vars and arithmetic as `LifProcess`.

    What Lava's LIF lacks: one threshold for each neuron, a floor, a hold after spikes, rising thresholds, and biases
    that follow presentations.
    """
