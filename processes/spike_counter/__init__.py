"""Counts spikes per presentation."""

PROCESSES = ("SpikeCounter",)
