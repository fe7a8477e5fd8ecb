"""Stand-in for the models of neuron cores, where run_configs.py and compiler.py import them."""

from lava.magma.core.model.model import AbstractProcessModel


class AbstractNcProcessModel(AbstractProcessModel):
    """A model that runs on a neuron core."""
