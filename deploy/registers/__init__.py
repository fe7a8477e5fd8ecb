"""Registers and synapse memory of a core, and their bit-level simulation."""
