"""What a query costs on a board, from counted events: the cost model. Nothing of it was measured on a chip.

`deploy.cost.closed_form` has energy and time of every step; here they become figures of a query, low, nominal and
high, with the clearing of states. Static energy is apart: every chip of the board draws its power, used or not. So is
the host's traffic.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards import constants as c
from lava_vpr.deploy.boards.constants import CONSTANTS, LEVELS, Constant, barrier
from lava_vpr.deploy.boards.estimate import Estimate, total
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.cost.closed_form import (
    ClosedForm,
    closed_form,
    step_microseconds,
    step_nanoseconds,
    step_picojoules,
)
from lava_vpr.deploy.cost.events import EventCounts, count_events
from lava_vpr.deploy.cost.host_traffic import SETTING_WRITES, counts_on_chips, entry_hops, host_milliseconds
from lava_vpr.deploy.registers.clearing import clearing, rest_steps
from lava_vpr.engine.trains import Trains

Floats = NDArray[np.float64]

__all__ = ["CONSTANTS", "ClosedForm", "Constant", "Modelled", "Quick", "closed_form", "modelled", "quick", "step_times"]

UNPUBLISHED = (
    "no energy or time per operation of Loihi 2 has been published, and Loihi 1's are not borrowed; what is counted "
    "stands, and a step lasts as long as its busiest core plus a barrier"
)


ALL_DENSE = (
    "Synaptic operations on Loihi 2 are counted with all rows dense: how its compiler stores them is not public."
)


@dataclass(frozen=True)
class Modelled:
    """A query on a board, by the cost model; nothing of this was measured on a chip.

    Attributes:
        target: Name of the board.
        chips: All of the board; all of them draw static power, used or not.
        cores, tiles: In use.
        steps: Of a presentation, the silent ones included.
        input_mode: ``injected`` or ``bias``.
        counts: Events of a query, mean over the queries, by name as in the JSON contract, and more; None: unknown.
        dynamic_microjoules: Of a query by component, clearing of states included, host I/O not.
        milliseconds: Of a query on the chip: all its steps and the clearing of states.
        step_microseconds: Of one step, mean over the steps.
        static_millijoules: Of all chips and embedded processors during that time.
        io_milliseconds: Of the host's traffic for the query, apart: both ways of input, and the way in use first.
        io_microjoules: Dynamic energy on the chips that input takes, by way, the way in use first. Messages, input
            compartments and their settings of the way in use are part of ``dynamic_microjoules``; the other's are an
            estimate of what would stand there instead.
        clearing: How states are cleared and what it takes: writes, microjoules, milliseconds; what rest would take.
        assumptions: What was assumed, a sentence each, with source.
        unavailable: Why there are no energies and times (Loihi 2); empty if there are. Estimates are None then.
        wall_milliseconds: Of a query if the host's traffic cannot overlap with another query: the longer of time on the
            chip and traffic of the way in use.
        wall_static_millijoules: Static energy during that.
        busiest: Whose part made a step that long, as share of the steps (nominal): ``receive`` or ``neurons``.
        busiest_core: What a step waits for: events of the core that has most of them, mean over the steps, by name.
    """

    target: str
    chips: int
    cores: int
    tiles: int | None
    steps: int
    input_mode: str
    counts: dict[str, float | None]
    dynamic_microjoules: dict[str, Estimate] | None
    milliseconds: Estimate | None
    step_microseconds: Estimate | None
    static_millijoules: Estimate | None
    io_milliseconds: dict[str, Estimate] | None
    io_microjoules: dict[str, Estimate] | None
    clearing: dict[str, Any]
    assumptions: tuple[str, ...] = ()
    unavailable: str = ""
    wall_milliseconds: Estimate | None = None
    wall_static_millijoules: Estimate | None = None
    busiest: dict[str, float] = field(default_factory=dict)
    busiest_core: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Quick:
    """Nominal figures of each query, clearing of states included, host I/O and static energy not; float64 (n,)."""

    microjoules: Floats
    milliseconds: Floats


def quick(plan: Plan, trains: Trains, until: NDArray[np.int64] | None = None) -> Quick:
    """Nominal figures of many queries, for a search.

    Args:
        plan: Where the network stands (a board whose times are public).
        trains: Every spike.
        until: Steps after which each query is stopped, (n,); None: none is.
    """
    events = count_events(plan, trains)
    energy = np.sum(list(step_picojoules(events, "nominal").values()), axis=0)
    time = step_microseconds(events, "nominal")
    if until is not None:
        going = np.arange(events.steps)[None, :] < np.asarray(until)[:, None]
        energy, time = energy * going, time * going
    extra, pause = _writes(plan)
    if not events.injected:
        extra = extra + _settings(plan)
    return Quick(energy.sum(axis=1) / 1e6 + extra.nominal, time.sum(axis=1) / 1e3 + pause.nominal)


def _write(plan: Plan) -> Estimate:
    """Energy in pJ of a register that an embedded processor writes: a message, its way, an access and an update."""
    east_west, north_south = entry_hops(plan)
    return total(
        (
            c.MESSAGE.estimate,
            c.HOP_EAST_WEST.estimate * east_west,
            c.HOP_NORTH_SOUTH.estimate * north_south,
            c.ACCESS.estimate,
            c.UPDATE.estimate,
        )
    )


def _writes(plan: Plan) -> tuple[Estimate, Estimate]:
    """Microjoules and milliseconds of the writes that clear the membranes; each chip's processor writes its own."""
    number = plan.network.neurons
    most = max(counts_on_chips(plan, "exc").values(), default=0)
    return _write(plan) * (number / 1e6), c.WRITE_TIME.estimate * (most / 1e6)


