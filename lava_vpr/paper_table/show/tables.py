"""The paper's table: text cells for terminal, Markdown and page, and the whole as Markdown, JSON and CSV.

Equal results give equal bytes, without paths or times.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lava_vpr.paper_table.methods import DOI
from lava_vpr.paper_table.run import DatasetRows, MethodRow, PaperRequest, counted
from lava_vpr.paper_table.sections import FIGURES
from lava_vpr.show.numbers import NONE, percent
from lava_vpr.show.table import Table
from lava_vpr.studies.show.values import shared

RULES = (
    "R@100P released is counted as by the paper's code: with 99 thresholds on the scores, and a rejected query counts "
    "as missing only at its threshold. R@100P exact counts every query, by each method's own confidence."
)
COLUMNS = ("method", "printed", "R@100P released", "lowest to highest", "R@100P exact", "R@1", "AUC", "sections")


def conditions(part: DatasetRows) -> str:
    """Sentences on what is learned and recognised here, and in the paper."""
    source, row = part.source, part.dataset
    if source is None:
        return f"The paper: {row.task}. Here: absent."
    if source.official:
        here = f"The paper's traverses, {row.task}"
    else:
        fewer = len(row.learned) - len(source.learned)
        number = f", {len(source.learned)} reference traverse instead of {len(row.learned)}" if fewer else ""
        here = f"Plain traverses in place of the official folders: {source.task}{number}; the paper: {row.task}"
    left = row.sections - source.sections
    short = f"; the images are enough for {source.sections} of its {row.sections} sections" if left else ""
    return f"{here}. {source.places:,} places{short}, {row.places} in a section, one model each; exact matches."


def summary(part: DatasetRows) -> Table:
    """The methods of a dataset: printed figures, computed ones, and their spread over sections."""
    return Table(
        COLUMNS,
        [_summary(row) for row in part.rows],
        (conditions(part),),
        f"{part.dataset.title}: percent",
        long=frozenset({7}),
    )


def _summary(row: MethodRow) -> tuple[str, ...]:
    printed = percent(row.printed)
    if row.absent is not None:
        return (row.method.title, printed, *[NONE] * 5, row.absent)
    released, *others = (row.figures[name] for name in FIGURES)
    values = released.by_seed.values()
    return (
        row.method.title,
        printed,
        shared(released),
        f"{percent(min(values))} to {percent(max(values))}",
        *(percent(one.mean) for one in others),
        counted(row.sections) + (f"; {counted(row.left)} not computed" if row.left else ""),
    )


def by_section(part: DatasetRows, figure: str, heading: str) -> Table:
    """A figure of every method, section by section."""
    rows = [row for row in part.rows if row.sections]
    numbers = sorted({number for row in rows for number in row.sections})
    cells = []
    for number in numbers:
        first, end = part.dataset.section(number)
        values = (percent(row.figures[figure].by_seed.get(number)) for row in rows)
        cells.append((f"{number} (places {first}:{end})", *values))
    columns = ("section", *(row.method.title for row in rows))
    return Table(columns, cells, title=f"{part.dataset.title}, section by section: {heading}, percent")


def absent(parts: Sequence[DatasetRows]) -> Table | None:
    """The datasets without images, with the figures that the paper prints; None if all datasets have images."""
    without = [part for part in parts if part.source is None]
    if not without:
        return None
    named = [row for row in without[0].rows if row.printed is not None]
    rows = []
    for part in without:
        printed = {row.method.name: percent(row.printed) for row in part.rows}
        why = next(row.absent for row in part.rows)
        rows.append((part.dataset.title, *(printed[row.method.name] for row in named), why or ""))
    columns = ("dataset", *(row.method.title for row in named), "why")
    return Table(columns, rows, title="absent: R@100P as printed, percent", long=frozenset({len(columns) - 1}))


def tables(parts: Sequence[DatasetRows]) -> list[Table]:
    """All tables in order."""
    found = []
    for part in parts:
        if part.source is not None:
            found.append(summary(part))
            if any(len(row.sections) > 1 for row in part.rows):
                found.append(by_section(part, "released", "R@100P released"))
                found.append(by_section(part, "recall_at_1", "R@1"))
    last = absent(parts)
    return found if last is None else [*found, last]


def markdown(wanted: PaperRequest, parts: Sequence[DatasetRows], command: str) -> str:
    """The whole page, with the command that repeats it; equal results give equal text."""
    shown = "as many epochs as each preset sets" if wanted.epochs is None else f"{wanted.epochs} epochs"
    lines = [
        "# The paper's table",
        "",
        "<!-- Written by the command below. -->",
        "",
        f"This page compares the recall at 100 % precision that Hussaini, Milford and Fischer (RA-L 2022, [doi {DOI}]"
        f"(https://doi.org/{DOI})) print, as a mean over sections, with measurements of this package: of VPRSNN's "
        "network as coded (preset `paper`) with the paper's four decoders, of SAD, of NetVLAD's vectors if they are "
        "given, and of this package's own presets and matchers on the same images. "
        f"The seed is {wanted.seed}; training takes {shown}; ± is the sample standard deviation over sections.",
        "",
        RULES,
        "",
        "```sh",
        command,
        "```",
    ]
    for one in tables(parts):
        lines += ["", f"## {one.title[0].upper()}{one.title[1:]}", ""]
        if one.notes:
            lines += [*one.notes, ""]
        lines.append(one.markdown())
    return "\n".join(lines) + "\n"


HEADER = ("dataset", "method", "section", *FIGURES, "printed", "absent")


def as_json(wanted: PaperRequest, parts: Sequence[DatasetRows]) -> dict[str, Any]:
    """The table in the layout that scripts rely on: fractions in 0..1, None where there is nothing."""
    return {
        "doi": DOI,
        "seed": wanted.seed,
        "epochs": wanted.epochs,
        "datasets": [_part(part) for part in parts],
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


def as_csv(parts: Sequence[DatasetRows]) -> str:
    """The table as CSV: a line for each section, then ``mean`` and ``deviation``; one line says why a row is absent."""
    lines = [line for part in parts for row in part.rows for line in _lines(part.dataset.name, row)]
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
