"""The network that learns places as one hierarchical Process of this project's own Processes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import check_thresholds, need
from lava_vpr.engine.learning.integer import IntegerLearning, IntegerState
from lava_vpr.loihi import THRESHOLD_LIMIT
from lava_vpr.processes.base.magma import AbstractSubProcessModel, LoihiProtocol, Var, implements
from lava_vpr.processes.base.network import NetworkProcess
from lava_vpr.processes.base.wiring import RELAY_WEIGHT, exact_mantissa, wire
from lava_vpr.processes.lif.process import ExcitatoryLIF, InhibitoryLIF
from lava_vpr.processes.plastic_dense.process import PlasticDense
from lava_vpr.processes.synapses.process import DenseSynapses, OneToOne


class LearningPlaceNetwork(NetworkProcess):
    """`IntegerLearning` composed of PlasticDense, ExcitatoryLIF, InhibitoryLIF, DenseSynapses and OneToOne.

    One inhibitory neuron takes from every neuron; a relay of each neuron gives back what was taken in the same step.

    Every presentation of ``keys`` is `engine.learning.integer.present`: weights are normalised and membranes and traces
    cleared in its first step; thresholds are kept. With ``late_theta`` thresholds rise between presentations and by the
    host (`raise_thresholds`), as on a chip. Under ``floating_pt`` the same spec runs without rounding.

    A run that prefers SubProcessModels puts Lava's LIFReset, Dense, Sparse and LearningDense in the place of the parts:
    what Intel's compiler could place. It takes ``rng_seed``, one presentation, and what the library has: one threshold
    for all that does not rise, no floor, no hold, no normalisation. Equal, too, in every spike, weight and trace.

    Ports: ``s_in`` spikes (inputs,), ``s_out`` spikes of exc (neurons,), ``s_out_inh`` those of inh (1,). Vars:
    ``weights`` (neurons, inputs), ``x1`` traces (inputs,), ``u``, ``v``, ``vth`` of exc (neurons,), ``v_inh`` (1,),
    ``lateral_weights`` (neurons, 1), mantissas of what inh takes from each neuron, 0 or below, and ``own_weights``
    (neurons, neurons), the same on the diagonal, given back by each neuron's own relay (`set_laterals` writes both).
    """

    def __init__(
        self,
        *,
        learning: IntegerLearning,
        state: IntegerState,
        keys: NDArray[np.uint64],
        rng_seed: int | None = None,
        mantissas: NDArray[np.int64] | None = None,
        record_weights: NDArray[Any] | None = None,
        record_traces: NDArray[Any] | None = None,
        **kwargs: Any,
    ) -> None:
        """Make the network for one phase of learning.

        Args:
            learning: One phase of learning.
            state: Weights and thresholds at its start; not changed.
            keys, rng_seed, record_weights, record_traces: See `lava_vpr.processes.plastic_dense.process.PlasticDense`.
            mantissas: What inh takes from each neuron, int64 (neurons,), 0..255; the exponent is that of
                ``learning.inhibition``, whose mantissa is the default for all.
        Raises:
            NetworkLimitError: the network could overflow Loihi's registers, or arrays do not fit each other.
        """
        inputs, neurons = state.weights.shape
        learning.check()
        need(state.theta.shape == (neurons,), "LearningPlaceNetwork: theta", state.theta.shape, f"({neurons},)")
        check_thresholds(state.theta)
        plasticity: dict[str, Any] = {
            "weights": np.ascontiguousarray(state.weights.T),
            "rule": learning.rule,
            "steps": learning.steps,
            "silent_steps": learning.silent_steps,
            "keys": keys,
            "weight_sum": learning.weight_sum,
            "rng_seed": rng_seed,
            "record_weights": record_weights,
            "record_traces": record_traces,
        }
        mantissa, self.exponent = exact_mantissa(learning.inhibition)
        taken = np.full(neurons, mantissa, np.int32) if mantissas is None else mantissas.astype(np.int32)
        super().__init__(plasticity["weights"], state.theta.copy(), -taken[:, None], learning.interval, **kwargs)
        self.learning, self.plasticity = learning, plasticity
        self.x1 = Var(shape=(inputs,), init=0)
        self.own_weights = Var(shape=(neurons, neurons), init=np.diag(taken))

    def set_laterals(self, mantissas: NDArray[np.int64]) -> None:
        """Write what inh takes from each neuron, and what its relay gives back; the run must pause.

        Args:
            mantissas: int64 (neurons,), 0..255.
        """
        values = mantissas.astype(np.int32)
        self.lateral_weights.set(-values[:, None])
        self.own_weights.set(np.diag(values))

    def raise_thresholds(self, counts: NDArray[np.int32]) -> None:
        """Raise the thresholds as the host does after a presentation with ``late_theta``; the run must pause.

        Args:
            counts: Spikes of each neuron in that presentation, (neurons,).
        """
        raised = self.vth.get() + counts * self.learning.neurons.theta_plus
        self.vth.set(np.minimum(raised, THRESHOLD_LIMIT - 1))


@implements(proc=LearningPlaceNetwork, protocol=LoihiProtocol)
class SubLearningPlaceNetwork(AbstractSubProcessModel):
    """Input spikes go to exc by synapses that its spikes change, exc to inh, and inh takes from every exc.

    Each exc has a relay, too, which gives it back in the same step what inh takes: winners are spared.
    """

    def __init__(self, proc: LearningPlaceNetwork) -> None:
        learning, shape, interval = proc.learning, proc.s_out.shape, proc.interval
        lif = learning.neurons
        self.excite = PlasticDense(**proc.plasticity)
        self.exc = ExcitatoryLIF(
            shape=shape,
            du=lif.du,
            dv=lif.dv,
            vth=proc.vars.vth.init,
            floor=lif.floor,
            hold_steps=lif.hold_steps,
            theta_plus=0 if learning.late_theta else lif.theta_plus,
            reset_interval=interval,
        )
        self.listen = DenseSynapses(weights=np.full((1, *shape), RELAY_WEIGHT))
        self.inh = InhibitoryLIF(shape=(1,), reset_interval=interval)
        self.inhibit = DenseSynapses(
            weights=proc.vars.lateral_weights.init, weight_exp=proc.exponent, sign_mode="inhibitory"
        )
        self.echo = OneToOne(shape=shape, weight=RELAY_WEIGHT)
        self.own = InhibitoryLIF(shape=shape, reset_interval=interval)
        # Not OneToOne: Lava's fixed-point Sparse fails once its weights were set.
        self.give_back = DenseSynapses(
            weights=proc.vars.own_weights.init, weight_exp=proc.exponent, sign_mode="excitatory"
        )
        wire(proc, self)
        self.exc.s_out.connect(self.excite.s_in_post)
        proc.vars.x1.alias(self.excite.x1)
        proc.vars.own_weights.alias(self.give_back.weights)
