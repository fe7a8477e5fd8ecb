"""Counts spikes per presentation."""

PROCESS = "SpikeCounter"
