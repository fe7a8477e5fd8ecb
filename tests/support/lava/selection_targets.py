"""What tests/processes/test_selection.py lets a worker call: Lava's own resolution under `Loihi2HwCfg`, and small runs.

Used by processes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from lava.magma.compiler.compiler_graphs import ProcGroupDiGraphs
from lava.proc.io.source import RingBuffer
from numpy.typing import NDArray
from scipy.sparse import identity
from support.lava.small_networks import SMALL_LIMITS, limits, random_network

from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.learning.integer import IntegerLearning, WeightRule
from lava_vpr.engine.learning.stdp import PlasticState
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.processes.base.magma import AbstractProcess, Loihi2HwCfg, Loihi2SimCfg, RunSteps
from lava_vpr.processes.base.shared_memory import shared_array
from lava_vpr.processes.encoders.process import BiasInputs, PoissonEncoder, RegularEncoder
from lava_vpr.processes.front_end.process import FrontEndNetwork
from lava_vpr.processes.input_gains.process import InputGains
from lava_vpr.processes.jobs import inference as jobs
from lava_vpr.processes.lif.process import ExcitatoryLIF, InhibitoryLIF
from lava_vpr.processes.networks.process import FusedPlaceNetwork, LearningPlaceNetwork, PlaceNetwork
from lava_vpr.processes.plastic_dense.process import PlasticDense
from lava_vpr.processes.sparse_synapses.process import SparseSynapses
from lava_vpr.processes.spike_counter.process import SpikeCounter
from lava_vpr.processes.synapses.process import DenseSynapses, OneToOne

Arrays = dict[str, NDArray[Any]]
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
