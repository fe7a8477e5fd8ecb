"""Backends, which count spikes: the host engine, Lava Processes, the simulation of a bundle, boards."""
