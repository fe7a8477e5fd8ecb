"""The inhibitory population, the root and its leaves; and relays, which are the same neurons."""

from __future__ import annotations

from typing import Any

from lava_vpr.loihi import NO_MEMORY_DECAY
from lava_vpr.processes.base.neurons import LifProcess


class InhibitoryLIF(LifProcess):
    """Neurons without memory: with the defaults any positive input makes one spike in the same step.

    Ports, Vars and arithmetic as `LifProcess`.
    """

    def __init__(self, *, dv: float = NO_MEMORY_DECAY, vth: Any = 0, **kwargs: Any) -> None:
        """Make the population, by default of neurons that any positive input makes spike.

        Args:
            dv: Decay of the membrane in units of 2^-12.
            vth: Thresholds, 0..131071, one for all or one each.
            **kwargs: The other arguments of `LifProcess`: ``shape``, ``du``, ``reset_interval`` and so on.
        Raises:
            NetworkLimitError: as `LifProcess`.
        """
        super().__init__(dv=dv, vth=vth, **kwargs)
