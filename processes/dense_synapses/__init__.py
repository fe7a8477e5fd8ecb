"""Synapses from every input to every neuron."""
