"""What tests/processes let a worker call: runs of Lava, small ones, and Lava's own resolution under `Loihi2HwCfg`.

Used by processes and support."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from lava.magma.compiler.compiler_graphs import ProcGroupDiGraphs
from lava.magma.core.process.ports.ports import InPort, OutPort
from lava.proc.io.source import RingBuffer
from numpy.typing import NDArray
from scipy.sparse import identity
from support.lava.small_networks import SMALL_LIMITS, limits, part, random_network

from lava_vpr.engine.gains import FULL, Digits
from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.learning.integer import IntegerLearning, WeightRule
from lava_vpr.engine.learning.stdp import PlasticState
from lava_vpr.engine.rates import rates16
from lava_vpr.errors import BackendUnavailableError, NetworkLimitError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.processes.base.magma import AbstractProcess, Loihi2HwCfg, Loihi2SimCfg, RunSteps
from lava_vpr.processes.base.shared_memory import shared_array
from lava_vpr.processes.encoders.process import BiasInputs, PoissonEncoder, RegularEncoder
from lava_vpr.processes.front_end.process import FrontEndNetwork
from lava_vpr.processes.input_gains.process import InputGains
from lava_vpr.processes.jobs import gains as gain_jobs, inference as jobs
from lava_vpr.processes.lif.process import ExcitatoryLIF, InhibitoryLIF
from lava_vpr.processes.networks.process import FusedPlaceNetwork, LearningPlaceNetwork, PlaceNetwork
from lava_vpr.processes.plastic_dense.process import PlasticDense
from lava_vpr.processes.sparse_synapses.process import SparseSynapses
from lava_vpr.processes.spike_counter.process import SpikeCounter
from lava_vpr.processes.synapses.process import DenseSynapses, OneToOne

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


RULE = WeightRule(((6, -6), (1, -7)), 15, 0, 20.0)
SHOWN: dict[str, Any] = {"rates": np.full((2, 5), 9000, np.uint16), "keys": np.arange(2, dtype=np.uint64)}
PRESENTED: dict[str, Any] = {**SHOWN, "steps": 13, "silent_steps": 3}


def _learning() -> AbstractProcess:
    phase = IntegerLearning(rule=RULE, inhibition=240, neurons=LifParameters(dv=205), steps=13, weight_sum=0)
    state = PlasticState(np.full((5, 3), 20, np.uint8), np.full(3, 480, np.int32))
    return LearningPlaceNetwork(learning=phase, state=state, keys=SHOWN["keys"][:1], rng_seed=1)


def _fused() -> AbstractProcess:
    network = random_network(3)
    rates = np.zeros((2, network.inputs), np.uint16)
    return FusedPlaceNetwork(network=network, rates=rates, keys=SHOWN["keys"])


MADE: dict[str, Callable[[], AbstractProcess]] = {
    "BiasInputs": lambda: BiasInputs(**PRESENTED),
    "DenseSynapses": lambda: DenseSynapses(weights=np.ones((3, 5), int)),
    "DenseSynapses, sparse": lambda: DenseSynapses(weights=np.eye(3, 5, dtype=int), sparse=True),
    "ExcitatoryLIF": lambda: ExcitatoryLIF(shape=(3,), dv=137, vth=80, reset_interval=16),
    "ExcitatoryLIF, never reset": lambda: ExcitatoryLIF(shape=(3,), dv=137, vth=80),
    "InhibitoryLIF": lambda: InhibitoryLIF(shape=(3,), reset_interval=16),
    "OneToOne": lambda: OneToOne(shape=(3,), weight=2),
    "SparseSynapses": lambda: SparseSynapses(weights=identity(3, int, "csr")),
    "PlasticDense": lambda: PlasticDense(weights=np.ones((3, 5), int), rule=RULE, rng_seed=1),
    "PlaceNetwork": lambda: PlaceNetwork(network=random_network(3, signed=True)),
    "PlaceNetwork, leaves and relays": lambda: PlaceNetwork(network=random_network(3, signed=True, regular=True)),
    "LearningPlaceNetwork": _learning,
    "FrontEndNetwork": lambda: FrontEndNetwork(spec=FrontEnd(8), grey=np.zeros((1, 4, 8), np.uint8)),
    "InputGains": lambda: InputGains(gains=np.arange(5), interval=2),
    "PoissonEncoder": lambda: PoissonEncoder(**PRESENTED),
    "RegularEncoder": lambda: RegularEncoder(**PRESENTED),
    "SpikeCounter": lambda: SpikeCounter(shape=(3,), presentations=2, interval=16),
    "FusedPlaceNetwork": _fused,
}
"""A Process of each kind, by its name; more than one where its parameters decide what stands for it."""


def _place(model: type[Any]) -> str:
    """Where a ProcessModel runs, by the classes that Lava's own configurations ask about."""
    from lava.magma.core.model.c.model import AbstractCProcessModel
    from lava.magma.core.model.nc.model import AbstractNcProcessModel
    from lava.magma.core.model.py.model import AbstractPyProcessModel

    kinds = {"chip": AbstractNcProcessModel, "embedded": AbstractCProcessModel, "CPU": AbstractPyProcessModel}
    return next(place for place, kind in kinds.items() if issubclass(model, kind))


