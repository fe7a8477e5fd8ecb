"""The inference network as one hierarchical Process of this project's own Processes."""

from __future__ import annotations

from typing import Any

from lava.magma.core.process.ports.ports import InPort, OutPort
from lava.magma.core.process.variable import Var

from lava_vpr.engine.inference.fixed import SILENT_STEPS, FixedNetwork
from lava_vpr.processes.base.checked import CheckedProcess


class PlaceNetwork(CheckedProcess):
    """`FixedNetwork` composed of DenseSynapses, ExcitatoryLIF, OneToOne, InhibitoryLIF and LateralInhibition.

    Ports: ``s_in`` spikes (inputs,), ``s_out`` spikes of exc (neurons,), ``s_out_inh`` those of inh. Vars: ``weights``
    (neurons, inputs), ``u``, ``v``, ``vth`` of exc and ``v_inh`` (neurons,), ``inhibition`` (1,).
    """

    def __init__(self, *, network: FixedNetwork, **kwargs: Any) -> None:
        """Make the network of the spec ``network``; its models wire the parts.

        Args:
            network: What to run.
        Raises:
            NetworkLimitError: the network could overflow Loihi's registers.
        """
        network.check()
        super().__init__(network=network, **kwargs)
        self.network = network
        shape = (network.neurons,)
        self.s_in = InPort(shape=(network.inputs,))
        self.s_out = OutPort(shape=shape)
        self.s_out_inh = OutPort(shape=shape)
        self.weights = Var(shape=(network.neurons, network.inputs), init=network.stored[0])
        self.u, self.v, self.v_inh = Var(shape=shape), Var(shape=shape), Var(shape=shape)
        self.vth = Var(shape=shape, init=network.threshold)
        self.inhibition = Var(shape=(1,), init=network.lateral)

    @property
    def interval(self) -> int:
        """Steps of one presentation, the silent ones included."""
        return self.network.steps + SILENT_STEPS
