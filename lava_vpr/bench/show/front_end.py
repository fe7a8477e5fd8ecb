"""Tables of the cost of the spiking front end: events and energy of each population; time, registers and packets of an
image."""

from __future__ import annotations

from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.boards.constants import total
from lava_vpr.deploy.cost.front_end import FrontEndCosts
from lava_vpr.deploy.mapping.front_end import EVENTS
from lava_vpr.show.numbers import NONE, count, levels, ranged
from lava_vpr.show.table import Table

HEADS = (
    *("neurons", "synapses", "spikes", "steps with spikes", "synaptic operations", "accesses", "updates, at most"),
    *("messages", "dynamic, modelled, uJ"),
)
"""Headings of events and energy of a population."""


def cells(costs: FrontEndCosts) -> list[tuple[str, ...]]:
    """A row below ``population`` and `HEADS` for each population, and for all."""
    energies = {} if costs.dynamic_microjoules is None else dict(costs.dynamic_microjoules)
    energies |= {"all": total(energies.values())} if energies else {}
    made = []
    for name, one in {**costs.layers, "all": costs.all}.items():
        figures = (one.spikes, one.active, one.operations, one.accesses, one.updates, one.messages)
        words = (f"{one.neurons:,}", f"{one.synapses:,}", *(f"{value:,.0f}" for value in figures))
        made.append((name, *words, ranged(energies.get(name))))
    return made


def tables(costs: FrontEndCosts) -> tuple[Table, ...]:
    """Both tables of a board; only the first if its constants are not public."""
    title = BOARDS[costs.board].title
    named = "pixels to places" if "exc" in costs.layers else "spiking front end"
    layers = Table(
        title=f"{named} on {title}: counted, a presentation of {costs.steps} steps, {costs.cores} cores",
        columns=("population", *HEADS),
        rows=cells(costs),
        notes=(
            f"Mean of {costs.images} queries. No board runs it yet (unproven): cores are as many as its neurons, axons "
            "and rows take, without weights that are shared; tiles that messages cross are left out.",
        ),
    )
    return layers, _besides(costs, title)


def _besides(costs: FrontEndCosts, title: str) -> Table:
    """Time, registers and packets of an image."""
    rows = [
        (what if what == EVENTS else f"registers: {what}", NONE, count(number), NONE)
        for what, number in costs.registers.items()
    ]
    rows.append(("packets of the host", NONE, count(costs.packets), NONE))
    for what, value in (costs.between_microjoules or {}).items():
        rows.append((f"dynamic energy, uJ: {what}", *levels(value)))
    for what, value in (costs.between_milliseconds or {}).items():
        rows.append((f"time, ms: {what}", *levels(value)))
    for what, one in (
        ("one step, us", costs.step_microseconds),
        ("time, ms: all steps", costs.milliseconds),
        ("static energy of all this time, mJ", costs.static_millijoules),
    ):
        if one is not None:
            rows.append((what, *levels(one)))
    given = (
        "Events are spikes that the host sends"
        if EVENTS in costs.registers
        else "Pixels are registers that the host has written"
    )
    note = (
        f"{given}; the host reads the counts of cells and makes rates of them, so a query's steps and host I/O come on "
        "top. That counts can be read so is unproven."
    )
    if "exc" in costs.layers:
        note = (
            f"{given} before a query; after it the host reads the counts of exc, and computes nothing between the two."
        )
    notes = (note,)
    return Table(
        ("front end, an image", "low", "nominal", "high"),
        rows,
        notes,
        f"registers and time of the front end on {title}",
    )
