"""Where the neurons of a deployment stand, as a table and in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lava_vpr.deploy.boards.board import Board, EmbeddedWrites, LifReset, public
from lava_vpr.deploy.boards.plan import CorePlan, Plan, PopulationPart
from lava_vpr.deploy.mapping.front_end import PlacedFrontEnd
from lava_vpr.loihi import reset_interval
from lava_vpr.show.numbers import NONE, UNKNOWN, figure, ranged
from lava_vpr.show.table import Table

MOST_ROWS = 24
"""Rows of a table; what lies between the first and the last of more cores is left out."""


def span(part: PopulationPart) -> str:
    """A part's neurons, ``exc 0..99`` or ``inh 0``."""
    last = "" if part.size == 1 else f"..{part.first + part.size - 1}"
    return f"{part.population} {part.first}{last}"


def microseconds(time: float | None) -> str:
    """What a core, or the board, is modelled to take for a step; None: unknown."""
    return UNKNOWN if time is None else f"{figure(time)} µs"


def modelled_time(plan: Plan) -> str:
    """The modelled time of a step and of a query, and what it rests on, as a sentence; without times: why."""
    times, interval = plan.times, plan.network.interval
    if times is None:
        return f"Time of a step: {UNKNOWN}; nobody has published how long operations of {plan.board.title} take."
    core = busiest(plan)
    return (
        f"Modelled on {times.activity}: {ranged(times.milliseconds, 'ms')} a query of {interval} steps, "
        f"{ranged(times.step_microseconds, 'µs')} a step, {microseconds(core.microseconds)} of it on the busiest core "
        f"({core_name(plan.board, core)}). `lava-vpr bench` models other queries."
    )


def in_short(plan: Plan, beliefs: int) -> str:
    """The modelled times, or that it is unknown what fits, and the number of unproven ``beliefs``, as a sentence."""
    first = "Whether it fits is unknown: it is beyond none of the public numbers"
    if plan.times is not None:
        query, step = ranged(plan.times.milliseconds, "ms"), ranged(plan.times.step_microseconds, "µs")
        first = f"A query of its references is modelled to take {query}, a step {step}"
    return f"{first}; this rests on {beliefs} beliefs that no public source shows (docs/hardware.md)."


def told_in_short(plan: Plan) -> bool:
    """Whether the table has every core and no neuron passes on the spikes of others, so that `in_short` says enough."""
    return len(plan.cores) <= MOST_ROWS and not (plan.network.leaves or plan.network.relayed)


def rows_of(plan: Plan, core: CorePlan) -> tuple[int | None, int | None]:
    """The numbers of inputs' rows that a core stores dense and sparse; a row without any weight is not stored."""
    if not plan.board.memory.public:
        return None, None
    exc = core.part("exc")
    used = plan.network.weights[:, exc.first : exc.first + exc.size].any(axis=1)
    dense = int(np.count_nonzero(core.dense_inputs & used))
    return dense, int(np.count_nonzero(used)) - dense


def share(used: int | None, limit: int | None) -> str:
    """``used`` in percent of ``limit``."""
    return UNKNOWN if used is None or limit is None else f"{100 * used / limit:.1f} %"


def _of(used: int | None, limit: int | None) -> str:
    """The text of ``used`` and, if it is known, of ``limit``."""
    if used is None:
        return UNKNOWN
    return f"{used:,}" if limit is None else f"{used:,} of {limit:,}"


def core_name(board: Board, core: CorePlan) -> str:
    """A core as chip and number; just a number where the board's compiler chooses."""
    return f"{core.chip}:{core.core}" if board.mesh is not None else f"{core.core}"


