"""The inference network as one hierarchical Process of this project's own Processes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.biases import bias_registers
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.loihi import INPUT_SHIFT
from lava_vpr.processes.base.magma import AbstractSubProcessModel, LoihiProtocol, Var, implements
from lava_vpr.processes.base.network import NetworkProcess
from lava_vpr.processes.base.neurons import BiasTable
from lava_vpr.processes.base.wiring import RELAY_WEIGHT, gathering, inhibiting, listening, wire
from lava_vpr.processes.lif.process import ExcitatoryLIF, InhibitoryLIF
from lava_vpr.processes.synapses.process import DenseSynapses, OneToOne


class PlaceNetwork(NetworkProcess):
    """`FixedNetwork` composed of DenseSynapses, ExcitatoryLIF and InhibitoryLIF, and OneToOne before relays.

    A run that prefers SubProcessModels puts Lava's LIFReset, Dense and Sparse in their place, and nothing else: what a
    board can run. It takes the biases of one presentation; `write_bias` brings the others between runs.

    Ports: ``s_in`` spikes (inputs,), ``s_out`` spikes of exc (neurons,), ``s_out_inh`` those of inh (inhibitory,): the
    leaves, then the root. Vars: ``weights`` (neurons, inputs), ``u``, ``v``, ``vth`` of exc (neurons,), ``v_inh``
    (inhibitory,), ``lateral_weights`` (neurons, inhibitory), mantissas from inh (columns) to exc (rows), 0 or
    below (with Lava's library and leaves a sparse matrix), ``bias_mant``, ``bias_exp`` of exc (neurons,).
    """

    def __init__(self, *, network: FixedNetwork, bias: NDArray[np.int32] | None = None, **kwargs: Any) -> None:
        """Make the network of the spec ``network``; its models wire the parts.

        Args:
            network: What to run.
            bias: Biases in units of v of each presentation, int32 (n, neurons); None: always the network's.
        Raises:
            NetworkLimitError: the network could overflow Loihi's registers, or they cannot hold the biases.
            InputError: biases of another type or shape.
        """
        network.check()
        if bias is not None:
            network.check_presented(bias, len(bias))
        laterals, interval = inhibiting(network), network.interval
        numbers = {"network": network, "bias": bias, **kwargs}
        super().__init__(network.stored[0], network.threshold, laterals, interval, **numbers)
        self.network, self.bias = network, bias
        self.bias_mant, self.bias_exp = Var(shape=(network.neurons,)), Var(shape=(network.neurons,))

    def write_bias(self, bias: NDArray[np.int32], floating: bool = False) -> None:
        """Set the biases while the run is paused, from the next step on.

        Args:
            bias: In units of v, int32 (neurons,).
            floating: The run is of Lava's own floating-point models, which ignore exponents.
        """
        mantissas, exponent = bias_registers(bias)
        values: dict[str, NDArray[Any]] = {"bias_mant": mantissas, "bias_exp": np.full_like(mantissas, exponent)}
        if floating:
            values = {"bias_mant": bias * 2.0**-INPUT_SHIFT}
        for name, value in values.items():
            getattr(self, name).set(value)


@implements(proc=PlaceNetwork, protocol=LoihiProtocol)
class SubPlaceNetwork(AbstractSubProcessModel):
    """Input spikes go to exc, exc to inh, and inh takes from every exc. Every arrow takes one step."""

    def __init__(self, proc: PlaceNetwork) -> None:
        network, interval = proc.network, proc.interval
        weights, bits, exponent = network.stored
        bias, bias_exponent = network.bias_registers
        self.excite = DenseSynapses(
            weights=weights,
            num_weight_bits=bits,
            weight_exp=exponent,
            sign_mode="mixed" if network.signed else "excitatory",
        )
        self.exc = ExcitatoryLIF(
            shape=(network.neurons,),
            dv=network.decay,
            vth=network.threshold,
            bias_mant=bias,
            bias_exp=bias_exponent,
            reset_interval=interval,
            bias_table=None if proc.bias is None else BiasTable(*bias_registers(proc.bias)),
        )
        sparse = network.leaves > 0
        self.listen = DenseSynapses(weights=listening(network), sparse=sparse)
        self.inh = InhibitoryLIF(shape=(network.inhibitory,), reset_interval=interval)
        self.inhibit = DenseSynapses(
            weights=inhibiting(network),
            weight_exp=network.inhibition_exponent,
            sign_mode="inhibitory",
            sparse=sparse,
        )
        if network.leaves:
            self.gather = DenseSynapses(weights=gathering(network), sparse=True)
        if network.relayed:
            self.forward = OneToOne(shape=(network.inputs,), weight=RELAY_WEIGHT)
            self.relays = InhibitoryLIF(shape=(network.inputs,), reset_interval=interval)
        wire(proc, self)
        proc.vars.bias_mant.alias(self.exc.bias_mant)
        proc.vars.bias_exp.alias(self.exc.bias_exp)
