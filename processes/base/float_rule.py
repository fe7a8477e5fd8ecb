"""The STDP rule of `PlasticDense`'s floating-point model.

Not in that Process's folder: Lava executes what lies there, where no dataclass can be defined.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lava_vpr.engine.general.lif import need
from lava_vpr.engine.learning.integer import WeightRule
from lava_vpr.loihi import TRACE_LIMIT, WEIGHT_LIMIT


@dataclass(frozen=True)
class FloatRule:
    """On a postsynaptic spike ``w += eta (x - target) (w_max - w)^mu``, clipped to [0, w_max].

    The presynaptic trace x is set to 1 by a spike and decays by exp(-1 / tau) a step (the paper's rule, as
    `lava_vpr.engine.learning.stdp`).
    """

    eta: float
    target: float
    mu: float
    tau: float
    w_max: float

    @classmethod
    def of(cls, rule: WeightRule) -> FloatRule:
        """The rule that the integer ``rule`` approximates, for weights in 0..255."""
        eta = sum(mantissa * 2.0**exponent for mantissa, exponent in rule.products) / (1 << max(0, 9 * rule.mu - 4))
        return cls(eta * TRACE_LIMIT, rule.target / TRACE_LIMIT, float(rule.mu), rule.tau, float(WEIGHT_LIMIT))

    def check(self) -> None:
        """Refuse what makes no rule.

        Raises:
            NetworkLimitError: naming the part.
        """
        for name in ("eta", "target", "mu"):
            value = getattr(self, name)
            need(bool(np.isfinite(value)) and value >= 0, name, value, "a finite number, at least 0")
        for name in ("tau", "w_max"):
            value = getattr(self, name)
            need(bool(np.isfinite(value)) and value > 0, name, value, "a finite number above 0")
