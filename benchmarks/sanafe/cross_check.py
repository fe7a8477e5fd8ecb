"""The closed form of the cost model beside SANA-FE 2.2.9, on the same network, mapping and spikes.

SANA-FE (Boyle et al., IEEE TCAD 2025, doi 10.1109/TCAD.2025.3537971) lives in an environment of its own, which `make
sanafe` makes, and runs as another process that reads and writes files: it is licensed under GPL-3.0 and is never
imported here. SANA-FE gets the input spikes (or the bias of input compartments) and makes its own exc and inh spikes.

**What SANA-FE counts** (``chip.cpp``, ``pipeline.hpp``, ``models.cpp``, ``schedule.cpp``), and `closed_form` too:

- Access: every mapped neuron in every step, the silent ones too.
- Update: a neuron whose membrane was not 0 after the step before, or to which any synapse delivered in the step
  before, be its weight 0 (dense rows) or the sum of all 0, or that has a bias (`EventCounts.touched`). Whoever spikes
  is updated as well.
- Message: one for each core that a spike goes to, its own included, charged when it is sent. It is received and its
  synapses are looked up in the same step; the sum counts in the next.
- Synaptic operation: every synapse of the row on the target core, zeros of dense rows included.
- Hops: columns and rows between the tiles; none within a tile. Hops take energy, and no time in ``simple``.
- ``simple`` time of a step: the larger of the busiest sender (accesses, updates, spikes and messages sent of a core)
  and the busiest receiver (16 ns a message and its synapses), each found over all cores; then the barrier by the
  number of tiles that hold a neuron: the entry of its table with the largest number that is not above it.
- ``detailed`` time puts single messages on links and queues: hops, waiting receivers and blocked routes count.

SANA-FE has no host: injected spikes come from one more core on tile 0 (`benchmarks.sanafe.worker`), whose neurons are
free and whose messages and hops are charged. It is asked about
the network without its counters (`benchmarks.sanafe.problem`), and knows no static power, clearing or learning.

Both sides sum the same products in another order: differences of about 1e-14 are rounding.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.program import python_of, run_elsewhere
from benchmarks.sanafe.problem import group_name, problem_of, without_counters
from lava_vpr.deploy.boards.constants import CostConstants
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.cost.closed_form import step_microseconds, step_picojoules
from lava_vpr.deploy.cost.events import EventCounts, count_events
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.presentations import Trains
from lava_vpr.errors import InputError
from lava_vpr.storage.writing import temporary_folder

PYTHON = python_of("sanafe")
WORKER = Path(__file__).with_name("worker.py")
TIMEOUT_S = 600.0

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CrossCheck:
    """SANA-FE on the same network, mapping and spikes, beside the closed form; mean over the queries.

    Attributes:
        version: The version of SANA-FE.
        queries: The number of queries that were compared.
        microjoules: Energy by component: (closed form, SANA-FE).
        simple_milliseconds: Time: (closed form, SANA-FE with ``simple`` timing).
        detailed_milliseconds: Time of SANA-FE with ``detailed`` timing: the bound with contention.
        counts: Events by name: (ours, SANA-FE's).
        difference: Largest relative difference of all that was compared: energy by component and time of every query,
            energy and time of every step.
        spikes_differ: Spikes of exc, inh and the inputs' compartments that SANA-FE's own dynamics have elsewhere.
    """

    version: str
    queries: int
    microjoules: dict[str, tuple[float, float]]
    simple_milliseconds: tuple[float, float]
    detailed_milliseconds: float
    counts: dict[str, tuple[float, float]]
    difference: float
    spikes_differ: int


def ask(problem: dict[str, Any], python: Path = PYTHON) -> dict[str, Any]:
    """What SANA-FE makes of ``problem`` (`benchmarks.sanafe.problem`).

    Raises:
        InputError: its environment is missing, or it fails or takes too long.
    """
    with temporary_folder() as folder:
        (folder / "problem.json").write_text(json.dumps(problem))
        words = ("-I", "-B", WORKER, "problem.json", "result.json")
        run_elsewhere("SANA-FE", python, "sanafe", *words, seconds=TIMEOUT_S, folder=folder)
        answer: dict[str, Any] = json.loads((folder / "result.json").read_text())
    return answer


@dataclass(frozen=True)
class _Answer:
    """SANA-FE's answer as arrays: steps (n, steps) in uJ and ms, counts (n,), fired by population (n, steps, width)."""

    version: str
    microjoules: dict[str, Floats]
    milliseconds: Floats
    detailed: Floats
    counts: dict[str, Floats]
    fired: dict[str, NDArray[np.bool_]]


def _read(answer: dict[str, Any], plan: Plan, trains: Trains) -> _Answer:
    """The answer, checked and converted.

    Events of the port are subtracted, so that updates and spikes are those of compartments.

    Raises:
        InputError: detailed timing had other events than simple.
    """
    shape = trains.exc.shape[0], trains.exc.shape[1]
    queries = answer["queries"]
    if not all(query["repeats"] for query in queries):
        raise InputError("SANA-FE gave other events with detailed timing than with simple; nothing is compared")

    def steps(key: str, scale: float) -> Floats:
        return np.array([query[key] for query in queries], np.float64).reshape(shape) * scale

    def count(key: str) -> Floats:
        return np.array([np.sum(query[key]) for query in queries], np.float64).reshape(shape[0])

    played = count("fired") - np.array([sum(map(len, query["fired_neurons"])) for query in queries])
    return _Answer(
        str(answer["version"]),
        {name: steps(f"{name}_energy", 1e6) for name in ("synapse", "dendrite", "soma", "network", "total")},
        steps("sim_time", 1e3),
        np.array([query["detailed_time"] for query in queries], np.float64).reshape(shape[0]) * 1e3,
        {
            "synaptic operations": count("spikes"),
            "updates": count("updated") - played,
            "spikes": count("fired") - played,
            "injected spikes": played,
            "messages": count("packets"),
            "hops": count("hops"),
        },
        _fired(queries, plan, shape),
    )


def _fired(queries: list[Any], plan: Plan, shape: tuple[int, int]) -> dict[str, NDArray[np.bool_]]:
    """The spikes that SANA-FE had, by population."""
    network = plan.network
    widths = {"exc": network.neurons, "inh": network.inhibitory, "inputs": network.inputs}
    trains = {name: np.zeros((*shape, width), np.bool_) for name, width in widths.items()}
    parts = {group_name(k, i): part for k, core in enumerate(plan.cores) for i, part in enumerate(core.parts)}
    for q, query in enumerate(queries):
        for step, neurons in enumerate(query["fired_neurons"]):
            for group, offset in neurons:
                trains[parts[group].population][q, step, parts[group].first + offset] = True
    return trains


def _our_counts(events: EventCounts) -> dict[str, Floats]:
    """Our own counts of the events that SANA-FE counts, float64 (n,)."""

    def each(*names: str) -> Floats:
        return np.asarray(sum(events.each(name) for name in names), np.float64)

    hops = [f"{kind}hops_{way}" for kind in ("", "injected_") for way in ("east_west", "north_south")]
    return {
        "synaptic operations": each("operations_dense", "operations_sparse"),
        "updates": each("touched"),
        "spikes": each("spikes"),
        "injected spikes": each("input_spikes") * events.injected,
        "messages": each("messages_out", "injected_messages"),
        "hops": each(*hops),
    }


def apart(ours: Any, theirs: Any) -> float:
    """Largest relative difference; not a number if there is one among them, infinite where only ours is 0."""
    a, b = np.asarray(ours, np.float64), np.asarray(theirs, np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.max(np.where(a == b, 0.0, np.abs(a - b) / np.abs(a)), initial=0.0))


def of_compartments(network: FixedNetwork, inputs: NDArray[np.uint8] | None) -> NDArray[np.uint8]:
    """What the inputs' compartments spike when the inputs do, uint8 (n, interval, inputs): relays a step later."""
    spikes = np.asarray(inputs)
    if network.bias_input:
        return spikes
    relayed = np.zeros_like(spikes)
    if network.relayed:
        relayed[:, 1:] = spikes[:, :-1]
    return relayed


@dataclass(frozen=True)
class ClosedForm:
    """SANA-FE's column only, without clearing and static energy: what SANA-FE itself computes.

    Attributes:
        microjoules: The energy of each query by SANA-FE's components ``synapse``, ``soma`` and ``network``, float64
            (n,).
        step_microjoules, step_milliseconds: Energy and time of every step, ``simple`` timing, float64 (n, steps).
    """

    microjoules: dict[str, Floats]
    step_microjoules: Floats
    step_milliseconds: Floats

    @property
    def total_microjoules(self) -> Floats:
        """The energy of each query, (n,)."""
        return np.asarray(sum(self.microjoules.values()))

    @property
    def milliseconds(self) -> Floats:
        """The time of all steps of each query, (n,)."""
        return self.step_milliseconds.sum(axis=1)


def closed_form(
    events: EventCounts, constants: CostConstants, *, tiles: int | None = None, input_core: bool = True
) -> ClosedForm:
    """What SANA-FE computes for the same events.

    Args:
        events: What was counted, with injected spikes from ``entry`` (`lava_vpr.deploy.cost.events.count_events`).
        constants: The constants of Loihi 1.
        tiles: With a core mapped, one of inputs included; None: those of the plan.
        input_core: Injected spikes are sent by one core of their own, whose neurons cost nothing.
    """
    counted = replace(events, updates=events.touched, tiles=events.tiles if tiles is None else tiles)
    picojoules = step_picojoules(counted, constants, "nominal")
    energy = {name: values.sum(axis=1) / 1e6 for name, values in picojoules.items()}
    if input_core:  # one more core, of which nothing but its sending is known
        on_cores = ("messages_in", "operations_dense", "operations_sparse", "accesses", "updates", "spikes")
        wider: dict[str, Any] = {name: np.pad(getattr(counted, name), ((0, 0), (0, 0), (0, 1))) for name in on_cores}
        sent = counted.injected_messages.sum(axis=2, keepdims=True)
        counted = replace(counted, **wider, messages_out=np.concatenate([counted.messages_out, sent], axis=2))
    return ClosedForm(
        {
            "synapse": energy["synaptic operations"],
            "soma": energy["neuron accesses"] + energy["neuron updates"] + energy["spikes"],
            "network": energy["input messages"] + energy["other messages"] + energy["read-out"] + energy["hops"],
        },
        np.asarray(sum(picojoules.values())) / 1e6,
        step_microseconds(counted, constants, "nominal") / 1e3,
    )


def compare(
    plan: Plan,
    trains: Trains,
    answer: dict[str, Any],
    *,
    input_core: bool,
    tiles: int,
    bias: NDArray[np.int32] | None = None,
) -> CrossCheck:
    """SANA-FE's answer beside the closed form.

    Args:
        plan, trains: What was asked.
        answer: What `ask` returned.
        input_core: As in `cross_check`.
        tiles: Tiles that hold a neuron in SANA-FE.
        bias: As in `cross_check`.
    Raises:
        InputError: detailed timing had other events than simple.
    """
    plan = without_counters(plan)
    theirs = _read(answer, plan, trains)
    events, constants = count_events(plan, trains, entry=(0, 0), bias=bias), plan.board.constants
    ours = closed_form(events, constants, tiles=tiles, input_core=input_core)
    nothing = np.zeros(events.queries)
    energy = {**ours.microjoules, "dendrite": nothing, "total": ours.total_microjoules}
    counts = _our_counts(events)
    energies = {name: (energy[name], values.sum(axis=1)) for name, values in theirs.microjoules.items()}
    pairs = [
        *energies.values(),
        (ours.milliseconds, theirs.milliseconds.sum(axis=1)),
        (ours.step_milliseconds, theirs.milliseconds),
        (ours.step_microjoules, theirs.microjoules["total"]),
    ]
    expected = {"exc": trains.exc, "inh": trains.inh, "inputs": of_compartments(plan.network, trains.inputs)}
    differ = sum(int((fired != (expected[name] != 0)).sum()) for name, fired in theirs.fired.items())

    def mean(values: Floats) -> float:
        return float(values.mean()) if values.size else 0.0

    return CrossCheck(
        version=theirs.version,
        queries=events.queries,
        microjoules={name: (mean(a), mean(b)) for name, (a, b) in energies.items()},
        simple_milliseconds=(mean(ours.milliseconds), mean(theirs.milliseconds.sum(axis=1))),
        detailed_milliseconds=mean(theirs.detailed),
        counts={name: (mean(counts[name]), mean(value)) for name, value in theirs.counts.items()},
        difference=float(np.max([apart(a, b) for a, b in pairs])),
        spikes_differ=differ,
    )


def cross_check(
    plan: Plan,
    trains: Trains,
    *,
    python: Path = PYTHON,
    input_core: bool = True,
    bias: NDArray[np.int32] | None = None,
) -> CrossCheck:
    """Hold the closed form against SANA-FE on some queries.

    Args:
        plan: Where the network stands.
        trains: Every spike of the queries, those of inputs and inhibitory neurons too.
        python: The Python that has SANA-FE.
        input_core: Injected spikes take the one core that sends them the time of any core's messages, as SANA-FE has
            it; else none, as the cost model has it, which knows a host.
        bias: Biases of the neurons in each query, int32 (n, neurons); None: always the network's.
    Raises:
        BackendUnavailableError: SANA-FE cannot be asked this.
        InputError: its environment is missing, or it failed.
    """
    problem = problem_of(plan, trains, input_core=input_core, bias=bias)
    tiles = len({group["tile"] for group in problem["groups"]})
    return compare(plan, trains, ask(problem, python), input_core=input_core, tiles=tiles, bias=bias)
