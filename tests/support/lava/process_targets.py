"""What test_processes.py and test_bias_inputs.py of tests/processes let a worker call: runs of Lava.

Used by processes and support.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.magma.core.process.ports.ports import InPort, OutPort
from numpy.typing import NDArray
from support.lava.small_networks import limits, part

from lava_vpr.encoding import rates16
from lava_vpr.engine.gains import FULL, Digits
from lava_vpr.errors import NetworkLimitError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.processes.base.magma import Loihi2SimCfg, RunSteps
from lava_vpr.processes.encoders.process import BiasInputs, PoissonEncoder
from lava_vpr.processes.front_end.process import FrontEndNetwork
from lava_vpr.processes.input_gains.process import InputGains
from lava_vpr.processes.jobs import gains as gain_jobs, inference as jobs
from lava_vpr.processes.lif.process import ExcitatoryLIF
from lava_vpr.processes.networks.process import PlaceNetwork
from lava_vpr.processes.spike_counter.process import SpikeCounter
from lava_vpr.processes.synapses.process import DenseSynapses

Arrays = dict[str, NDArray[Any]]
FIXED = {"select_tag": "fixed_pt"}
SIDES = {"place": FIXED, "library": {**FIXED, "select_sub_proc_model": True}}
"""How Lava is run: this project's models, or those of its library in their place."""


def networks(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Every network of ``options["networks"]`` in its ``options["runs"]``, pairs of job and tag; with rasters.

    Options ``limits``: what `small_networks.limits` takes; ``board``: a network that is also run `_as_on_a_board`.
    """
    results: Arrays = {}
    with limits(**options["limits"]):
        for name, own in options["networks"].items():
            for job, tag in options["runs"][name]:
                given = part(arrays, name)
                gained = _under_gains(given, job, tag) if "digits" in given and job != "fused" else {}
                got = getattr(jobs, job)(given | gained, {**own, "tag": tag, "record": True})
                results |= _named(f"{name}_{job}_{tag}", got | gained)
    board = options.get("board")
    return results | (_as_on_a_board(part(arrays, board), options["networks"][board]) if board else {})


def _under_gains(given: Arrays, job: str, tag: str) -> Arrays:
    """Rates of a `small_networks.random_drive`, and the products in Lava that they follow from."""
    gained = getattr(gain_jobs, job)(given, {"tag": tag})["gained"]
    activity = Digits(given["digits"], given["exponents"]).activity(gained)
    lessened, rates = (given["gains"][given["epoch"]] < FULL).any(axis=1), given["plain"].copy()
    rates[lessened] = rates16(activity[lessened], *given["encoder"].tolist())
    return {"rates": rates, "gained": gained}


def _named(name: str, results: Arrays) -> Arrays:
    """``results``, their names begun with ``name``."""
    return {f"{name}_{key}": value for key, value in results.items()}


def _as_on_a_board(given: Arrays, own: dict[str, Any]) -> Arrays:
    """A network of the library's, wired as for a board but simulated; which ports would have crossed adapters."""
    crossed: list[str] = []
    across, begin, written = jobs.across, jobs.begin, BiasInputs.write
    calls: list[int] = []

    def direct(source: OutPort, target: InPort, adapter: str | None) -> None:
        crossed.append(f"{type(source.process).__name__}.{source.name} {adapter}")
        across(source, target, None)

    def write(self: BiasInputs, presentation: int) -> None:
        written(self, presentation)
        calls.append(self.sent)

    given["rates"][1] = given["rates"][0]  # nothing but v differs, so nothing else is written
    jobs.across, jobs.begin = direct, lambda process, way: begin(process, way._replace(board=False))
    BiasInputs.write = write  # type: ignore[method-assign]
    try:
        results = _named("board", jobs.library(given, {**own, "tag": "fixed_pt", "board": True}))
    finally:
        jobs.across, jobs.begin = across, begin
        BiasInputs.write = written  # type: ignore[method-assign]
    return results | {"crossed": np.array(crossed), "writes": np.diff(calls, prepend=0)}


def front_end_under_gains(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """What neurons behind the cells of a front end hold after each image, int64 (n, cells), by their gains."""
    grey, library = arrays["grey"], bool(options["library"])
    spec = FrontEnd(**{name: tuple(x) if isinstance(x, list) else x for name, x in options["spec"].items()})
    network = FrontEndNetwork(spec=spec, grey=grey[:1] if library else grey)
    product, gained = InputGains(gains=arrays["gains"], interval=spec.steps), []
    network.cells.connect(product.s_in)
    config = Loihi2SimCfg(**SIDES["library" if library else "place"])
    for number in range(len(grey)):
        if library and number:
            network.write(grey[number])
        network.run(condition=RunSteps(num_steps=spec.steps), run_cfg=config)
        gained.append(product.gained())
    network.stop()
    return {"gained": np.array(gained)}


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
    results = _named("vars", read_and_set(part(arrays, "vars"), options))
    results |= aliases(part(arrays, "whole"), options["network"])
    cases = ((10.5, 0.5, "floating_pt"), (10.5, 1.0, "fixed_pt"), (10.0, 0.5, "fixed_pt"))
    return results | {"refusals": np.array([out_of_range(*case) for case in cases])}
