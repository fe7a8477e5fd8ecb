"""What a child process runs for test_fuzz.py: random networks in Lava, by our Processes and by its library.

Used by engine.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from lava.magma.core.run_conditions import RunSteps
from lava.magma.core.run_configs import Loihi2SimCfg
from lava.proc.dense.process import Dense
from lava.proc.io.source import RingBuffer
from lava.proc.lif.process import LIF
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray
from scipy.linalg import block_diag
from support.fuzz.fuzz_networks import (
    KINDS,
    SILENT,
    Block,
    Format,
    block_of,
    fused_of,
    input_of,
    place_of,
    settings_of,
    steps_of,
)

from lava_vpr.processes.base.shared_memory import shared_array
from lava_vpr.processes.encoders.process import PoissonEncoder, RegularEncoder
from lava_vpr.processes.lif.process import ExcitatoryLIF
from lava_vpr.processes.networks.process import FusedPlaceNetwork, PlaceNetwork
from lava_vpr.processes.spike_counter.process import SpikeCounter
from lava_vpr.processes.synapses.process import DenseSynapses

Arrays = dict[str, NDArray[Any]]
CONFIG = {"select_tag": "fixed_pt"}


def _dense(kind: str, weights: NDArray[Any], form: Format) -> Any:
    given = {"weights": weights, "num_weight_bits": form.bits, "weight_exp": form.exponent}
    if kind == "ours":
        return DenseSynapses(**given, sign_mode=form.sign)
    return Dense(**given, sign_mode=SignMode[form.sign.upper()])


def _counted(port: Any, presentations: int, interval: int) -> NDArray[np.uint8]:
    """The raster, uint8 (presentations, interval, neurons), that the spikes from ``port`` will fill."""
    raster = shared_array((presentations, interval, *port.shape), np.uint8)
    counter = SpikeCounter(shape=port.shape, presentations=presentations, interval=interval, raster=raster)
    port.connect(counter.s_in)
    return raster


def _wire(source: Any, first: int, seed: int, group: int, blocks: Sequence[Block], kind: str) -> Any:
    """A group's population, fed by the inputs of ``source`` from ``first`` on and by itself, block by block."""
    own, populations = settings_of(seed, group), [block.network.populations[0] for block in blocks]
    mantissa, exponent = (np.concatenate([getattr(p, name) for p in populations]) for name in ("bias_mant", "bias_exp"))
    make = ExcitatoryLIF if kind == "ours" else LIF
    lif = make(shape=mantissa.shape, du=own.du, dv=own.dv, vth=own.vth, bias_mant=mantissa, bias_exp=exponent)
    synapses = [block.network.synapses for block in blocks]
    forward, back = (block_diag(*(pair[i].weights.T for pair in synapses)) for i in (0, 1))
    forward = np.pad(forward, ((0, 0), (first, source.s_out.shape[0] - first - forward.shape[1])))
    feed, loop = _dense(kind, forward, own.forward), _dense(kind, back, own.back)
    source.s_out.connect(feed.s_in)
    feed.a_out.connect(lif.a_in)
    lif.s_out.connect(loop.s_in)
    loop.a_out.connect(lif.a_in)
    return lif


def _start_groups(seed: int, chosen: dict[int, Sequence[int]]) -> Arrays:
    """One start of Lava. All groups hang on one source: Lava runs what hangs together."""
    blocks = {group: [block_of(seed, group, block) for block in own] for group, own in chosen.items()}
    looks = steps_of(seed, min(chosen))
    trains = np.concatenate([block.train.T for own in blocks.values() for block in own])
    source = RingBuffer(data=trains.astype(np.int32))
    wired, first = {}, 0
    for group, own in blocks.items():
        for kind in KINDS:
            wired[f"{group}_{kind}"] = _wire(source, first, seed, group, own, kind)
        first += sum(block.network.inputs for block in own)
    rasters = {f"{name}_spikes": _counted(lif.s_out, 1, looks[-1])[0] for name, lif in wired.items()}
    states: dict[str, list[NDArray[Any]]] = {f"{name}_{state}": [] for name in wired for state in ("u", "v")}
    for steps in np.diff([0, *looks]):
        source.run(condition=RunSteps(num_steps=int(steps)), run_cfg=Loihi2SimCfg(**CONFIG))
        for name, lif in wired.items():
            states[f"{name}_u"].append(lif.u.get())
            states[f"{name}_v"].append(lif.v.get())
    source.stop()
    return rasters | {name: np.array(looked) for name, looked in states.items()}


def groups(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Run general networks of `fuzz_networks`.

    Args:
        arrays: None.
        options: ``seed``; ``starts``: for each start of Lava its groups as [group, [block, ...]].
    Returns:
        For each group G and kind K: G_K_spikes (steps, neurons), G_K_u and G_K_v (looks, neurons), as `steps_of` says.
    """
    results: Arrays = {}
    for start in options["starts"]:
        results |= _start_groups(options["seed"], dict(start))
    return results


def _start_places(seed: int, start: int, numbers: Sequence[int]) -> Arrays:
    """Networks of our models, of the library's, and a fused one, each in a start of Lava of its own."""
    given, networks = input_of(seed, start), {number: place_of(seed, start, number) for number in numbers}
    kind = RegularEncoder if given.regular else PoissonEncoder
    n, interval = len(given.keys), given.steps + SILENT
    results: Arrays = {}
    for side in KINDS:
        encoder = kind(rates=given.rates, keys=given.keys, steps=given.steps, silent_steps=SILENT)
        wired = {f"{start}_{number}_{side}": PlaceNetwork(network=network) for number, network in networks.items()}
        for name, place in wired.items():
            encoder.s_out.connect(place.s_in)
            results[f"{name}_spikes"] = _counted(place.s_out, n, interval)
        config = Loihi2SimCfg(**CONFIG, select_sub_proc_model=side == "library")
        encoder.run(condition=RunSteps(num_steps=n * interval), run_cfg=config)
        for name, place in wired.items():
            results |= {f"{name}_u": place.u.get(), f"{name}_v": place.v.get()}
        encoder.stop()
    network = networks[fused_of(start, numbers)]
    raster = results[f"{start}_fused_spikes"] = shared_array((n, interval, network.neurons), np.uint8)
    fused = FusedPlaceNetwork(network=network, rates=given.rates, keys=given.keys, batch=2, raster=raster)
    fused.run(condition=RunSteps(num_steps=fused.batches), run_cfg=Loihi2SimCfg(**CONFIG))
    fused.stop()
    return results


def places(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Run place networks of `fuzz_networks`, those too that would be refused because they can wrap.

    Args:
        arrays: None.
        options: ``seed``; ``starts``: as [start, [network, ...]].
    Returns:
        For each start S, network N and kind K (ours, library): S_N_K_spikes (presentations, steps + 3, neurons), and
        S_N_K_u and S_N_K_v (neurons,) of exc after the last step; S_fused_spikes of the network `fused_of`.
    """
    results: Arrays = {}
    for start, numbers in options["starts"]:
        results |= _start_places(options["seed"], start, numbers)
    return results
