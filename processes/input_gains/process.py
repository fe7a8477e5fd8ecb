"""The gains of inputs, between what makes activity and the host that makes rates of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import diags

from lava_vpr.engine.gains import DIGIT_BITS, GAIN_BITS
from lava_vpr.engine.general.lif import need
from lava_vpr.loihi import INPUT_SHIFT, THRESHOLD_LIMIT, WEIGHT_BITS
from lava_vpr.processes.base.magma import (
    AbstractSubProcessModel,
    CheckedProcess,
    InPort,
    LoihiProtocol,
    Var,
    check_shape,
    implements,
    require,
    whole,
)
from lava_vpr.processes.lif.process import ExcitatoryLIF
from lava_vpr.processes.sparse_synapses.process import SparseSynapses


class InputGains(CheckedProcess):
    """Each input's gain is a synapse to a neuron of its own, which adds up what the input sends and never spikes.

    Inputs send spikes, as the cells of a spiking front end do, or whole numbers (`lava_vpr.engine.gains.digits_of`). A
    run that prefers SubProcessModels uses Lava's LIFReset and Sparse. A neuron holds up to 131,071: what an input sends
    in a presentation must add up to at most 8,738. What is sent in a presentation's last step is lost.

    Port: ``s_in`` (inputs,). Var: ``v`` (inputs,), 64 times as large in the integer model.
    """

    def __init__(self, *, gains: NDArray[np.uint8], interval: int, **kwargs: Any) -> None:
        """Make the synapses and neurons of these gains.

        Args:
            gains: One for each input, whole numbers 0..15 (inputs,).
            interval: Steps of a presentation, at least 2: neurons begin each at 0.
        Raises:
            NetworkLimitError: gains or an interval out of their range.
        """
        shape = (check_shape("InputGains: gains", np.shape(gains)),)
        most = (1 << GAIN_BITS) - 1
        require("InputGains: a gain", gains, whole(gains) & (gains >= 0) & (gains <= most), f"whole, in 0..{most}")
        need(whole(interval) and interval >= 2, "InputGains: interval", interval, "a whole number, at least 2")
        super().__init__(gains=gains, interval=int(interval), **kwargs)
        self.s_in = InPort(shape=shape)
        self.v = Var(shape=shape, init=0)

    def gained(self, floating: bool = False) -> NDArray[np.int64]:
        """What each input sent, times its gain, while the run pauses after a presentation's last step, int64 (inputs,).

        Args:
            floating: The run is of floating-point models.
        """
        return np.asarray(self.v.get()).astype(np.int64) >> (0 if floating else INPUT_SHIFT)


@implements(proc=InputGains, protocol=LoihiProtocol)
class SubInputGains(AbstractSubProcessModel):
    """Synapses on the diagonal, stored in the bits of a gain, and neurons that keep what they add up."""

    def __init__(self, proc: InputGains) -> None:
        gains, (n,), spare = proc.proc_params["gains"], proc.s_in.shape, WEIGHT_BITS - GAIN_BITS
        self.synapses = SparseSynapses(
            weights=diags(gains.astype(np.int32) << spare, format="csr"),
            num_weight_bits=GAIN_BITS,
            weight_exp=-spare,
            num_message_bits=DIGIT_BITS,
        )
        self.neurons = ExcitatoryLIF(
            shape=(n,), dv=0, vth=THRESHOLD_LIMIT - 1, reset_interval=proc.proc_params["interval"]
        )
        proc.s_in.connect(self.synapses.s_in)
        self.synapses.a_out.connect(self.neurons.a_in)
        proc.v.alias(self.neurons.v)
