"""The table as JSON values and as CSV; equal results give equal bytes, and none holds a path or a time."""

from __future__ import annotations

from typing import Any

from lava_vpr.paper_table.printed import DOI
from lava_vpr.paper_table.run import DatasetRows, MethodRow, PaperTable
from lava_vpr.paper_table.sections import FIGURES
from lava_vpr.show.table import Table

HEADER = ("dataset", "method", "section", *FIGURES, "printed", "absent")


def as_json(table: PaperTable) -> dict[str, Any]:
    """The table in the layout that scripts rely on: fractions in 0..1, None where there is nothing."""
    return {
        "doi": DOI,
        "seed": table.wanted.seed,
        "epochs": table.wanted.epochs,
        "datasets": [_part(part) for part in table.parts],
    }


def _part(part: DatasetRows) -> dict[str, Any]:
    source = part.source
    return {
        "dataset": part.dataset.name,
        "sections_of_the_paper": part.dataset.sections,
        "places_of_a_section": part.dataset.places,
        "paper": {"learned": list(part.dataset.learned), "recognised": part.dataset.recognised},
        "here": None
        if source is None
        else {
            "learned": list(source.learned),
            "recognised": source.recognised,
            "official": source.official,
            "places": source.places,
        },
        "rows": [_row(row) for row in part.rows],
    }


def _row(row: MethodRow) -> dict[str, Any]:
    return {
        "method": row.method.name,
        "printed": row.printed,
        "absent": row.absent,
        "not_computed": list(row.left),
        "mean": {name: row.figures[name].mean if row.figures else None for name in FIGURES},
        "deviation": {name: row.figures[name].deviation if row.figures else None for name in FIGURES},
        "sections": {str(k): {name: row.figures[name].by_seed[k] for name in FIGURES} for k in row.sections},
    }


def as_csv(table: PaperTable) -> str:
    """The table as CSV: a line for each section, then ``mean`` and ``deviation``; one line says why a row is absent."""
    lines = [line for part in table.parts for row in part.rows for line in _lines(part.dataset.name, row)]
    return Table(HEADER, lines).csv()


def _lines(dataset: str, row: MethodRow) -> list[tuple[str, ...]]:
    """The lines of a row."""
    start, printed = (dataset, row.method.name), "" if row.printed is None else f"{row.printed:g}"
    if row.absent is not None:
        return [(*start, "", *[""] * len(FIGURES), printed, row.absent)]
    spreads = [row.figures[name] for name in FIGURES]
    lines = [(*start, str(k), *(_number(one.by_seed[k]) for one in spreads), "", "") for k in row.sections]
    means, deviations = ([_number(getattr(one, of)) for one in spreads] for of in ("mean", "deviation"))
    return [*lines, (*start, "mean", *means, printed, ""), (*start, "deviation", *deviations, "", "")]


def _number(value: float | None) -> str:
    """A fraction with as many digits as sections of 100 queries have, and some more; nothing for none."""
    return "" if value is None else f"{value:.6f}"
