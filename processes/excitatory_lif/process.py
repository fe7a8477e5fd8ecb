"""The excitatory population: leaky integrate-and-fire neurons, with what learning needs."""

from __future__ import annotations

from typing import Any

from lava_vpr.processes.base.neurons import LifProcess


class ExcitatoryLIF(LifProcess):
    """Leaky integrate-and-fire neurons; ports, Vars and arithmetic as `LifProcess`.

    What Lava's LIF lacks: one threshold for each neuron, a floor, a hold after spikes, rising thresholds.
    """

    def __init__(
        self,
        *,
        shape: tuple[int, ...],
        dv: float,
        vth: Any,
        du: float = 4095,
        bias_mant: Any = 0,
        bias_exp: Any = 0,
        floor: float | None = None,
        hold_steps: int = 0,
        theta_plus: float = 0,
        reset_interval: int = 0,
        **kwargs: Any,
    ) -> None:
        """Make the population.

        Args:
            shape: (neurons,).
            dv, du: Decays of membrane and current in units of 2^-12, 0..4096 and 0..4095 (4095: no memory).
            vth: Thresholds, 0..131071, one for all or one each.
            bias_mant, bias_exp: Bias mant 2^exp in units of 2^-6 of the threshold's, -4096..4095 and -7..7.
            floor: Lower bound of the membrane in the threshold's unit, -131071..0; None: none.
            hold_steps: Steps after a spike in which the membrane stays at 0.
            theta_plus: What a spike adds to its neuron's threshold.
            reset_interval: Steps of a presentation; 0: never reset.
        Raises:
            NetworkLimitError: shapes that do not fit, or integers that Loihi's registers cannot hold; numbers of a
                float type are checked when Lava picks the integer model for them.
        """
        super().__init__(
            shape=shape,
            dv=dv,
            vth=vth,
            du=du,
            bias_mant=bias_mant,
            bias_exp=bias_exp,
            floor=floor,
            hold_steps=hold_steps,
            theta_plus=theta_plus,
            reset_interval=reset_interval,
            **kwargs,
        )
