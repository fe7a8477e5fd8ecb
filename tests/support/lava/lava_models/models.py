"""Models of `Actor` and `Listener`.

Used by isolated and project.
"""

from __future__ import annotations

import ctypes
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from lava.magma.core.decorator import implements, requires
from lava.magma.core.model.py.model import PyLoihiProcessModel
from lava.magma.core.model.py.ports import PyInPort, PyOutPort
from lava.magma.core.model.py.type import LavaPyType
from lava.magma.core.resources import CPU
from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol
from support.lava.lava_models.process import Actor, Listener

from lava_vpr.errors import NetworkLimitError
from lava_vpr.isolated.worker import report


@implements(proc=Actor, protocol=LoihiProtocol)
@requires(CPU)
class PyActor(PyLoihiProcessModel):
    """Sends the step, and fails in the way that it is told."""

    a_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, np.int32)

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.what, self.when = proc_params["what"], proc_params["when"]
        if self.what == "limit at start":
            raise NetworkLimitError("the model refuses; use a smaller one")

    def run_spk(self) -> None:
        """One step."""
        report(1)
        if self.time_step == self.when:
            self.act()
        self.a_out.send(np.array([self.time_step], np.int32))

    def act(self) -> None:
        """Fail, or wait until it is told to go on."""
        if self.what == "raise":
            raise ValueError("told to\nfail")
        if self.what == "exit":
            sys.exit(0)
        while self.what == "wait" and not Path("go").exists():
            time.sleep(0.01)
        if self.what == "sleep":
            time.sleep(3600)
        if self.what == "crash":
            ctypes.string_at(0)
        if self.what == "gone":
            os._exit(7)
        if self.what == "thread":
            threading.Thread(target=lambda: [][1], name="side").start()
            time.sleep(3600)


@implements(proc=Listener, protocol=LoihiProtocol)
@requires(CPU)
class PyListener(PyLoihiProcessModel):
    """Receives."""

    a_in: PyInPort = LavaPyType(PyInPort.VEC_DENSE, np.int32)

    def run_spk(self) -> None:
        """One step."""
        self.a_in.recv()
