"""The table as plain text cells, which terminal, Markdown and page only render."""

from __future__ import annotations

from lava_vpr.paper_table.run import DatasetRows, MethodRow, PaperTable, counted
from lava_vpr.paper_table.sections import FIGURES
from lava_vpr.show.numbers import NONE, percent
from lava_vpr.show.table import Table

RULES = (
    "R@100P released: as the paper's code counts it, by 99 thresholds on the scores, a rejected query missing at its "
    "threshold alone; exact: every query counts, by each method's own confidence."
)
COLUMNS = ("method", "printed", "R@100P released", "lowest to highest", "R@100P exact", "R@1", "AUC", "sections")


def conditions(part: DatasetRows) -> str:
    """What is learned and recognised here, and by the paper, in sentences."""
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
    """The methods of a dataset: printed, recomputed, and their spread over sections."""
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
    spread = "" if released.deviation is None else f" ± {percent(released.deviation)}"
    values = released.by_seed.values()
    return (
        row.method.title,
        printed,
        percent(released.mean) + spread,
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


def absent(table: PaperTable) -> Table | None:
    """The datasets of which there are no images, with what the paper prints; None if all are there."""
    parts = [part for part in table.parts if part.source is None]
    if not parts:
        return None
    named = [row for row in parts[0].rows if row.printed is not None]
    rows = []
    for part in parts:
        printed = {row.method.name: percent(row.printed) for row in part.rows}
        why = next(row.absent for row in part.rows)
        rows.append((part.dataset.title, *(printed[row.method.name] for row in named), why or ""))
    columns = ("dataset", *(row.method.title for row in named), "why")
    return Table(columns, rows, title="absent: R@100P as printed, percent", long=frozenset({len(columns) - 1}))


def tables(table: PaperTable) -> list[Table]:
    """All tables in order."""
    found = []
    for part in table.parts:
        if part.source is not None:
            found.append(summary(part))
            if any(len(row.sections) > 1 for row in part.rows):
                found.append(by_section(part, "released", "R@100P released"))
                found.append(by_section(part, "recall_at_1", "R@1"))
    last = absent(table)
    return found if last is None else [*found, last]
