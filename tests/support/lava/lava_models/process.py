"""A Process that does as it is told at a step.

Used by support.
"""

from __future__ import annotations

from lava.magma.core.process.ports.ports import InPort, OutPort
from lava.magma.core.process.process import AbstractProcess


class Actor(AbstractProcess):
    """Sends the step; at step ``when`` it does ``what`` (see the model)."""

    def __init__(self, what: str, when: int) -> None:
        super().__init__(what=what, when=when)
        self.a_out = OutPort(shape=(1,))


class Listener(AbstractProcess):
    """Receives what an `Actor` sends."""

    def __init__(self) -> None:
        super().__init__()
        self.a_in = InPort(shape=(1,))
