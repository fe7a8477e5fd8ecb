"""How a model is learned: the loop over stretches, what learns one, and where an interrupted training stands."""

from lava_vpr.training.loop import train

__all__ = ["train"]
