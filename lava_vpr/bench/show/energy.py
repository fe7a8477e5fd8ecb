"""The table that a benchmark leads with: all the energy of a query, by every way to answer it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from lava_vpr.bench.energy import AnsweringWay
from lava_vpr.bench.show.tables import title_of
from lava_vpr.deploy.boards.constants import HOST_POWER
from lava_vpr.deploy.boards.estimate import LEVELS, Estimate
from lava_vpr.show.numbers import figure, percent, ranged
from lava_vpr.show.table import Table

TITLES = {
    "host": "this network, no board",
    "cosine": "cosine, no network",
    "sad": "SAD, no network",
    "hog": "HOG, no network",
}
WATTS = ", ".join(f"{HOST_POWER.at(level) / 1e3:g}" for level in LEVELS)

ROWS: tuple[tuple[str, Callable[[AnsweringWay], Estimate | None]], ...] = (
    ("board, dynamic, modelled", lambda way: way.dynamic),
    ("board, static while its chips work, modelled", lambda way: way.static),
    ("board, static in host I/O after that, modelled", lambda way: way.io_static),
    ("processor, match or its part of it, timed here", lambda way: way.work),
    ("all but the encoding", lambda way: way.without_encoding),
    ("processor, encoding of the image, timed here", lambda way: way.encoding),
    ("all of it", lambda way: way.whole),
)
STRONG = ("all but the encoding", "all of it")

NOTE = (
    "Nominal (low to high). Board: modelled, all its chips, used or not. Processor: median time of single queries on "
    f"one thread of this machine, measured, times an assumed {WATTS} W. Its idle power, packing for USB, and a camera "
    "are in no figure."
)


def table(ways: Sequence[AnsweringWay], titles: Sequence[str] | None = None) -> Table:
    """The table, a column for each way; without ways it has no rows, without a board none of boards.

    Args:
        ways: Every way to answer a query.
        titles: Their headings; None: by their names.
    """
    heads = titles or [TITLES.get(way.name, title_of(way.name).partition(" (")[0]) for way in ways]
    rows = [("R@1, percent", *(percent(way.recall) for way in ways))]
    rows += [(name, *(ranged(of(way)) for way in ways)) for name, of in ROWS if any(of(way) for way in ways)]
    times = (("processor's time, ms: match or its part", "work"), ("processor's time, ms: encoding", "encoding"))
    rows += [(text, *(figure(getattr(way, f"{name}_milliseconds")) for way in ways)) for text, name in times]
    return Table(
        title="energy of a query, all of it, uJ",
        columns=("energy, uJ", *heads),
        rows=tuple(rows) if ways else (),
        strong=frozenset(k for k, row in enumerate(rows) if row[0] in STRONG),
        notes=(NOTE,),
    )
