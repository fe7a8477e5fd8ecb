"""How `LibraryLearningNetwork` is wired."""

from __future__ import annotations

from lava.magma.core.decorator import implements, tag
from lava.magma.core.learning.learning_rule import Loihi2FLearningRule
from lava.magma.core.model.sub.model import AbstractSubProcessModel
from lava.magma.core.sync.protocols.loihi_protocol import LoihiProtocol
from lava.proc.dense.process import Dense, LearningDense
from lava.proc.lif.process import LIFReset
from lava.utils.weightutils import SignMode

from lava_vpr.loihi import TRACE_LIMIT
from lava_vpr.processes.base.library_parts import relays, reset_each
from lava_vpr.processes.base.wiring import wire
from lava_vpr.processes.networks.library_learning_network.process import LibraryLearningNetwork


@implements(proc=LibraryLearningNetwork, protocol=LoihiProtocol)
@tag("fixed_pt")
class SubLibraryLearningNetwork(AbstractSubProcessModel):
    """Input spikes go to exc by synapses that its spikes change, exc to inh, one to one, and inh to all other exc."""

    def __init__(self, proc: LibraryLearningNetwork) -> None:
        learning, n = proc.learning, len(proc.start_weights)
        lif, rule, (_, exponent) = learning.neurons, learning.rule, proc.lateral
        # Impulses saturate at 127: every spike sets its trace to that.
        stdp = Loihi2FLearningRule(
            dw=rule.microcode(), x1_impulse=TRACE_LIMIT, x1_tau=rule.tau, t_epoch=1, rng_seed=proc.rng_seed
        )
        self.plastic = LearningDense(
            weights=proc.start_weights,
            learning_rule=stdp,
            weight_exp=-learning.shift,
            sign_mode=SignMode.EXCITATORY,
        )
        self.exc = LIFReset(shape=(n,), du=lif.du, dv=lif.dv, vth=proc.threshold, **reset_each(proc.interval))
        self.relay, self.inh = relays(n, proc.interval)
        self.inhibit = Dense(weights=proc.vars.lateral_weights.init, weight_exp=exponent, sign_mode=SignMode.INHIBITORY)
        wire(proc, self.plastic, self.exc, self.relay, self.inh, self.inhibit)
        self.exc.s_out.connect(self.plastic.s_in_bap)
        proc.vars.x1.alias(self.plastic.x1)
        proc.vars.lateral_weights.alias(self.inhibit.weights)
