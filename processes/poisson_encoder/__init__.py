"""Poisson input spikes."""

PROCESS = "PoissonEncoder"
