"""Synapses of which most pairs of neurons have none."""

PROCESSES = ("SparseSynapses",)