def resolved(arrays: Mapping[str, Any], options: Mapping[str, Any]) -> Arrays:
    """What `Loihi2HwCfg` selects for each of `MADE`, as the compiler asks it: recursively through SubProcessModels.

    Options: ``names``; ``sub``: with ``select_sub_proc_model``.
    Returns:
        ``rows`` (n, 5): the Process of this project, its model, the Process that is left when SubProcessModels are
        resolved, its model, and where that runs.
    """
    rows = []
    for name in options["names"]:
        with limits(**(SMALL_LIMITS if "leaves" in name else {})):
            process, seen = MADE[name](), []
            run_cfg = Loihi2HwCfg(select_sub_proc_model=options["sub"])
            leaves = ProcGroupDiGraphs._map_proc_to_model([process], run_cfg, seen)
        for leaf, model in leaves.items():
            own = model if leaf is process else process._model_class
            rows.append((name, own.__name__, f"{type(leaf).__module__}.{type(leaf).__name__}", model.__name__))
            rows[-1] += (_place(model),)
    return {"rows": np.array(rows)}


def compiled(arrays: Mapping[str, Any], options: Mapping[str, Any]) -> Arrays:
    """A whole network for a board, compiled by Lava: every Process that is left, its model, and where that runs.

    Options: those of the network; with ``bias_input`` inputs stand on the chip.
    """
    spec = random_network(3, signed=True, regular=True, steps=32 - 3, **options)
    rates = np.full((2, spec.inputs), 9000, np.uint16)
    found: list[AbstractProcess] = []
    refuse = jobs.refuse_cpu_models

    class Compiled(Exception):
        """Lava has compiled the network; nothing is run."""

    def look(*given: Any) -> Any:
        found.extend(refuse(*given).process_list)
        raise Compiled

    jobs.refuse_cpu_models = look
    try:
        given = {"weights": spec.weights, "bias": spec.bias, "rates": rates, "keys": SHOWN["keys"]}
        jobs.library(given, {**spec.scalars, "board": True})
    except Compiled:
        pass
    finally:
        jobs.refuse_cpu_models = refuse
    rows = [(type(part).__name__, part.model_class.__name__, _place(part.model_class)) for part in found]
    return {"rows": np.array(sorted(rows))}


def refused(arrays: Mapping[str, Any], options: Mapping[str, Any]) -> Arrays:
    """What `refuse_cpu_models` says of neurons for which SubProcessModels were not asked for."""
    try:
        jobs.refuse_cpu_models(MADE["InhibitoryLIF"](), Loihi2HwCfg())
    except BackendUnavailableError as error:
        return {"rows": np.array([[str(error)]])}
    return {"rows": np.array([[]])}


def selected_in_simulation(arrays: Mapping[str, Any], options: Mapping[str, Any]) -> Arrays:
    """What `Loihi2SimCfg` selects for each of ``names``, by tag and with SubProcessModels or without: their names."""
    rows = []
    for name in options["names"]:
        for tag in ("fixed_pt", "floating_pt"):
            for sub in (False, True):
                process = MADE[name]()
                models = ProcGroupDiGraphs._find_proc_models(process)
                config = Loihi2SimCfg(select_tag=tag, select_sub_proc_model=sub)
                model = config.select(process, models)
                rows.append((name, tag, str(sub), model.__name__, " ".join(model.tags)))
    return {"rows": np.array(rows)}


def plastic(arrays: Mapping[str, NDArray[Any]], options: Mapping[str, Any]) -> Arrays:
    """One PlasticDense between spikes from files, by our model or the library's: sums, weights and traces.

    Args:
        arrays: ``pre`` (steps, inputs) and ``post`` (steps, neurons) spikes, ``weights`` (neurons, inputs).
        options: ``sub``; ``weight_exp``; ``rng_seed``; ``tag``.
    """
    pre, post = (RingBuffer(data=arrays[name].astype(np.int32).T) for name in ("pre", "post"))
    synapses = PlasticDense(
        weights=arrays["weights"], rule=RULE, weight_exp=options["weight_exp"], rng_seed=options["rng_seed"]
    )
    steps, neurons = arrays["post"].shape
    exc = ExcitatoryLIF(shape=(neurons,), dv=100, vth=60)
    raster = shared_array((1, steps, neurons), np.uint8)
    counter = SpikeCounter(shape=(neurons,), presentations=1, interval=steps, raster=raster)
    pre.s_out.connect(synapses.s_in)
    post.s_out.connect(synapses.s_in_post)
    synapses.a_out.connect(exc.a_in)
    exc.s_out.connect(counter.s_in)
    config = Loihi2SimCfg(select_tag=options["tag"], select_sub_proc_model=options["sub"])
    try:
        pre.run(condition=RunSteps(num_steps=steps), run_cfg=config)
        return {"raster": raster[0], "weights": synapses.weights.get(), "x1": synapses.x1.get()}
    finally:
        pre.stop()
