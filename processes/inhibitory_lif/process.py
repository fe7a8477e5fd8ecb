"""The inhibitory population: one relay for each excitatory neuron."""

from __future__ import annotations

from typing import Any

from lava_vpr.processes.base.neurons import LifProcess


class InhibitoryLIF(LifProcess):
    """Relays without memory: with the defaults any positive input makes a neuron spike in the same step.

    Ports, Vars and arithmetic as `LifProcess`.
    """

    def __init__(
        self,
        *,
        shape: tuple[int, ...],
        du: float = 4095,
        dv: float = 4095,
        vth: Any = 0,
        reset_interval: int = 0,
        **kwargs: Any,
    ) -> None:
        """Make the population.

        Args:
            shape: (neurons,).
            du, dv: Decays of current and membrane in units of 2^-12.
            vth: Thresholds, 0..131071, one for all or one each.
            reset_interval: Steps of a presentation; 0: never reset.
        Raises:
            NetworkLimitError: as `lava_vpr.processes.excitatory_lif.process.ExcitatoryLIF`.
        """
        super().__init__(shape=shape, du=du, dv=dv, vth=vth, reset_interval=reset_interval, **kwargs)