def _settings(plan: Plan) -> Estimate:
    """Microjoules of the writes that set all input compartments."""
    return _write(plan) * (SETTING_WRITES * plan.network.inputs / 1e6)


def step_times(events: EventCounts) -> tuple[Floats, float]:
    """Microseconds of the busiest core in each step, mean over the queries, (steps,), and of the barrier; nominal."""
    busiest = np.maximum(*step_nanoseconds(events, "nominal")).mean(axis=0) / 1e3
    return np.asarray(busiest), barrier(events.tiles or 1).nominal


def _clearing(plan: Plan, events: EventCounts) -> dict[str, Any]:
    """What `lava_vpr.deploy.registers.clearing` says, with what it takes, and what steps of rest would."""
    microjoules, milliseconds = _writes(plan)
    steps = rest_steps(plan.network)
    busiest = [
        c.ACCESS_TIME.estimate * sum(p.size for p in core.parts) + c.UPDATE_TIME.estimate * core.part("exc").size
        for core in plan.cores
    ]
    used = barrier(events.tiles or 1).estimate
    each = [
        max(max(getattr(b, level) for b in busiest) / 1e3 + getattr(used, level), getattr(c.STEP, level))
        for level in LEVELS
    ]
    mapped = int(events.accesses[0, 0].sum()) if events.queries else 0
    rest = (c.ACCESS.estimate * mapped + c.UPDATE.estimate * plan.network.neurons) * (steps / 1e6)
    pause = Estimate(*each) * (steps / 1e3)
    return {
        **clearing(plan.network, plan.board, plan),
        "microjoules": microjoules,
        "milliseconds": milliseconds,
        "rest_microjoules": rest,
        "rest_milliseconds": pause,
        "cheaper": "rest steps" if rest.nominal < microjoules.nominal else "embedded writes",
    }


def counts_of(events: EventCounts, plan: Plan) -> dict[str, float | None]:
    """Events of a query, mean over the queries, by name."""

    def mean(*names: str) -> float:
        return float(sum(events.each(name).mean() for name in names)) if events.queries else 0.0

    known = plan.board.tile_cores is not None
    injected = ("input_hops_east_west", "input_hops_north_south") if events.injected else ()
    return {
        "synaptic_operations": mean("operations_dense", "operations_sparse"),
        "synaptic_operations_dense_rows": mean("operations_dense"),
        "synaptic_operations_sparse_rows": mean("operations_sparse"),
        "neuron_accesses": mean("accesses"),
        "neuron_updates": mean("updates"),
        "input_spikes": mean("input_spikes"),
        "exc_spikes": mean("exc_spikes"),
        "inh_spikes": mean("inh_spikes"),
        "messages": mean("messages_out", *["input_messages"] * events.injected),
        "input_messages": mean("input_messages"),
        "read_outs": mean("read_outs"),
        "chip_crossings": mean("crossings"),
        "hops": mean("hops_east_west", "hops_north_south", *injected) if known else None,
        "steps": float(events.steps),
    }


def _input_microjoules(plan: Plan, events: EventCounts) -> dict[str, Estimate]:
    """Dynamic energy that input takes on the chips, by way, the way in use first."""
    inputs, n = plan.network.inputs, max(1, events.queries)
    arrivals, spikes = events.input_messages.sum() / n, events.input_spikes.sum() / n
    hops = [events.input_hops_east_west.sum() / n, events.input_hops_north_south.sum() / n]
    entry = [arrivals * hop for hop in entry_hops(plan)]
    messages = c.MESSAGE.estimate * arrivals

    def way(tiles: list[float]) -> Estimate:
        return c.HOP_EAST_WEST.estimate * tiles[0] + c.HOP_NORTH_SOUTH.estimate * tiles[1]

    if events.injected:
        accesses = updates = float(inputs * events.steps)
    else:
        accesses, updates = events.input_accesses.sum() / n, events.input_updates.sum() / n
    layer = (
        c.ACCESS.estimate * accesses,
        c.UPDATE.estimate * updates,
        c.SPIKE.estimate * spikes,
        messages,
        way([0.0, 0.0] if events.injected else hops),
        _settings(plan) * 1e6,
    )
    found = {
        "injected": (messages + way(hops if events.injected else entry)) * 1e-6,
        "bias": total(layer) * 1e-6,
    }
    return found if events.injected else dict(reversed(found.items()))


