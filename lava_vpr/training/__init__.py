"""Training of a model: the loop over stretches, the trainers of one stretch, and checkpoints."""

from lava_vpr.training.loop import train

__all__ = ["train"]
