"""The inference network as one hierarchical Process of nothing but Lava's own library."""

from __future__ import annotations

from typing import Any

from lava.magma.core.process.ports.ports import InPort, OutPort
from lava.magma.core.process.variable import Var

from lava_vpr.engine.inference.fixed import SILENT_STEPS, FixedNetwork
from lava_vpr.processes.base.checked import CheckedProcess


class LibraryPlaceNetwork(CheckedProcess):
    """`FixedNetwork` wired from Lava's LIFReset, Dense and Sparse, and nothing else; what a board can run.

    Ports: ``s_in`` spikes (inputs,), ``s_out`` spikes of exc (neurons,), ``s_out_inh`` those of inh. Vars: ``weights``
    (neurons, inputs), ``u``, ``v`` of exc and ``v_inh`` (neurons,), ``vth`` (1,): Lava's LIF has one threshold.
    """

    def __init__(self, *, network: FixedNetwork, floating: bool = False, **kwargs: Any) -> None:
        """Make the network that Lava's library can hold of the spec ``network``.

        Args:
            network: What to run.
            floating: Wire it for a run with the tag ``floating_pt``: the library's floating-point models take decays as
                fractions and ignore weight exponents, so one set of parameters cannot serve both.
        Raises:
            NetworkLimitError: the network could overflow Loihi's registers.
        """
        network.check()
        super().__init__(network=network, floating=floating, **kwargs)
        self.network, self.floating = network, floating
        shape = (network.neurons,)
        self.s_in = InPort(shape=(network.inputs,))
        self.s_out = OutPort(shape=shape)
        self.s_out_inh = OutPort(shape=shape)
        self.weights = Var(shape=(network.neurons, network.inputs), init=network.stored[0])
        self.u, self.v, self.v_inh = Var(shape=shape), Var(shape=shape), Var(shape=shape)
        self.vth = Var(shape=(1,), init=network.threshold)

    @property
    def interval(self) -> int:
        """Steps of one presentation, the silent ones included."""
        return self.network.steps + SILENT_STEPS
