"""The six figures of README: what a newcomer should know first, with what is simpler beside it."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.figures import markdown
from benchmarks.places import Section
from benchmarks.results import adapted, long, views
from benchmarks.results.record import Record
from benchmarks.results.rows import Row
from benchmarks.results.sections import DEFAULT, LEARNED

_HEAD = ("", "recognised (R@1)", "without learning", "`cosine`", "HOG", "SAD", "energy, modelled")


def _line(record: Record, title: str, row: Row, sections: Sequence[Section] | None = None) -> list[str]:
    """A row of the table: R@1 in percent of the network and of what is simpler, microjoules where they are computed."""
    rivals = [f"{record.mean(row, name, sections)[0]:.1f}" for name in ("template", "cosine", "hog", "sad")]
    cost = f"{record.mean(row, 'costs', sections)[0]:.1f} µJ" if row.costs else ""
    return [title, f"**{record.mean(row, sections=sections)[0]:.1f}**", *rivals, cost]


def lines(record: Record) -> str:
    """The table."""
    widest = list(views.WALKED.values())[-1]
    return markdown(
        _HEAD,
        [
            _line(record, "Nordland, 100 places, five sections", LEARNED[DEFAULT]),
            _line(record, "the same in a quarter of the time, preset `fast`", LEARNED["fast"]),
            _line(record, "Nordland, 500 places in one map", long.TITLED["500"]),
            _line(record, "Nordland, 1,500 places in one map", long.TITLED["1,500"]),
            _line(record, "Nordland, ten further sections of 100, which the search did not see", adapted.FURTHER),
            _line(record, "Gardens Point, 50 places, from the other side of the path", widest),
        ],
    )
