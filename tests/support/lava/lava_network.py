"""The inference network wired from Lava's own library and nothing else, as a job for the runner.

Used by processes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from lava.proc.dense.process import Dense
from lava.proc.io.sink import RingBuffer as Sink
from lava.proc.io.source import RingBuffer as Source
from lava.proc.lif.process import LIFReset
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray

from lava_vpr.processes.base.magma import Loihi2SimCfg, RunSteps


def present_each(
    arrays: Mapping[str, NDArray[Any]], options: Mapping[str, Mapping[str, int]]
) -> dict[str, NDArray[Any]]:
    """`present` of several networks, one after the other: arrays and results by name_what."""
    results = {}
    for name, own in options.items():
        given = {what: arrays[f"{name}_{what}"] for what in ("weights", "mantissas", "spikes")}
        results[name] = present(given, own)["raster"]
    return results


def present(arrays: Mapping[str, NDArray[Any]], options: Mapping[str, int]) -> dict[str, NDArray[Any]]:
    """Present each train of ``spikes`` (n, interval, inputs) in turn; the raster (n, interval, neurons)."""
    weights, spikes = arrays["weights"].astype(np.int64), arrays["spikes"].astype(np.int32)
    bits, signed, vth, lateral, decay = (options[k] for k in ("bits", "signed", "threshold", "inhibition", "decay"))
    n, steps, inputs = spikes.shape
    neurons = weights.shape[1]
    stored = weights.T << (8 - bits)  # num_weight_bits = b zeroes the low 8 - b bits, mixed sign one bit more
    sign = SignMode.MIXED if signed else SignMode.EXCITATORY
    reset = {"reset_interval": steps, "reset_offset": 1}
    bias = {"bias_mant": arrays["mantissas"], "bias_exp": options["bias_exponent"]}
    source = Source(data=spikes.reshape(n * steps, inputs).T)
    excite = Dense(weights=stored, num_weight_bits=bits + signed, weight_exp=bits - 8, sign_mode=sign)
    exc = LIFReset(shape=(neurons,), du=4095, dv=decay, vth=vth, **bias, **reset)
    relay = Dense(weights=np.full((1, neurons), 2), sign_mode=SignMode.EXCITATORY)
    inh = LIFReset(shape=(1,), du=4095, dv=4095, vth=0, **reset)
    inhibit = Dense(
        weights=np.full((neurons, 1), -lateral),
        weight_exp=options["inhibition_exponent"],
        sign_mode=SignMode.INHIBITORY,
    )
    sink = Sink(shape=(neurons,), buffer=n * steps)
    source.s_out.connect(excite.s_in)
    excite.a_out.connect(exc.a_in)
    exc.s_out.connect(relay.s_in)
    relay.a_out.connect(inh.a_in)
    inh.s_out.connect(inhibit.s_in)
    inhibit.a_out.connect(exc.a_in)
    exc.s_out.connect(sink.a_in)
    try:
        exc.run(condition=RunSteps(num_steps=n * steps), run_cfg=Loihi2SimCfg(select_tag="fixed_pt"))
        raster = sink.data.get().T.reshape(n, steps, neurons)
    finally:
        exc.stop()
    return {"raster": raster}
