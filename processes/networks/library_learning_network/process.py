"""The network that learns places as one hierarchical Process of nothing but Lava's own library."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.process.ports.ports import InPort, OutPort
from lava.magma.core.process.variable import Var

from lava_vpr.engine.general.lif import LifParameters, need
from lava_vpr.engine.inference.fixed import SILENT_STEPS
from lava_vpr.engine.learning.integer import IntegerLearning, IntegerState
from lava_vpr.loihi import DECAY_BITS, WEIGHT_EXPONENT_LIMIT, WEIGHT_LIMIT
from lava_vpr.processes.base.checked import CheckedProcess


def mantissa_of(inhibition: int) -> tuple[int, int]:
    """``inhibition`` as mantissa 2^exponent of the lateral synapses.

    Raises:
        NetworkLimitError: it takes more than 8 bits, or an exponent beyond 7.
    """
    exponent = 0
    while inhibition >> exponent > WEIGHT_LIMIT:
        exponent += 1
    fits = exponent <= WEIGHT_EXPONENT_LIMIT and inhibition >> exponent << exponent == inhibition
    need(fits, "inhibition", inhibition, f"m 2^e with m in 0..{WEIGHT_LIMIT} and e in 0..{WEIGHT_EXPONENT_LIMIT}")
    return inhibition >> exponent, exponent


class LibraryLearningNetwork(CheckedProcess):
    """`IntegerLearning` wired from Lava's LIFReset, Dense, Sparse and LearningDense: what Intel's compiler could place.

    One presentation. Lava's LIF has one threshold for all, that does not rise, no floor and no hold; its synapses are
    not normalised: a phase that asks for any of these is refused. Equal to `engine.learning.integer.present` with the
    draws of `lava_vpr.engine.learning.lava_order.LibraryDraws`, every spike, weight and trace. Fixed point only:
    the library's floating-point LearningDense scales the same rule differently.

    Ports: ``s_in`` spikes (inputs,), ``s_out`` spikes of exc (neurons,), ``s_out_inh`` those of inh. Vars: ``weights``
    (neurons, inputs), ``x1`` traces (inputs,), ``u``, ``v`` of exc and ``v_inh`` (neurons,), ``vth`` (1,),
    ``lateral_weights`` (neurons, neurons), mantissas from inh (columns) to exc (rows), 0 or below.
    """

    def __init__(self, *, learning: IntegerLearning, state: IntegerState, rng_seed: int, **kwargs: Any) -> None:
        """Make the network for one presentation in one phase of learning.

        Args:
            learning: One phase of learning.
            state: Weights and (equal) thresholds at its start; not changed.
            rng_seed: Seed of Lava's random numbers for the traces.
        Raises:
            NetworkLimitError: the network could overflow Loihi's registers, or needs what the library lacks.
        """
        inputs, neurons = state.weights.shape
        learning.check(neurons)
        lif = learning.neurons
        missing = "left out with Lava's library; use LearningPlaceNetwork for it"
        for name in ("floor", "hold_steps", "theta_plus"):
            need(getattr(lif, name) == getattr(LifParameters, name), name, getattr(lif, name), missing)
        need(lif.dv < 1 << DECAY_BITS, "dv", lif.dv, "below 4096 with Lava's library")
        need(learning.weight_sum == 0, "weight_sum", learning.weight_sum, missing)
        need(learning.shift <= WEIGHT_EXPONENT_LIMIT, "shift", learning.shift, f"in 0..{WEIGHT_EXPONENT_LIMIT}")
        need(len(np.unique(state.theta)) == 1, "thresholds", state.theta, "equal with Lava's library")
        super().__init__(**kwargs)
        self.learning, self.rng_seed, self.lateral = learning, rng_seed, mantissa_of(learning.inhibition)
        self.start_weights, self.threshold = state.weights.T.astype(np.int32), int(state.theta[0])
        shape = (neurons,)
        self.s_in = InPort(shape=(inputs,))
        self.s_out = OutPort(shape=shape)
        self.s_out_inh = OutPort(shape=shape)
        self.weights = Var(shape=(neurons, inputs), init=self.start_weights)
        self.x1 = Var(shape=(inputs,), init=0)
        self.u, self.v, self.v_inh = (Var(shape=shape, init=0) for _ in range(3))
        self.vth = Var(shape=(1,), init=self.threshold)
        self.lateral_weights = Var(
            shape=(neurons, neurons), init=self.lateral[0] * (np.eye(neurons, dtype=np.int32) - 1)
        )

    @property
    def interval(self) -> int:
        """Steps of one presentation, the silent ones included."""
        return self.learning.steps + SILENT_STEPS
