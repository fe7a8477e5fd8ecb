"""The cost model: energy and time of a query on a board, from counted events. Nothing was measured on a chip.

`deploy.cost.closed_form` computes energy and time of every step, `deploy.cost.between_queries` those of everything
before the first and after the last. Here they become low, nominal and high figures of a query. Static energy, which
every chip of the board draws whether it is used or not, and the host's traffic are separate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.constants import CostConstants, Estimate, Level, total
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.cost import embedded
from lava_vpr.deploy.cost.between_queries import clearing, microjoules_by_component, outside_steps, settings_microjoules
from lava_vpr.deploy.cost.closed_form import step_microseconds, step_nanoseconds, step_picojoules
from lava_vpr.deploy.cost.embedded import entry_hops, host_milliseconds, through_relays
from lava_vpr.deploy.cost.events import EventCounts
from lava_vpr.loihi import EMBEDDED_MHZ, REGISTER_CYCLES, WORD_CYCLES

Floats = NDArray[np.float64]

UNPUBLISHED = (
    "no energy or time per operation of Loihi 2 has been published, and Loihi 1's are not borrowed; what is counted "
    "stands, and a step lasts as long as its busiest core plus a barrier"
)


ALL_DENSE = (
    "Synaptic operations on Loihi 2 are counted with all rows of inputs dense: how its compiler stores them is not "
    "public."
)


@dataclass(frozen=True)
class BoardFigures:
    """Energies and times of a query on a board whose constants are public.

    Attributes:
        dynamic_by_component: Microjoules of a query, clearing of states included, host I/O not.
        milliseconds: Time of a query on the chip: all its steps, and reading, clearing and setting between two queries.
        step_microseconds: Time of one step, mean over the steps: cores, barrier, and the program on the chips'
            processors.
        static_millijoules: Energy that all chips and embedded processors draw during ``milliseconds``.
        io_milliseconds_by_way: Separate time of the host's traffic for the query, by input mode, the one in use first.
        io_microjoules_by_way: Dynamic energy of input on the chips, by input mode, the one in use first. Messages,
            input compartments and their settings of the mode in use are part of ``dynamic_by_component``; those of the
            other mode are an estimate.
        wall_milliseconds: Time of a query with the host's traffic, from the first packet to the last count
            (`wall_milliseconds`).
        wall_static_millijoules: Static energy during ``wall_milliseconds``.
        busiest: Share of the steps whose time is that of arriving spikes (``receive``) or of ``neurons`` (nominal).
        embedded: Work of the program on the chips' processors: accesses per step and between queries on the busiest
            chip, and their times, which are part of ``step_microseconds`` and ``milliseconds``
            (`deploy.cost.embedded`).
    """

    dynamic_by_component: dict[str, Estimate]
    milliseconds: Estimate
    step_microseconds: Estimate
    static_millijoules: Estimate
    io_milliseconds_by_way: dict[str, Estimate]
    io_microjoules_by_way: dict[str, Estimate]
    wall_milliseconds: Estimate
    wall_static_millijoules: Estimate
    busiest: dict[str, float]
    embedded: dict[str, Any]

    @property
    def dynamic_microjoules(self) -> Estimate:
        """Dynamic energy of a query, all components."""
        return total(self.dynamic_by_component.values())

    @property
    def io_milliseconds(self) -> Estimate:
        """Time of the host's traffic in the input mode in use."""
        return next(iter(self.io_milliseconds_by_way.values()))


_KEYS: tuple[str, ...] = (
    *("chips", "cores", "tiles", "steps", "input_mode", "dynamic_microjoules", "dynamic_by_component", "milliseconds"),
    *("step_microseconds", "static_millijoules", "io_milliseconds", "io_milliseconds_by_way", "io_microjoules_by_way"),
    *("wall_milliseconds", "wall_static_millijoules", "busiest", "busiest_core", "embedded", "clearing", "counts"),
    "unavailable",
)
"""Keys of `Modelled.as_json`, in order."""


