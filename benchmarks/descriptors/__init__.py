"""Vectors as inputs: what the network makes of descriptors, beside their own cosine."""
