"""Stand-in for the service that drives the board, in a process of its own."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from lava.magma.runtime.mgmt_token_enums import MGMT_COMMAND, MGMT_RESPONSE, enum_equal, enum_to_np
from lava.magma.runtime.runtime_services.interfaces import AbstractRuntimeService

QUIET = 0.2  # seconds without a step of the host


class NxSdkRuntimeService(AbstractRuntimeService):
    """Builds the chip, and does what Lava's runtime asks."""

    def __init__(self, protocol: Any, *args: Any, **kwargs: Any) -> None:
        super().__init__(protocol)
        self.builders = kwargs["nc_builders"], kwargs["c_builders"]
        self.callbacks = kwargs["callback_fxs"]

    def start(self) -> None:
        """Build the chip and serve until told to stop."""
        from standin_chip.chip import Chip

        self.chip = Chip(*self.builders)
        for port in (self.runtime_to_service, self.service_to_runtime, *self.chip.channels()):
            port.start()
        self.run()

    def run(self) -> None:
        """Serve."""
        from standin_chip import note

        while True:
            command = self.runtime_to_service.recv()
            if enum_equal(command, MGMT_COMMAND.STOP):
                note(f"ran {self.chip.steps} steps")
                self.service_to_runtime.send(MGMT_RESPONSE.TERMINATED)
                self.join()
                return
            if enum_equal(command, MGMT_COMMAND.PAUSE):
                self.service_to_runtime.send(MGMT_RESPONSE.PAUSED)
            elif enum_equal(command, MGMT_COMMAND.SET_DATA):
                where = self._number(), self._number()
                value = np.array([self.runtime_to_service.recv()[0] for _ in range(self._number())])
                self.chip.set(*where, value)
                self.service_to_runtime.send(MGMT_RESPONSE.SET_COMPLETE)
            elif enum_equal(command, MGMT_COMMAND.GET_DATA):
                values = self.chip.get(self._number(), self._number())
                for value in (len(values), *values):
                    self.service_to_runtime.send(enum_to_np(value))
            else:
                self._steps(int(command[0]))

    def _number(self) -> int:
        return int(self.runtime_to_service.recv()[0])

    def _steps(self, steps: int) -> None:
        """Run; after the fault ``pause`` only what the host's models have begun."""
        for callback in self.callbacks:
            callback.pre_run_callback(self.chip, {})
        for _ in range(steps):
            if self.chip.step():
                self.service_to_runtime.send(MGMT_RESPONSE.REQ_PAUSE)
                while not self.runtime_to_service.probe():
                    time.sleep(QUIET)
                self._finish()
                return
        for callback in self.callbacks:
            callback.post_run_callback(self.chip, {})
        self.service_to_runtime.send(MGMT_RESPONSE.DONE)

    def _finish(self) -> None:
        """Run steps that the host has begun until it begins no more."""
        end = time.monotonic() + QUIET
        while time.monotonic() < end:
            if self.chip.ready():
                self.chip.step()
                end = time.monotonic() + QUIET

    def join(self) -> None:
        """Close all channels."""
        super().join()
        for port in self.chip.channels():
            port.join()
