"""The reference network in Brian2; it lives in the package, where `lava-vpr bench` times it, too."""

from lava_vpr.bench.brian2_reference import Brian2Network, test_presentation, train_presentation

__all__ = ["Brian2Network", "test_presentation", "train_presentation"]
