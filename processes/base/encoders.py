"""What the Processes that send input spikes have in common: presentations, one after another."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.processes.base.magma import (
    CheckedProcess,
    LavaPyType,
    OutPort,
    PyLoihiProcessModel,
    PyOutPort,
    Var,
    check_outputs,
    check_presentations,
)


class EncoderProcess(CheckedProcess):
    """Sends the spikes of its presentations, one after another; after the last it is silent.

    A presentation is ``steps`` steps with input and ``silent_steps`` without. Port: ``s_out`` spikes (inputs,). Var:
    ``emitted`` int64 (inputs,), how many spikes each input has sent. ``interval``: steps of a presentation.
    """

    rate_bits = 16
    """Bits of a rate, which is in units of 2^-rate_bits."""

    def __init__(
        self,
        *,
        rates: NDArray[Any],
        keys: NDArray[np.uint64],
        steps: int,
        silent_steps: int,
        emitted: NDArray[np.int64] | None = None,
        **kwargs: Any,
    ) -> None:
        """Make what sends the spikes of some presentations, one after another.

        Args:
            rates: Spikes a step in units of 2^-16, uint16 (n, inputs); with `rate_bits` 32, of 2^-32 in uint32.
            keys: One key per presentation (`lava_vpr.engine.random.presentation_keys`), uint64 (n,).
            steps: Steps with input, at least 1.
            silent_steps: Steps without; those of an inference network are `FixedNetwork.silent_steps`.
            emitted: Shared array to count in, besides the Var; int64 (inputs,).
        Raises:
            NetworkLimitError: arrays of another type or shape, or numbers of steps out of range.
        """
        name = type(self).__name__
        check_presentations(name, rates, keys, steps, silent_steps, bits=self.rate_bits)
        check_outputs(name, emitted=(emitted, rates.shape[1:], np.int64))
        self.interval = int(steps + silent_steps)
        super().__init__(
            rates=np.ascontiguousarray(rates),
            keys=keys,
            steps=int(steps),
            interval=self.interval,
            shared=emitted,
            **kwargs,
        )
        self.s_out = OutPort(shape=rates.shape[1:])
        self.emitted = Var(shape=rates.shape[1:], init=0)


class EncoderModel(PyLoihiProcessModel):
    """The base of all models: `begin` prepares a presentation, `members` are the inputs that spike in a step of it."""

    s_out: PyOutPort = LavaPyType(PyOutPort.VEC_DENSE, bool, precision=1)
    emitted: NDArray[np.int64] = LavaPyType(np.ndarray, np.int64)

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.rates, self.keys = proc_params["rates"], proc_params["keys"]
        self.steps, self.interval = proc_params["steps"], proc_params["interval"]
        self.shared = proc_params["shared"]
        self.spikes, self.silence = np.zeros((2, self.rates.shape[1]), bool)

    @abstractmethod
    def begin(self, image: int) -> None:
        """Prepare the presentation of this number."""

    @abstractmethod
    def members(self, step: int) -> NDArray[np.integer]:
        """The inputs that spike in ``step`` of the presentation; called once a step, in order."""

    def run_spk(self) -> None:
        """Send the spikes of this step."""
        image, step = divmod(self.time_step - 1, self.interval)
        if image >= len(self.keys) or step >= self.steps:
            self.s_out.send(self.silence)
            return
        if step == 0:
            self.begin(image)
        chosen = self.members(step)
        self.spikes[:] = False
        self.spikes[chosen] = True
        self.s_out.send(self.spikes)
        self.emitted[chosen] += 1
        if self.shared is not None:
            self.shared[chosen] += 1


class ListedEncoderProcess(EncoderProcess):
    """An encoder that lists the spikes of a presentation when it begins."""

    spikes_of: Callable[[NDArray[Any], np.uint64, int], tuple[NDArray[np.int64], NDArray[np.int32]]]
    """Where the spikes of each step begin in a list of all, and the list, of rates, key and steps with input."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(spikes_of=self.spikes_of, **kwargs)

    def compile_kernels(self) -> None:
        """Compile the kernel before the models are forked."""
        self.spikes_of(np.ones(1, f"uint{self.rate_bits}"), np.uint64(0), 1)


class ListedEncoderModel(EncoderModel):
    """The base of the models of a `ListedEncoderProcess`."""

    starts: NDArray[np.int64]
    listed: NDArray[np.int32]

    def begin(self, image: int) -> None:
        """List the spikes of a presentation, step by step."""
        self.starts, self.listed = self.proc_params["spikes_of"](self.rates[image], self.keys[image], self.steps)

    def members(self, step: int) -> NDArray[np.int32]:
        """The inputs whose turn it is."""
        return self.listed[self.starts[step] : self.starts[step + 1]]
