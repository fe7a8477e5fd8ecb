"""Bundles: compression of a model, the folder with everything that a board needs, and runs of its host program."""
