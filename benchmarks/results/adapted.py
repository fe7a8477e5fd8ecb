"""Adaptation to the queries before, on the five sections, on ten further ones, and of a robot that stands still."""

from __future__ import annotations

from benchmarks.figures import markdown
from benchmarks.places import sections_of
from benchmarks.results.record import SIMPLER_TITLES, Record
from benchmarks.results.rows import STANDING, TAU, Row
from benchmarks.results.sections import DEFAULT, FIVE, LEARNED, SIMPLER
from lava_vpr.config import preset

FURTHER = Row("ten further sections", preset(DEFAULT), sections_of("nordland_long", 1000), SIMPLER, adapt=True)
STILL = Row(
    f"five sections, each image {STANDING} times with noise",
    preset(DEFAULT),
    FIVE,
    ("template", "cosine"),
    adapt=True,
    standing=True,
)
TITLED = {
    "the five sections": LEARNED[DEFAULT],
    "ten further sections, which the search did not see": FURTHER,
    f"the five sections, standing still for {STANDING} frames at every place": STILL,
}
ROWS = (FURTHER, STILL)


def lines(record: Record) -> str:
    """The table: a line for each, and below it the same adapted."""
    rows = [["", "as learned", *SIMPLER_TITLES.values()]]
    for title, row in TITLED.items():
        for words, suffix in ((title, ""), (f"the same with `--adapt {TAU:g}`", ", adapted")):
            simpler = [record.cell(row, name + suffix) if name in row.matchers else "" for name in SIMPLER_TITLES]
            rows.append([words, f"**{record.cell(row, f'network{suffix}')}**", *simpler])
    return markdown(rows[0], rows[1:])
