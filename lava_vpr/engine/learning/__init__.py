"""STDP in floating point, in Loihi's integers, and in the order in which Lava applies it."""
