"""What tests/processes/test_processes.py lets a worker call: runs of Lava.

Used by processes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from support.lava.small_networks import limits

from lava_vpr.errors import NetworkLimitError
from lava_vpr.processes.base.magma import Loihi2SimCfg, RunSteps
from lava_vpr.processes.base.shared_memory import shared_array
from lava_vpr.processes.dense_synapses.process import DenseSynapses
from lava_vpr.processes.excitatory_lif.process import ExcitatoryLIF
from lava_vpr.processes.jobs import inference as jobs
from lava_vpr.processes.networks.place_network.process import PlaceNetwork
from lava_vpr.processes.poisson_encoder.process import PoissonEncoder
from lava_vpr.processes.regular_encoder.process import RegularEncoder
from lava_vpr.processes.spike_counter.process import SpikeCounter

Arrays = dict[str, NDArray[Any]]
FIXED = {"select_tag": "fixed_pt"}
SIDES = {"place": FIXED, "library": {**FIXED, "select_sub_proc_model": True}}
"""How Lava is run: this project's models, or those of its library in their place."""


def side_by_side(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Our models and the library's, network after network; the rasters of both.

    Option ``limits``: what `small_networks.limits` takes.
    """
    results: Arrays = {}
    for name, own in options["networks"].items():
        given = {key: arrays[f"{name}_{key}"] for key in ("weights", "bias", "rates", "keys")}
        with limits(**options.get("limits", {})):
            results |= {f"{name}_{key}": raster for key, raster in _both(given, own).items()}
    return results


def _both(given: Arrays, own: dict[str, Any]) -> Arrays:
    """The rasters of exc and inh of one network, ours and the library's."""
    results: Arrays = {}
    spec = jobs.network_of(given, own)
    kind = RegularEncoder if spec.regular else PoissonEncoder
    n = len(given["keys"])
    for side, config in SIDES.items():
        encoder = kind(rates=given["rates"], keys=given["keys"], steps=spec.steps, silent_steps=spec.silent_steps)
        network = PlaceNetwork(network=spec)
        encoder.s_out.connect(network.s_in)
        for part, port in (("exc", network.s_out), ("inh", network.s_out_inh)):
            raster = results[f"{side}_{part}"] = shared_array((n, network.interval, *port.shape), np.uint8)
            counter = SpikeCounter(shape=port.shape, presentations=n, interval=network.interval, raster=raster)
            port.connect(counter.s_in)
        encoder.run(condition=RunSteps(num_steps=n * spec.interval), run_cfg=Loihi2SimCfg(**config))
        encoder.stop()
    return results


def every_job(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """The jobs and tags of ``options["runs"]``, one after the other; ``limits`` as in `side_by_side`."""
    results: Arrays = {}
    with limits(**options.get("limits", {})):
        for job, tag in options["runs"]:
            got = getattr(jobs, job)(arrays, {**options["network"], "tag": tag, "record": True})
            results |= {f"{job}_{tag}_{key}": value for key, value in got.items()}
    return results


def _refusal(call: Any) -> str:
    try:
        call()
    except NetworkLimitError as error:
        return str(error)
    return ""


def read_and_set(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Vars between two runs of a network whose neurons have thresholds of their own."""
    weights, vth = arrays["weights"], arrays["vth"]
    n = len(vth)
    encoder = PoissonEncoder(rates=arrays["rates"], keys=arrays["keys"], steps=options["steps"], silent_steps=0)
    synapses = DenseSynapses(weights=weights)
    neurons = ExcitatoryLIF(shape=(n,), dv=137, vth=vth, theta_plus=3, hold_steps=2, floor=-50)
    counter = SpikeCounter(shape=(n,), presentations=2, interval=options["steps"])
    encoder.s_out.connect(synapses.s_in)
    synapses.a_out.connect(neurons.a_in)
    neurons.s_out.connect(counter.s_in)
    step = {"condition": RunSteps(num_steps=options["steps"]), "run_cfg": Loihi2SimCfg(**FIXED)}
    encoder.run(**step)
    names = ("u", "v", "vth", "held", "bias_mant", "bias_exp", "du", "dv", "floor", "hold_steps", "theta_plus")
    results = {name: np.asarray(getattr(neurons, name).get()) for name in names}
    results["counts"], results["emitted"] = counter.counts.get(), encoder.emitted.get()
    texts = [
        _refusal(lambda: neurons.vth.set(np.full(n, 1 << 17))),
        _refusal(lambda: neurons.v.set(np.full(n, 1 << 23))),
        _refusal(lambda: synapses.weights.set(np.full(weights.shape, 256))),
    ]
    neurons.vth.set(np.full(n, 131071))
    neurons.v.set(np.zeros(n))
    synapses.weights.set(weights[:, ::-1].copy())
    results["weights"] = synapses.weights.get()
    encoder.run(**step)
    results["counts_after"], results["vth_after"] = counter.counts.get(), neurons.vth.get()
    encoder.stop()
    return results | {"texts": np.array(texts)}


def aliases(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """The Vars of the network after a run of either kind, and what is said of one that the library does not change."""
    spec = jobs.network_of(arrays, options)
    results: Arrays = {}
    for side, config in SIDES.items():
        encoder = PoissonEncoder(
            rates=arrays["rates"], keys=arrays["keys"], steps=spec.steps, silent_steps=spec.silent_steps
        )
        network = PlaceNetwork(network=spec)
        encoder.s_out.connect(network.s_in)
        network.run(condition=RunSteps(num_steps=spec.steps), run_cfg=Loihi2SimCfg(**config))
        results |= {
            f"{side}_{name}": getattr(network, name).get()
            for name in ("weights", "u", "v", "v_inh", "vth", "lateral_weights", "bias_mant", "bias_exp")
        }
        results[f"{side}_refusal"] = np.array(_refusal(lambda: network.vth.set(np.full(spec.neurons, 9))))  # noqa: B023
        network.stop()
    return results


def out_of_range(vth: float, weight: float, tag: str) -> str:
    """The refusal, or nothing, of a run with floats, which are fine for the floating-point models."""
    neurons = ExcitatoryLIF(shape=(3,), dv=137.0, vth=vth)
    synapses = DenseSynapses(weights=np.full((3, 3), weight))
    neurons.s_out.connect(synapses.s_in)
    synapses.a_out.connect(neurons.a_in)
    text = _refusal(lambda: neurons.run(condition=RunSteps(num_steps=3), run_cfg=Loihi2SimCfg(select_tag=tag)))
    neurons.stop()
    return text


def small_runs(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """All of the above in turn."""

    def part(prefix: str) -> Arrays:
        return {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}

    results = {f"vars_{name}": value for name, value in read_and_set(part("vars_"), options).items()}
    results |= aliases(part("whole_"), options["network"])
    cases = ((10.5, 0.5, "floating_pt"), (10.5, 1.0, "fixed_pt"), (10.0, 0.5, "fixed_pt"))
    return results | {"refusals": np.array([out_of_range(*case) for case in cases])}