def modelled(plan: Plan, events: EventCounts) -> Modelled:
    """What a query costs on the board of ``plan``, mean over the queries of ``events``."""
    board = plan.board
    bare = Modelled(
        target=board.name,
        chips=board.chips,
        cores=len(plan.cores),
        tiles=events.tiles,
        steps=events.steps,
        input_mode="injected" if events.injected else "bias",
        counts=counts_of(events, plan),
        dynamic_microjoules=None,
        milliseconds=None,
        step_microseconds=None,
        static_millijoules=None,
        io_milliseconds=None,
        io_microjoules=None,
        clearing=clearing(plan.network, board, plan),
    )
    if not events.queries:
        return replace(bare, unavailable="there is no query")
    bare = replace(bare, busiest_core=_busiest_core(events))
    if not board.timed:
        return replace(bare, unavailable=UNPUBLISHED, assumptions=(ALL_DENSE,))
    told = _clearing(plan, events)
    steps = Estimate(*(float(step_microseconds(events, level).mean()) for level in LEVELS))
    milliseconds = steps * (events.steps / 1e3) + told["milliseconds"]
    io = host_milliseconds(plan, events)
    wall = Estimate(*(max(getattr(milliseconds, level), getattr(io[bare.input_mode], level)) for level in LEVELS))
    receive, neurons = step_nanoseconds(events, "nominal")
    share = float((receive > neurons).mean())
    return replace(
        bare,
        dynamic_microjoules=_dynamic(plan, events, told["microjoules"]),
        milliseconds=milliseconds,
        step_microseconds=steps,
        static_millijoules=_static(plan, milliseconds),
        io_milliseconds=io,
        io_microjoules=_input_microjoules(plan, events),
        clearing=told,
        assumptions=assumptions(plan, events),
        wall_milliseconds=wall,
        wall_static_millijoules=_static(plan, wall),
        busiest={"receive": share, "neurons": 1 - share},
    )


def _dynamic(plan: Plan, events: EventCounts, cleared: Estimate) -> dict[str, Estimate]:
    """Microjoules of a query by component."""
    energies = [step_picojoules(events, level) for level in LEVELS]
    found = {name: Estimate(*(float(e[name].sum(axis=1).mean()) / 1e6 for e in energies)) for name in energies[0]}
    found["clearing of states"] = cleared
    if not events.injected:
        found["settings of the inputs"] = _settings(plan)
    return found


def _busiest_core(events: EventCounts) -> dict[str, float]:
    """Most events of a core in a step, mean over steps and queries."""
    names = ("messages_in", "accesses", "updates", "spikes", "messages_out")
    most = {name: float(getattr(events, name).max(axis=2).mean()) for name in names}
    operations = events.operations_dense + events.operations_sparse
    return {"synaptic_operations": float(operations.max(axis=2).mean()), **most}


def _static(plan: Plan, milliseconds: Estimate) -> Estimate:
    """Millijoules that all chips of the board draw in so long."""
    power = (c.STATIC.estimate + c.EMBEDDED.estimate) * plan.board.chips
    return Estimate(*(getattr(power, level) * getattr(milliseconds, level) / 1e3 for level in LEVELS))


def assumptions(plan: Plan, events: EventCounts) -> tuple[str, ...]:
    """What the model takes for granted, a sentence each."""
    found = [
        "A step lasts as long as its busiest core, plus a barrier by tiles in use (SANA-FE's simple timing): no "
        "contention on the mesh; the high bound takes no step as shorter than the 5.8 us measured on 32 chips (Frady "
        "et al. 2020).",
        "The embedded processor's own work in each step is not in the low and nominal time: no figure is public.",
        "Clearing: each membrane is one write of an embedded processor, taken as one message, its way, an access and "
        "an update; no figure is public.",
    ]
    if events.injected:
        found.append("Injected spikes enter the mesh at tile 0 of the chip they go to, one message for each core.")
    if events.crossings.any():
        found.append("A message to the other chip costs what its tiles cost: no figure for the link is public.")
    if events.injected:
        found.append(
            "Inputs that integrate a bias are an estimate: every input compartment accessed and updated in every step."
        )
    return tuple(found)
