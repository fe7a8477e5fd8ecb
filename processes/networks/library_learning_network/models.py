"""How `LibraryLearningNetwork` is wired."""

from __future__ import annotations

import numpy as np
from lava.magma.core.decorator import implements, tag
from lava.magma.core.learning.learning_rule import Loihi2FLearningRule
from lava.magma.core.model.sub.model import AbstractSubProcessModel
from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol
from lava.proc.dense.process import Dense, LearningDense
from lava.proc.lif.process import LIFReset
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode
from scipy.sparse import identity

from lava_vpr.loihi import TRACE_LIMIT
from lava_vpr.processes.base.library_parts import reset_each, without_memory
from lava_vpr.processes.base.wiring import RELAY_WEIGHT, wire
from lava_vpr.processes.networks.library_learning_network.process import LibraryLearningNetwork


@implements(proc=LibraryLearningNetwork, protocol=LoihiProtocol)
@tag("fixed_pt")
class SubLibraryLearningNetwork(AbstractSubProcessModel):
    """Input spikes go to exc by synapses that its spikes change, exc to inh, and inh takes from every exc.

    Each exc has a relay, too, which gives it back in the same step what inh takes: winners are spared.
    """

    def __init__(self, proc: LibraryLearningNetwork) -> None:
        learning, n = proc.learning, len(proc.start_weights)
        lif, rule, (_, exponent) = learning.neurons, learning.rule, proc.lateral
        # Impulses saturate at 127: every spike sets its trace to that.
        stdp = Loihi2FLearningRule(
            dw=rule.microcode(), x1_impulse=TRACE_LIMIT, x1_tau=rule.tau, t_epoch=1, rng_seed=proc.rng_seed
        )
        self.excite = LearningDense(weights=proc.start_weights, learning_rule=stdp, sign_mode=SignMode.EXCITATORY)
        self.exc = LIFReset(shape=(n,), du=lif.du, dv=lif.dv, vth=proc.threshold, **reset_each(proc.interval))
        self.listen = Dense(weights=np.full((1, n), RELAY_WEIGHT), sign_mode=SignMode.EXCITATORY)
        self.inh = without_memory(1, proc.interval)
        self.inhibit = Dense(weights=proc.vars.lateral_weights.init, weight_exp=exponent, sign_mode=SignMode.INHIBITORY)
        self.echo = Sparse(
            weights=RELAY_WEIGHT * identity(n, dtype=np.int32, format="csr"), sign_mode=SignMode.EXCITATORY
        )
        self.own = without_memory(n, proc.interval)
        # Dense, as Lava's fixed-point Sparse fails once its weights were set.
        self.give_back = Dense(weights=proc.vars.own_weights.init, weight_exp=exponent, sign_mode=SignMode.EXCITATORY)
        wire(proc, self)
        self.exc.s_out.connect(self.excite.s_in_bap)
        proc.vars.x1.alias(self.excite.x1)
        proc.vars.own_weights.alias(self.give_back.weights)
