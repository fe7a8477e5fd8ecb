"""The terminal's tables of `lava-vpr bench`: the main figures, without their parts."""

from __future__ import annotations

from collections.abc import Sequence

from lava_vpr.bench.results import AnsweringWay, Bench, BoardFigures, Modelled
from lava_vpr.bench.show.costs import asked_for, cores_in_use, estimated, title_of
from lava_vpr.bench.show.json_values import absent
from lava_vpr.bench.show.tables import WATTS, heading, on_boards, peers, recall, sweep, timings
from lava_vpr.show.numbers import percent, ranged
from lava_vpr.show.table import Table


def energy(ways: Sequence[AnsweringWay]) -> Table:
    """All the energy of a query, a row for each way to answer it."""
    rows = []
    for way in ways:
        board = "" if way.dynamic is None else ", partly modelled"
        rows.append((heading(way.name) + board, percent(way.recall), ranged(way.whole)))
    notes = (
        f"Nominal (low to high). Processor: time measured here, at an assumed {WATTS}.",
        "Board: modelled, not measured.",
    )
    return Table(("a whole query", "R@1, percent", "energy, uJ"), rows, notes, "energy of a query, all of it")


def modelled(costs: Modelled, figures: BoardFigures) -> Table:
    """The costs of a query on a board."""
    rows = (
        estimated("dynamic energy, uJ", figures.dynamic_microjoules),
        estimated("time on the chip, ms", figures.milliseconds),
        estimated("  one step, us", figures.step_microseconds),
        estimated("time with host I/O, ms", figures.wall_milliseconds),
        estimated("static energy of that time, mJ", figures.wall_static_millijoules),
    )
    title = f"modelled for {title_of(costs.target)}: a query of {costs.steps} steps"
    return Table(("modelled, not measured", "low", "nominal", "high"), rows, (cores_in_use(costs),), title)


def on_terminal(bench: Bench) -> list[Table | str]:
    """Tables in order: recall first, the energy of a query, what was measured, what is modelled, tables of options;
    then lines on missing figures, and where the details are."""
    shown = [recall(bench), energy(bench.energy), timings(bench.measured), on_boards(bench.measured)]
    shown += [modelled(costs, costs.figures) for costs in bench.targets.values() if costs.figures]
    shown += [*asked_for(bench), peers(bench.peers), sweep(bench.sweep, bench.energy)]
    return [
        *(table for table in shown if table.rows),
        *(f"absent: {row['what']}: {row['reason']}" for row in absent(bench)),
        "parts of energy and time, counted events, thresholds and workload metrics: --report DIR or --json FILE",
    ]
