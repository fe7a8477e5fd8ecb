"""What a study found as JSON values, and as a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lava_vpr.configfile import to_dict
from lava_vpr.experiments.grid import Row, Spread
from lava_vpr.experiments.task import BOARD, COSTED, FACTS, MODELLED, NETWORK
from lava_vpr.matching.evaluation import Recall, titles
from lava_vpr.show.numbers import NONE, count, figure, named, percent
from lava_vpr.show.table import Table
from lava_vpr.studies.study import StudyRequest

SHARES = ("covered", "removed")
"""Facts that are shares, shown in percent; all others are counts."""
SHOWN = ("board_microjoules", "milliseconds")
"""Costs beside recall: never the dynamic energy without the rest."""


def as_json(asked: StudyRequest, rows: Sequence[Row]) -> dict[str, Any]:
    """The figures in the layout that scripts rely on: fractions in 0..1, None where nothing can be computed."""
    return {
        "study": asked.study.name,
        "varied": asked.study.varied,
        "places": asked.route.places,
        "queries": len(asked.route.queries),
        "seeds": list(asked.seeds),
        "board": BOARD.name,
        "settings": {key: value for key, value in to_dict(asked.config).items() if key != "seed"},
        "points": [_point(row) for row in rows],
    }


def baselines_of(row: Row) -> list[str]:
    """The groups of figures that are those of baselines."""
    return [group for group in row.figures if group not in (NETWORK, MODELLED, FACTS)]


def _point(row: Row) -> dict[str, Any]:
    """A row: whatever has a deviation with its spread, all else by its mean."""
    return {
        "point": row.label,
        "value": row.value,
        NETWORK: _spreads(row, NETWORK),
        "baselines": {name: _means(row, name) for name in baselines_of(row)},
        MODELLED: _means(row, MODELLED) if MODELLED in row.figures else None,
        FACTS: _spreads(row, FACTS),
    }


def _means(row: Row, group: str) -> dict[str, float]:
    return {name: value.mean for name, value in row.figures[group].items()}


def _spreads(row: Row, group: str) -> dict[str, Any]:
    return {name: value.as_json() for name, value in row.figures.get(group, {}).items()}


def table(asked: StudyRequest, rows: Sequence[Row]) -> Table:
    """The table of a study: recall with its spread over seeds, then facts, baselines and modelled costs."""
    facts = tuple(dict.fromkeys(name for row in rows for name in row.figures.get(FACTS, ())))
    baselines = tuple(dict.fromkeys(name for row in rows for name in baselines_of(row)))
    costs = ("board uJ, modelled", "chip ms, modelled") if any(MODELLED in row.figures for row in rows) else ()
    lines = []
    for row in rows:
        cells = [row.label, *(shared(row.figures[NETWORK][name]) for name in Recall._fields)]
        cells += [(percent if name in SHARES else count)(row.mean(FACTS, name)) for name in facts]
        cells += [_three(row, name) for name in baselines]
        cells += [figure(row.mean(MODELLED, name)) for name in SHOWN] if costs else []
        lines.append(tuple(cells))
    off = "1 place" if asked.tolerance == 1 else f"{asked.tolerance} places"
    correct = f"matches at most {off} off" if asked.tolerance else "exact matches"
    note = f"Recall in percent, {correct}, mean of seeds {', '.join(map(str, asked.seeds))}"
    note += ", ± their standard deviation." if len(asked.seeds) > 1 else "."
    if baselines:
        note += f" Baselines: {' / '.join(titles())}."
    if costs:
        note += (
            f" Energy of a query on the board (static for as long as it works and waits for the host, and dynamic) and "
            f"time on the chip: modelled for {BOARD.title}, nominal; encoding and the host's own work come on top "
            f"(bench); seed {asked.seeds[0]}, first {COSTED} queries."
        )
    numbers = f"{len(asked.route.queries)} queries, {asked.route.places} places, preset {asked.config.preset}"
    columns = (asked.study.varied, *titles(), *map(named, facts), *baselines, *costs)
    return Table(columns, lines, (note, asked.study.note), f"{asked.study.title.lower()}: {numbers}")


def shared(value: Spread) -> str:
    """A fraction in percent, with its deviation, if there is one."""
    return percent(value.mean) if value.deviation is None else f"{percent(value.mean)} ± {percent(value.deviation)}"


def _three(row: Row, baseline: str) -> str:
    return " / ".join(map(percent, _means(row, baseline).values())) if baseline in row.figures else NONE
