"""Poisson input spikes."""
