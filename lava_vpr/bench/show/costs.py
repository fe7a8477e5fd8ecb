"""Tables of the costs of a query on boards: modelled figures, and those of views, adaptation, gains and a front end."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from lava_vpr.bench.results import Bench, BoardFigures, GainsCost, Modelled, QueryVariants
from lava_vpr.bench.show import front_end
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.boards.constants import Estimate
from lava_vpr.show.numbers import NONE, figure, levels, named, percent
from lava_vpr.show.table import Table


def estimated(name: str, value: Estimate | None) -> tuple[str, ...]:
    """A row with a column for each level of an estimate."""
    return (name, *levels(value))


def _exactly(name: str, value: str) -> tuple[str, ...]:
    """A row of one exact figure, in the column of nominal ones."""
    return (name, NONE, value, NONE)


def _clearing(clearing: dict[str, Any]) -> Iterable[tuple[str, ...]]:
    """The row on the clearing of states, whose cost is part of the figures above, and on the steps of rest that could
    replace it."""
    for key, text in (
        ("writes_per_query", "clearing of states: writes"),
        ("microjoules", "  contained above, uJ"),
        ("milliseconds", "  contained above, ms"),
        ("rest_steps_instead", "  steps of rest instead"),
        ("rest_microjoules", "  those would take, uJ"),
        ("rest_milliseconds", "  those would take, ms"),
    ):
        value = clearing.get(key)
        if isinstance(value, Estimate):
            yield estimated(text, value)
        elif value is not None:
            yield _exactly(text, f"{value:,}")


def title_of(target: str) -> str:
    """A board's name for people."""
    return BOARDS[target].title if target in BOARDS else target


def modelled(costs: Modelled, figures: BoardFigures) -> Table:
    """The costs of a query on a board."""
    parts = sorted(figures.dynamic_by_component.items(), key=lambda item: -item[1].nominal)
    static, in_use = f"static energy, apart, mJ ({costs.chips} chips)", next(iter(figures.io_milliseconds_by_way))
    rows = [
        estimated("dynamic energy, uJ", figures.dynamic_microjoules),
        *(estimated(f"  {named(name)}", value) for name, value in parts),
        estimated("time on the chip, ms", figures.milliseconds),
        estimated("  one step, us", figures.step_microseconds),
        estimated(f"{static}, time on the chip", figures.static_millijoules),
    ]
    for way, value in figures.io_milliseconds_by_way.items():
        rows.append(estimated(f"host I/O, apart, ms: {way}{' (in use)' if way == in_use else ''}", value))
    for way, value in figures.io_microjoules_by_way.items():
        use = "in use, contained above" if way == in_use else "instead"
        rows.append(estimated(f"input on the chip, uJ: {way} ({use})", value))
    rows += [
        estimated("time with host I/O, ms (high: nothing overlaps)", figures.wall_milliseconds),
        estimated(f"{static}, that time", figures.wall_static_millijoules),
        *_clearing(costs.clearing),
    ]
    return Table(
        title=f"modelled for {title_of(costs.target)}: a query of {costs.steps} steps, input {costs.input_mode}",
        columns=("modelled", "modelled low", "modelled nominal", "modelled high"),
        rows=rows,
        strong=frozenset({0, 1 + len(parts)}),
        notes=(f"Modelled, not measured. {cores_in_use(costs)}{_busy(figures.busiest)}",),
    )


def cores_in_use(costs: Modelled) -> str:
    """Cores and tiles in use."""
    cores = "1 core" if costs.cores == 1 else f"{costs.cores} cores"
    if costs.tiles is None:
        return f"{cores}."
    return f"{cores} on {'1 tile' if costs.tiles == 1 else f'{costs.tiles} tiles'}."


def _busy(shares: dict[str, float]) -> str:
    """The share of steps in which the board waits for messages, and for neurons."""
    arriving = percent(shares["receive"])
    return f" In {arriving} % of the steps the board waits for what arrives at a core, else for a core's neurons."


def asked(row: QueryVariants) -> Table:
    """Cost of a query in several views, with adaptation, or under gains."""
    cells: list[tuple[str, ...]] = []
    for name, board in row.boards.items():
        title = title_of(name)
        cells.append(_exactly(f"{title}: presentations", f"{board.presentations:,}"))
        cells.append(_exactly(f"{title}: registers written", f"{board.registers:,}"))
        if board.dynamic_microjoules is not None:
            cells.append(estimated(f"{title}: dynamic energy, uJ, modelled", board.dynamic_microjoules))
            cells.append(estimated(f"{title}: time on the chip, ms, modelled", board.milliseconds))
            cells.append(estimated(f"{title}: host I/O, apart, ms, modelled", board.io_milliseconds))
    how = f"in {row.views} views" if row.views > 1 else "in one view"
    if row.adapted is not None:
        gained = "" if row.adapt is not None else " and gains"
        cells.append(_exactly("this machine: multiply-adds for biases, at most", f"{row.multiply_adds:,}"))
        cells.append(_exactly(f"this machine: time of biases{gained}, ms, measured", figure(row.host_milliseconds)))
        how += ", under gains" if gained else f", adapted over {row.adapt:g} queries"
    note = "Each view is a presentation. All other tables are of queries that are presented once, not adapted."
    return Table(("what", "low", "nominal", "high"), cells, (note,), f"a query {how}")


def gains(row: GainsCost, queries: int) -> Table:
    """Cost of gains of inputs: work of the host, registers and weights."""
    query, once = "a query", "when the season in them changes"
    cells = [("inputs with a gain below 15", figure(row.lessened), "mean of the queries")]
    if row.weights:
        cells += [
            ("board: weights rewritten", f"{row.weights:,}", once),
            ("board: bytes of these", f"{row.weight_bytes:,}", once),
        ]
        note = "Gains are in the weights: a query takes no product and no register for them. Indices of rows left out."
    else:
        cells += [
            ("host: products of activity and gain", figure(row.products), query),
            ("host: bytes of gains", f"{row.gain_bytes:,}", f"an epoch, of {row.epochs:,} in {queries:,} queries"),
            ("board: registers of biases", f"{row.bias_registers:,}", query),
            ("board: bytes sent for these", f"{row.bias_bytes:,}", query),
        ]
        note = (
            "Biases and gains are timed as a drive makes them that learns, what teaches left out; counted are those of "
            "the file. That a board takes a word of 4 bytes for each bias is unproven."
        )
    return Table(("what", "counted", "how often"), cells, (note,), "what gains take, counted")


def asked_for(bench: Bench) -> list[Table]:
    """Tables of optional parts of a run: views and adaptation, gains, a spiking front end."""
    found = [] if bench.asked is None else [asked(bench.asked)]
    found += [] if bench.gains is None else [gains(bench.gains, bench.images)]
    return found + [table for costs in bench.front_end.values() for table in front_end.tables(costs)]
