"""Synapses from every input to every neuron."""

PROCESS = "DenseSynapses"
