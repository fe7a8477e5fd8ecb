"""Power and time of a run as lava-loihi measures them; names as in Intel's public benchmarks (lava-dl, pilotnet)."""

from __future__ import annotations

from typing import Any

import numpy as np

from refusals import Refused

BUFFER = 1024  # values


class Profiler:
    """lava-loihi's measurement of ``steps`` steps; `callbacks` belong into Loihi2HwCfg."""

    def __init__(self, steps: int) -> None:
        from lava.utils.loihi2_profiler import Loihi2ExecutionTime, Loihi2Power

        self.steps, width = steps, max(1, -(-steps // BUFFER))
        self.power = Loihi2Power(num_steps=steps)
        self.time = Loihi2ExecutionTime(t_start=1, t_end=steps, buffer_size=BUFFER, bin_size=width)

    @property
    def callbacks(self) -> list[Any]:
        """What the board's service calls before and after the run."""
        return [self.power, self.time]

    def figures(self) -> dict[str, float]:
        """After the run, Lava being stopped. Watts become milliwatts; the power of the board at rest is subtracted.

        Raises:
            Refused: there is nothing.
        """
        total = float(np.mean(self.power.total_power)) if len(self.power.total_power) else 0.0
        idle, step = float(self.power.static_total_power), float(self.time.avg_time_per_step)
        if not (0 < total < float("inf") and step > 0):
            raise Refused("run", f"the profiler measured no power ({total} W, {step} us a step); run again")
        found = {"milliwatts": 1e3 * total, "idle_milliwatts": 1e3 * idle, "dynamic_milliwatts": 1e3 * (total - idle)}
        return found | {"microseconds_per_step": step, "steps": float(self.steps)}