def core_table(plan: Plan, *, most: int = MOST_ROWS) -> Table:
    """One row a core, and their sums: what it holds, a population a line, and what that takes of the core's limits.

    Args:
        plan: The plan.
        most: Rows; of more cores the first and the last are shown.
    """
    rows = [_row(plan, core) for core in plan.cores]
    if len(rows) > most:
        rows[most // 2 : most // 2 - most] = [["...", f"{len(rows) - most} more cores"]]
    figures = ("compartments", "axons in", "axons out", "synapse memory", "dense rows", "sparse rows", "a step")
    rules = frozenset({len(rows)})
    rows.append(_totals(plan))
    caption = (
        "axons out, dense rows and time of each core: fit MODEL --json FILE; drawn and in words: --picture FILE.svg"
    )
    heads, aside = ("core", "holds", *figures), frozenset({4, 6, 7, 8})
    return Table(heads, rows, (caption,), plan.board.title, words=2, rules=rules, aside_columns=aside)


def _bits(bits: int) -> str:
    """The number of ``bits`` with its unit, in words."""
    return f"{bits} bit" if bits == 1 else f"{bits} bits"


def _row(plan: Plan, core: CorePlan) -> list[str]:
    """The cells of one core."""
    board, needs = plan.board, core.needs
    dense, sparse = rows_of(plan, core)
    return [
        core_name(board, core),
        "\n".join(span(part) for part in core.parts if part.size),
        _of(needs.compartments, board.compartments),
        _of(needs.axons_in, board.axons_in),
        _of(needs.axons_out, board.axons_out),
        share(needs.synapse_words, board.memory.words),
        _of(dense, None),
        _of(sparse, None),
        microseconds(core.microseconds),
    ]


def _sum(values: Sequence[int | None]) -> int | None:
    """The sum of ``values``; None if one of them is not known."""
    known = [value for value in values if value is not None]
    return sum(known) if len(known) == len(values) else None


def _totals(plan: Plan) -> list[str]:
    """The cells of all cores together."""
    needs = [core.needs for core in plan.cores]
    rows = [rows_of(plan, core) for core in plan.cores]
    words = _sum([need.synapse_words for need in needs])
    least = "" if plan.board.memory.public else "at least\n"
    return [
        "all",
        f"{least}{len(plan.cores)} of {plan.board.chips * plan.board.cores} cores",
        f"{sum(need.compartments for need in needs):,}",
        *(_of(_sum(values), None) for values in ([n.axons_in for n in needs], [n.axons_out for n in needs])),
        UNKNOWN if words is None else f"{words * 8 / 1024:,.1f} KiB",
        *(_of(_sum(values), None) for values in ([dense for dense, _ in rows], [sparse for _, sparse in rows])),
        microseconds(None if plan.times is None else plan.times.step_microseconds.nominal),
    ]


def busiest(plan: Plan) -> CorePlan:
    """The core that is modelled to take longest for a step; the first of equals."""
    return max(plan.cores, key=lambda core: core.microseconds or 0.0)


def front_end_table(placed: PlacedFrontEnd, others: int, left_out: str = "") -> Table:
    """What the populations of a spiking front end would take, and whether they fit beside ``others`` cores.

    Args:
        placed: Where they stand.
        others: Cores of the place network.
        left_out: Why a bundle leaves them out even if they fit; empty: it does not.
    """
    board, exceeded = placed.board, placed.exceeded(others)
    rows = []
    for name, each in placed.populations.items():
        cells = (each.neurons, each.stored, each.cores, each.compartments, each.axons_in, each.axons_out)
        rows.append((name, *(f"{value:,}" for value in cells), f"{100 * each.memory:.1f} %", each.binds or NONE))
    summed = (sum(getattr(each, key) for each in placed.populations.values()) for key in ("neurons", "stored", "cores"))
    rows.append(("all", *(f"{value:,}" for value in summed), "", "", "", "", ""))
    whole, have = "exc" in placed.populations, board.chips * board.cores
    fits = f"It does not fit: {exceeded}."
    if not exceeded:
        fits = (
            f"It fits: {placed.cores} of {have} cores."
            if whole
            else f"It fits beside the network's {others} of {have} cores."
        )
    if not (exceeded or board.memory.public):
        fits = "Whether it fits is unknown: it is beyond none of the public numbers."
    runs = "No board's program runs it (unproven): a board is sent what the host counts."
    if whole:
        runs = "One run takes pixels to places; nothing of it was measured on a board (unproven)."
    own = "Each population stands on cores of its own, in sparse rows of weights that nothing shares."
    notes = [f"{fits} {runs} {own}"]
    if left_out:
        notes.append(f"No bundle holds it: {left_out}.")
    if isinstance(board.clearing, LifReset) and (reset := reset_interval(placed.steps)) != placed.steps:
        notes.append(f"Its {placed.steps} steps would be {reset}: neurons are reset at powers of two.")
    title = f"{'pixels to places' if whole else 'the spiking front end'} on {board.title}"
    heads = ("neurons", "synapses", "cores", "compartments", "axons in", "axons out", "memory", "what binds")
    return Table(
        title=f"{title}; of compartments, axons and memory the most that a core has",
        columns=("population", *heads),
        rows=rows,
        notes=notes,
        long=frozenset({8}),
        rules=frozenset({len(rows) - 1}),
    )


def summary(plan: Plan) -> list[str]:
    """What matters of a plan, a sentence each."""
    board, network = plan.board, plan.network
    least = "" if board.memory.public else "At least "
    lines = [
        f"{least}{len(plan.cores)} of {board.chips * board.cores} cores, {_bits(plan.weight_bits)} a stored weight."
    ]
    root = f", the root of {network.leaves} others," if network.leaves else ""
    delay = network.inhibition_delay
    lines.append(f"One inhibitory neuron{root} inhibits every neuron {delay} steps after any has spiked.")
    if board.mesh is None:
        lines.append("Which cores they are, and how synapses are stored, is decided by Intel's compiler.")
    if board.known:
        lines.append(f"{board.known} Whether the network fits is unknown: it is beyond none of the public numbers.")
    lines.append(modelled_time(plan))
    if isinstance(board.clearing, EmbeddedWrites):
        most, masks = plan.embedded_tables
        fewer = f" ({masks / 1024:,.1f} KiB with --ways masks)" if masks < most else ""
        lines.append(
            f"The embedded processors' tables take up to {most / 1024:,.1f} KiB{fewer}; how much memory they "
            "have is not public."
        )
    if plan.hops is not None:
        lines.append(f"Messages cross {plan.hops:.1f} tiles a step.")
    if network.bias_input:
        lines.append("The host sends no spikes: inputs integrate a bias that is written once a query.")
    else:
        limit = UNKNOWN if public(board.host_spikes) is None else f"{board.host_spikes}"
        passed = ", where relays pass them on" if network.relayed else ""
        lines.append(
            f"The host sends up to {plan.host_spikes:.1f} spikes a step to each chip (limit: {limit}){passed}."
        )
    lines.append(f"Between queries: {board.clearing.of(network)['what']}.")
    return lines
