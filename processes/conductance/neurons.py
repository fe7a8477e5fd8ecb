"""Settings of a population of conductance-based neurons.

Not in their Process's folder: Lava executes what lies there, where no dataclass can be defined.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from lava_vpr.errors import NetworkLimitError


@dataclass(frozen=True)
class ConductanceNeuron:
    """What the neurons of one population have in common; potentials in mV, rates as the share per step.

    Attributes:
        leak: Step over membrane time constant.
        ge_decay, gi_decay: Step over time constant of the excitatory and inhibitory conductance.
        rest, reset: Potential without input, and after a spike.
        threshold: A neuron spikes above ``(theta - offset) + threshold``.
        offset: Potential that is taken from theta.
        e_exc, e_inh: Reversal potentials.
        freeze: Steps from a spike to the first one in which the membrane moves again.
        refractory: Steps from a spike to the first one that may bring another.
        g_inh: What one inhibitory spike adds to the inhibitory conductance.
        theta_plus, theta_decay: What a spike adds to the neuron's theta in mV, and theta's loss per step; 0: frozen.
    """

    leak: float
    ge_decay: float
    gi_decay: float
    rest: float
    reset: float
    threshold: float
    offset: float
    e_exc: float
    e_inh: float
    freeze: int
    refractory: int
    g_inh: float = 0.0
    theta_plus: float = 0.0
    theta_decay: float = 0.0

    def __post_init__(self) -> None:
        shares = ("leak", "ge_decay", "gi_decay", "theta_decay")
        for name, value in vars(self).items():
            if not math.isfinite(value):
                raise NetworkLimitError(f"ConductanceLIF: {name} is {value}, but must be finite; set a number")
            if name in shares and not 0 <= value < 1:
                raise NetworkLimitError(
                    f"ConductanceLIF: {name} is {value}, but Euler's method needs [0, 1); shorten the step or lengthen "
                    "the time constant"
                )
            if name in ("freeze", "refractory", "g_inh", "theta_plus") and value < 0:
                raise NetworkLimitError(f"ConductanceLIF: {name} is {value}, but must be at least 0")
