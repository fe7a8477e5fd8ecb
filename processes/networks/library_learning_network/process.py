"""The network that learns places as one hierarchical Process of nothing but Lava's own library."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.process.ports.ports import InPort, OutPort
from lava.magma.core.process.variable import Var
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import LifParameters, need
from lava_vpr.engine.learning.integer import IntegerLearning, IntegerState
from lava_vpr.loihi import DECAY_BITS
from lava_vpr.processes.base.checked import CheckedProcess
from lava_vpr.processes.base.wiring import exact_mantissa


class LibraryLearningNetwork(CheckedProcess):
    """`IntegerLearning` wired from Lava's LIFReset, Dense, Sparse and LearningDense: what Intel's compiler could place.

    One presentation. Lava's LIF has one threshold for all, that does not rise, no floor and no hold; its synapses are
    not normalised: a phase that asks for any of these is refused. Equal to `engine.learning.integer.present` with the
    draws of `lava_vpr.engine.learning.lava_order.LibraryDraws`, every spike, weight and trace. Fixed point only:
    the library's floating-point LearningDense scales the same rule differently.

    Ports: ``s_in`` spikes (inputs,), ``s_out`` spikes of exc (neurons,), ``s_out_inh`` those of inh (1,). Vars:
    ``weights`` (neurons, inputs), ``x1`` traces (inputs,), ``u``, ``v`` of exc (neurons,), ``v_inh`` and ``vth`` (1,),
    ``lateral_weights`` (neurons, 1), mantissas of what inh takes from each neuron, 0 or below, and ``own_weights``
    (neurons, neurons), the same on the diagonal, given back by each neuron's own relay (`set_laterals` writes both).
    """

    def __init__(
        self,
        *,
        learning: IntegerLearning,
        state: IntegerState,
        rng_seed: int,
        mantissas: NDArray[np.int64] | None = None,
        **kwargs: Any,
    ) -> None:
        """Make the network for one presentation in one phase of learning.

        Args:
            learning: One phase of learning.
            state: Weights and (equal) thresholds at its start; not changed.
            rng_seed: Seed of Lava's random numbers for the traces.
            mantissas: What inh takes from each neuron, int64 (neurons,), 0..255; the exponent is that of
                ``learning.inhibition``, whose mantissa is the default for all.
        Raises:
            NetworkLimitError: the network could overflow Loihi's registers, or needs what the library lacks.
        """
        inputs, neurons = state.weights.shape
        learning.check()
        lif = learning.neurons
        missing = "left out with Lava's library; use LearningPlaceNetwork for it"
        for name in ("floor", "hold_steps", "theta_plus"):
            need(getattr(lif, name) == getattr(LifParameters, name), name, getattr(lif, name), missing)
        need(lif.dv < 1 << DECAY_BITS, "dv", lif.dv, "below 4096 with Lava's library")
        need(learning.weight_sum == 0, "weight_sum", learning.weight_sum, missing)
        need(len(np.unique(state.theta)) == 1, "thresholds", state.theta, "equal with Lava's library")
        super().__init__(**kwargs)
        self.learning, self.rng_seed, self.lateral = learning, rng_seed, exact_mantissa(learning.inhibition)
        self.start_weights, self.threshold = state.weights.T.astype(np.int32), int(state.theta[0])
        shape = (neurons,)
        self.s_in = InPort(shape=(inputs,))
        self.s_out = OutPort(shape=shape)
        self.s_out_inh = OutPort(shape=(1,))
        self.weights = Var(shape=(neurons, inputs), init=self.start_weights)
        self.x1 = Var(shape=(inputs,), init=0)
        self.u, self.v, self.v_inh = (Var(shape=(size,), init=0) for size in (neurons, neurons, 1))
        self.vth = Var(shape=(1,), init=self.threshold)
        taken = np.full(neurons, self.lateral[0]) if mantissas is None else mantissas
        self.lateral_weights = Var(shape=(neurons, 1), init=-taken.astype(np.int32)[:, None])
        self.own_weights = Var(shape=(neurons, neurons), init=np.diag(taken.astype(np.int32)))

    @property
    def interval(self) -> int:
        """Steps of one presentation, the silent ones included."""
        return self.learning.interval

    def set_laterals(self, mantissas: NDArray[np.int64]) -> None:
        """Write what inh takes from each neuron, and what its relay gives back; the run must pause.

        Args:
            mantissas: int64 (neurons,), 0..255.
        """
        values = mantissas.astype(np.int32)
        self.lateral_weights.set(-values[:, None])
        self.own_weights.set(np.diag(values))