@dataclass(frozen=True)
class Modelled:
    """Modelled costs of a query on a board; nothing here was measured on a chip.

    Attributes:
        target: The name of the board.
        chips: All chips of the board; all of them draw static power, used or not.
        cores, tiles: Those in use; tiles None: the mesh is not public.
        steps: Steps of a presentation, the silent ones included.
        input_mode: ``injected`` or ``bias``.
        figures: Energies and times; None: there are none, and ``unavailable`` says why.
        busiest_core: Events of the core with most of them, for which a step waits, mean over the steps, by name; None:
            no query was counted.
        clearing: The mechanism that clears states, with writes, microjoules and milliseconds, and the costs of rest
            instead (None: no rest clears them).
        counts: Events of a query, mean over the queries, by name; None: unknown.
        unavailable: Reason for missing energies and times (Loihi 2); None if there are some.
        assumptions: The assumptions with their sources, a sentence each.
    """

    target: str
    chips: int
    cores: int
    tiles: int | None
    steps: int
    input_mode: str
    figures: BoardFigures | None = None
    busiest_core: dict[str, float] | None = None
    clearing: dict[str, Any] = field(default_factory=dict)
    counts: dict[str, float | None] = field(default_factory=dict)
    unavailable: str | None = None
    assumptions: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The figures by name, as scripts read them, without target (their key) and assumptions (listed for all boards
        together)."""
        return {key: getattr(self if hasattr(self, key) else self.figures, key, None) for key in _KEYS}


def modelled(plan: Plan, events: EventCounts) -> Modelled:
    """Costs of a query on the board of ``plan``, mean over the queries of ``events``."""
    board, constants = plan.board, plan.board.constants
    counted = Modelled(
        target=board.name,
        chips=board.chips,
        cores=len(plan.cores),
        tiles=events.tiles,
        steps=events.steps,
        input_mode="injected" if events.injected else "bias",
        clearing=board.clearing.of(plan.network),
        counts=counts_of(events, plan),
    )
    if not events.queries:
        return replace(counted, unavailable="there is no query")
    counted = replace(counted, busiest_core=_busiest_core(events))
    if constants is None:
        return replace(counted, unavailable=UNPUBLISHED, assumptions=(ALL_DENSE,))
    cleared, figures = clearing(plan, events, constants), _figures(plan, events, constants)
    return replace(counted, figures=figures, clearing=cleared, assumptions=assumptions(events))


def _figures(plan: Plan, events: EventCounts, constants: CostConstants) -> BoardFigures:
    """The estimates of energies and times."""
    steps = Estimate.of(lambda level: float(all_microseconds(plan, events, constants, level).mean()))
    milliseconds = query_milliseconds(plan, steps, constants)
    sent, counts = host_milliseconds(plan, events, constants)
    taken = 0 if plan.network.bias_input else plan.network.steps
    wall = wall_milliseconds(milliseconds, next(iter(sent.values())), counts, steps, taken)
    receive, neurons = step_nanoseconds(events, constants, "nominal")
    share = float((receive > neurons).mean())
    return BoardFigures(
        dynamic_by_component=_dynamic(plan, events, constants),
        milliseconds=milliseconds,
        step_microseconds=steps,
        static_millijoules=static_millijoules(plan, milliseconds, constants),
        io_milliseconds_by_way={way: time + counts for way, time in sent.items()},
        io_microjoules_by_way=_input_microjoules(plan, events, constants),
        wall_milliseconds=wall,
        wall_static_millijoules=static_millijoules(plan, wall, constants),
        busiest={"receive": share, "neurons": 1 - share},
        embedded=embedded.as_json(plan, events, constants),
    )


def counts_of(events: EventCounts, plan: Plan) -> dict[str, float | None]:
    """Events of a query, mean over the queries, by name."""

    def mean(*names: str) -> float:
        return float(sum(events.each(name).mean() for name in names)) if events.queries else 0.0

    hops = [f"{kind}hops_{way}" for kind in ("", "injected_") for way in ("east_west", "north_south")]
    return {
        "synaptic_operations": mean("operations_dense", "operations_sparse"),
        "synaptic_operations_dense_rows": mean("operations_dense"),
        "synaptic_operations_sparse_rows": mean("operations_sparse"),
        "neuron_accesses": mean("accesses"),
        "neuron_updates": mean("updates"),
        "input_spikes": mean("input_spikes"),
        "exc_spikes": mean("exc_spikes"),
        "inh_spikes": mean("inh_spikes"),
        "messages": mean("messages_out", "injected_messages"),
        "input_messages": mean("input_messages"),
        "read_outs": mean("exc_spikes"),
        "chip_crossings": mean("crossings"),
        "hops": None if plan.board.mesh is None else mean(*hops),
        "steps": float(events.steps),
    }


def _busiest_core(events: EventCounts) -> dict[str, float]:
    """Most events of a core in a step, mean over steps and queries."""
    names = ("messages_in", "accesses", "updates", "spikes", "messages_out")
    most = {name: float(getattr(events, name).max(axis=2).mean()) for name in names}
    operations = events.operations_dense + events.operations_sparse
    return {"synaptic_operations": float(operations.max(axis=2).mean()), **most}


def _dynamic(plan: Plan, events: EventCounts, constants: CostConstants) -> dict[str, Estimate]:
    """Microjoules of a query by component."""
    low, nominal, high = (step_picojoules(events, constants, level) for level in ("low", "nominal", "high"))

    def mean(picojoules: Floats) -> float:
        return float(picojoules.sum(axis=1).mean()) / 1e6

    components = {name: Estimate(mean(low[name]), mean(nominal[name]), mean(high[name])) for name in nominal}
    return components | microjoules_by_component(plan, constants)


_MESSAGES = ("messages", "hops_east_west", "hops_north_south")


def query_milliseconds(plan: Plan, step_microseconds: Estimate, constants: CostConstants) -> Estimate:
    """Time of a query on the chip: all its steps at the mean time of a step, and reading, clearing and setting between
    two queries."""
    _, between = outside_steps(plan, constants)
    return step_microseconds * (plan.network.interval / 1e3) + between


def wall_milliseconds(
    milliseconds: Estimate, sent: Estimate, counts: Estimate, step_microseconds: Estimate, taken: float
) -> Estimate:
    """Time of a query on the chip with the host's traffic, in the order in which the program on the chip takes packets.

    The program waits for settings before the first step and sends counts after the last, and the host starts a query
    only after the counts of the one before: these times add up. It takes input spikes step by step, while the host
    sends those of later steps, since the channel holds some packets: in all of these steps but one, the shorter of the
    step's time and its packets' is hidden by the longer. High: nothing overlaps.

    Args:
        milliseconds: Time on the chip.
        sent, counts: Time of all the host's packets for the query, and of the counts that come back, in ms.
        step_microseconds: Mean time of a step.
        taken: Steps in which the program takes input spikes; 0: it takes settings.
    """

    def overlapped(level: Level) -> float:
        if level == "high" or not taken:
            return 0.0
        return (taken - 1) * min(step_microseconds.at(level) / 1e3, sent.at(level) / taken)

    together = milliseconds + sent + counts
    return Estimate.of(lambda level: together.at(level) - overlapped(level))


def all_microseconds(plan: Plan, events: EventCounts, constants: CostConstants, level: Level) -> Floats:
    """Time of every step, us, float64 (n, steps): the time of the cores and the barrier, then that of the embedded
    program."""
    on_cores = step_microseconds(events, constants, level)
    return np.asarray(on_cores + embedded.step_microseconds(plan, events, constants, level))


def _input_microjoules(plan: Plan, events: EventCounts, constants: CostConstants) -> dict[str, Estimate]:
    """Dynamic energy of input on the chips, by input mode, the one in use first."""
    network, queries = plan.network, max(1, events.queries)

    def mean(name: str) -> float:
        return float(getattr(events, name).sum() / queries)

    def sent(messages: float, east_west: float, north_south: float) -> Estimate:
        tiles = constants.hop_east_west * east_west + constants.hop_north_south * north_south
        return constants.message * messages + tiles

    def somata(updates: float) -> Estimate:
        accesses = constants.access * float(network.inputs * events.steps)
        return accesses + constants.update * updates + constants.spike * spikes

    spikes, injected = mean("input_spikes"), [mean(f"injected_{what}") for what in _MESSAGES]
    onward = [mean(f"input_{what}") - entered for what, entered in zip(_MESSAGES, injected, strict=True)]
    if not network.input_compartments:
        onward = [injected[0], 0.0, 0.0]  # what they would send, as if they stood beside
    if network.bias_input:
        entering = spikes if through_relays(plan) else onward[0]
        ways = entry_hops(plan, "inputs" if through_relays(plan) else "exc")
        injected = [entering, *(entering * tiles for tiles in ways)]
    updates = mean("input_updates") if network.bias_input else float(network.inputs * events.steps)
    by_mode = {
        "injected": sent(*injected) + (somata(spikes) + sent(*onward) if through_relays(plan) else Estimate(0, 0, 0)),
        "bias": somata(updates) + sent(*onward) + settings_microjoules(plan, constants) * 1e6,
    }
    in_order = by_mode.items() if events.injected else reversed(by_mode.items())
    return {mode: picojoules * 1e-6 for mode, picojoules in in_order}


def static_millijoules(plan: Plan, milliseconds: Estimate, constants: CostConstants) -> Estimate:
    """Millijoules that all chips of the board draw in this time."""
    power = (constants.static + constants.embedded) * plan.board.chips
    return Estimate.of(lambda level: power.at(level) * milliseconds.at(level) / 1e3)


def _either(values: Sequence[float]) -> str:
    """Low, nominal and high in words."""
    *first, last = (f"{value:g}" for value in values)
    return f"{', '.join(first)} or {last}"


def assumptions(events: EventCounts) -> tuple[str, ...]:
    """The assumptions of the model, a sentence each."""
    sentences = [
        "A step lasts as long as its busiest core, plus a barrier by tiles in use (SANA-FE's simple timing): no "
        "contention on the mesh; the high bound takes no step as shorter than the 5.8 us measured on 32 chips (Frady "
        "et al. 2020).",
        "The embedded processors' program runs while the cores wait; its accesses are counted and take "
        f"{_either(REGISTER_CYCLES)} cycles each for a core's register and {_either(WORD_CYCLES)} for a word of "
        f"memory, at {_either(EMBEDDED_MHZ)} MHz: no figure is public.",
        "Clearing: each membrane is one write of an embedded processor, taken as one message, its way, an access and "
        "an update; no figure is public.",
    ]
    if events.injected:
        whither = "its relay's core" if events.input_accesses.any() else "each core"
        sentences.append(f"Injected spikes enter the mesh at tile 0 of the chip they go to, one message for {whither}.")
    if events.crossings.any():
        sentences.append("A message to the other chip costs what its tiles cost: no figure for the link is public.")
    if events.injected:
        sentences.append(
            "Inputs that integrate a bias are an estimate: every input compartment accessed and updated in every step."
        )
    return tuple(sentences)
