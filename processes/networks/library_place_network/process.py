"""The inference network as one hierarchical Process of nothing but Lava's own library."""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.process.ports.ports import InPort, OutPort
from lava.magma.core.process.variable import Var
from numpy.typing import NDArray

from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.processes.base.checked import CheckedProcess
from lava_vpr.processes.base.library_parts import bias_vars
from lava_vpr.processes.base.wiring import inhibiting


class LibraryPlaceNetwork(CheckedProcess):
    """`FixedNetwork` wired from Lava's LIFReset, Dense and Sparse, and nothing else; what a board can run.

    Ports and Vars as `lava_vpr.processes.PlaceNetwork`, but ``vth`` is (1,): Lava's LIF has one threshold; where there
    are leaves, ``lateral_weights`` is a sparse matrix. Vars ``bias_mant`` and ``bias_exp`` of exc (neurons,) may be set
    while a run is paused (`write_bias`).
    """

    def __init__(
        self, *, network: FixedNetwork, floating: bool = False, bias: NDArray[np.int32] | None = None, **kwargs: Any
    ) -> None:
        """Make the network that Lava's library can hold of the spec ``network``.

        Args:
            network: What to run.
            floating: Wire it for a run with the tag ``floating_pt``: the library's floating-point models take decays as
                fractions and ignore weight exponents, so one set of parameters cannot serve both.
            bias: Biases to begin with in units of v, int32 (neurons,); None: the network's.
        Raises:
            NetworkLimitError: the network could overflow Loihi's registers.
        """
        network.check()
        super().__init__(network=network, floating=floating, **kwargs)
        self.network, self.floating = network, floating
        self.first_bias = network.bias if bias is None else bias
        shape, inh = (network.neurons,), (network.inhibitory,)
        self.s_in = InPort(shape=(network.inputs,))
        self.s_out = OutPort(shape=shape)
        self.s_out_inh = OutPort(shape=inh)
        self.weights = Var(shape=(network.neurons, network.inputs), init=network.stored[0])
        self.u, self.v, self.v_inh = Var(shape=shape), Var(shape=shape), Var(shape=inh)
        self.vth = Var(shape=(1,), init=network.threshold)
        self.lateral_weights = Var(shape=shape + inh, init=inhibiting(network))
        self.bias_mant, self.bias_exp = Var(shape=shape), Var(shape=shape)

    def write_bias(self, bias: NDArray[np.int32]) -> None:
        """Set the biases, int32 (neurons,) in units of v, while the run is paused, from the next step on."""
        for name, values in bias_vars(bias, self.floating).items():
            getattr(self, name).set(np.broadcast_to(values, bias.shape).copy())

    @property
    def interval(self) -> int:
        """Steps of one presentation, the silent ones included."""
        return self.network.interval
