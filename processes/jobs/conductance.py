"""The ``paper`` preset's network run by Lava, as jobs for `lava_vpr.isolated.runner.run_isolated`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.configfile import from_dict
from lava_vpr.engine.conductance.kernels import Constants
from lava_vpr.engine.conductance.model import ConductanceState, constants
from lava_vpr.engine.rates import draw_spikes
from lava_vpr.isolated.worker import report
from lava_vpr.processes.base.magma import Loihi2SimCfg, RunSteps
from lava_vpr.processes.base.shared_memory import shared_array
from lava_vpr.processes.conductance.conductance_place_network.process import ConductancePlaceNetwork
from lava_vpr.processes.encoders.process import FinePoissonEncoder
from lava_vpr.processes.spike_counter.process import SpikeCounter


def _delivered(delays: NDArray[np.integer], spikes: NDArray[np.bool_], total: int) -> int:
    """Synapses (inputs, neurons) that input ``spikes`` (steps, inputs) reach before a presentation ends."""
    when, source = np.nonzero(spikes)
    return int((when[:, None] + delays[source].astype(np.int64) < total).sum())


def _events(
    state: ConductanceState, rates: NDArray[np.uint32], keys: NDArray[np.uint64], c: Constants, exc: int, inh: int
) -> NDArray[np.int64]:
    """Synaptic operations, input, excitatory and inhibitory spikes of all presentations, int64 (4,)."""
    operations, inputs = exc + inh * (len(state.theta_mv) - 1), 0
    for image_rates, key in zip(rates, keys, strict=True):
        spikes = draw_spikes(image_rates, int(key), c.steps)
        operations += _delivered(state.delays, spikes, c.total)
        inputs += int(spikes.sum())
    return np.array([operations, inputs, exc, inh])


def conductance(arrays: Mapping[str, NDArray[Any]], options: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Show images to the network of Processes, one after another, in steps of ``dt_ms``.

    Args:
        arrays: ``weights`` float64 and ``delays`` uint16 (inputs, neurons), ``theta_mv`` float64 (neurons,), ``rates``
            uint32 (n, inputs), ``keys`` uint64 (n,), as `lava_vpr.engine.conductance.model` takes them.
        options: ``config``: the settings (`lava_vpr.configfile.to_dict`); ``learn``: whether the network learns
            (default: frozen); ``raster``: whether every spike is returned.
    Returns:
        ``counts`` int32 (n, neurons), excitatory spikes in the steps with input, and ``events`` int64 (4,): synaptic
        operations, input, excitatory and inhibitory spikes. With ``raster``: ``raster`` and ``raster_inh`` uint8
        (n, steps, neurons), the rest included. With ``learn``: the final ``weights`` and ``theta_mv``.
    Raises:
        ConfigError, NetworkLimitError: settings of another network, or arrays that do not fit it.
    """
    config, learn, film = from_dict(options["config"]), options.get("learn", False), options.get("raster", False)
    state = ConductanceState(arrays["weights"], arrays["theta_mv"], arrays["delays"])
    rates, keys = arrays["rates"], arrays["keys"]
    c, n, neurons = constants(config, learn=learn), len(rates), len(state.theta_mv)
    network = ConductancePlaceNetwork(state=state, config=config, learn=learn)
    encoder = FinePoissonEncoder(rates=rates, keys=keys, steps=c.steps, silent_steps=c.total - c.steps)
    film_shape = (n, c.total, neurons)
    raster = shared_array(film_shape, np.uint8)
    raster_inh = shared_array(film_shape, np.uint8) if film else None
    counts_inh = shared_array((n, neurons), np.int32)
    counter = SpikeCounter(shape=(neurons,), presentations=n, interval=c.total, raster=raster)
    counter_inh = SpikeCounter(
        shape=(neurons,), presentations=n, interval=c.total, counts=counts_inh, raster=raster_inh
    )
    encoder.s_out.connect(network.s_in)
    network.s_out.connect(counter.s_in)
    network.s_out_inh.connect(counter_inh.s_in)
    results: dict[str, NDArray[Any]] = {}
    run = Loihi2SimCfg(select_tag="floating_pt")
    try:
        for _ in range(n):
            network.run(condition=RunSteps(num_steps=c.total), run_cfg=run)
            report(1)
        if learn:
            results = {"weights": network.weights.get().T, "theta_mv": network.theta.get()}
    finally:
        network.stop()
    results["counts"] = raster[:, : c.steps].sum(axis=1, dtype=np.int32)
    results["events"] = _events(state, rates, keys, c, int(raster.sum(dtype=np.int64)), int(counts_inh.sum()))
    if raster_inh is not None:
        results |= {"raster": raster, "raster_inh": raster_inh}
    return results
