"""Counts spikes per presentation."""
