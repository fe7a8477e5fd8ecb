"""Stand-in for the models of embedded processors, where run_configs.py and compiler.py import them."""

from lava.magma.core.model.model import AbstractProcessModel


class AbstractCProcessModel(AbstractProcessModel):
    """A model that runs on an embedded processor."""


class CLoihiProcessModel(AbstractCProcessModel):
    """The same, in step with Loihi."""
