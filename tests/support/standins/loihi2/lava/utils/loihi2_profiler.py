"""Stand-in: Lava takes lava-loihi for installed where this module is. The profiler's public names, made-up values."""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
from lava.magma.core.callback_fx import NxSdkCallbackFx
from standin_chip import options


class _Profiler(NxSdkCallbackFx):
    """Called in the process of the board's service, asked in the caller's."""

    def __init__(self, steps: int) -> None:
        self.steps = steps
        self.seen = np.frombuffer(mmap.mmap(-1, 16), np.int64)  # runs that began, and ended

    def pre_run_callback(self, board: Any = None, var_id_to_var_model_map: dict[Any, Any] | None = None) -> None:
        self.seen[0] += 1

    def post_run_callback(self, board: Any = None, var_id_to_var_model_map: dict[Any, Any] | None = None) -> None:
        if board.steps != self.steps:
            raise ValueError(f"{self.steps} steps are to be measured, {board.steps} were run")
        self.seen[1] += 1

    @property
    def done(self) -> bool:
        """Whether one whole run was measured."""
        return self.seen.tolist() == [1, 1] and options().get("fault") != "no power"


class Loihi2Power(_Profiler):
    """Watts."""

    def __init__(self, num_steps: int) -> None:
        super().__init__(num_steps)

    @property
    def total_power(self) -> Any:
        """Many values."""
        return np.array([0.9, 1.1]) if self.done else np.zeros(0)

    @property
    def static_total_power(self) -> float:
        """Of the board at rest."""
        return 0.75


class Loihi2ExecutionTime(_Profiler):
    """Microseconds."""

    def __init__(self, t_start: int, t_end: int, buffer_size: int, bin_size: int) -> None:
        if t_start != 1 or buffer_size * bin_size < t_end:
            raise ValueError(f"{t_start}..{t_end} in {buffer_size} bins of {bin_size} steps")
        super().__init__(t_end)

    @property
    def avg_time_per_step(self) -> float:
        """Mean."""
        return 8.0 if self.done else 0.0
