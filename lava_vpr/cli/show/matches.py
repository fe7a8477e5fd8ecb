"""The table of matches: its columns, and its rows as CSV or JSON lines; one match as a sentence."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from lava_vpr.cli.common import stderr
from lava_vpr.inputs.doubts import (
    BACKWARDS,
    BLANK,
    BORDER,
    GAP,
    MIRRORED,
    NO_NUMBER,
    RUN,
    STUCK,
    UPSIDE_DOWN,
    Clock,
)
from lava_vpr.matches import Match
from lava_vpr.matching.answers import Answers
from lava_vpr.model import Model
from lava_vpr.positions.frames import LAT_LON, Positions, columns, shown_stamp
from lava_vpr.storage.tables import csv_line, json_line
from lava_vpr.traverse import Traverse
from lava_vpr.truth.alignment import Located

Row = dict[str, Any]
"""The values of one query by their names: ``query``, ``query_name``, those of `Match.values`, and ``error_m``."""


class Column(NamedTuple):
    """A column: its name, and the text of a value that is known."""

    name: str
    text: Callable[[Any], str] = str


ALWAYS = (
    Column("query"),
    Column("query_name"),
    Column("place"),
    Column("place_name"),
    Column("confidence", repr),
    Column("accepted", lambda value: str(value).lower()),
    Column("probability", "{:.6f}".format),
)
"""The columns that every table has; a query without match has place -1, no name, no confidence and no probability."""


@dataclass(frozen=True)
class MatchTable:
    """A table with a row for every query.

    Attributes:
        columns: The columns but those of candidates, in order.
        top: Number of best places that are named; 1: only the match.
        chances: Whether the probability of each of them is known.
        places: Positions of the places, for the metres of error; None: unknown of them or of the queries.
    """

    columns: tuple[Column, ...]
    top: int = 1
    chances: bool = False
    places: Positions | None = None

    @classmethod
    def of(cls, model: Model, queries: Traverse, top: int, *, chances: bool) -> MatchTable:
        """The table of a model's matches: where they are known, further columns follow those that are always there.

        Of the matched place its position, in the model's frame; of the query its time, in seconds; and the metres
        between the two positions, and what only they can tell: repeated images, and why a run of them is doubtful.
        What is wrong with times follows if anything is.

        Raises:
            InputError: the model's positions and the queries' cannot be compared.
        """
        further, places = list[Column](), model.whereabouts
        if places is not None:
            text = ("{:.7f}" if places.frame == LAT_LON else "{:.2f}").format
            further += [Column(name, text) for name in columns(places.frame)]
        if queries.stamps is not None:
            further.append(Column("time", shown_stamp))
        if places is not None and queries.positions is not None:
            Located.of(places, queries.positions, queries.source)  # before the work
            further.append(Column("error_m", "{:.2f}".format))
        if queries.positions is not None:
            further += [Column("repeats"), Column("cause")]
        clock = Clock()
        if queries.stamps is not None and any([clock.fault(stamp) for stamp in queries.stamps.tolist()]):
            further.append(Column("time_fault"))
        return cls((*ALWAYS, *further), top, chances, None if queries.positions is None else places)

    def rows(self, images: Traverse, answers: Answers, matches: list[Match]) -> Iterator[Row]:
        """The rows of some queries in order.

        Args:
            images: The queries.
            answers: The model's answers to them.
            matches: The same for people.
        """
        errors: list[float] = [math.nan] * len(matches)
        if self.places is not None and images.positions is not None:
            errors = Located.of(self.places, images.positions, images.source).errors(answers.matches).tolist()
        named = zip(images.indices.tolist(), images.names, matches, errors, strict=True)
        for index, name, match, error in named:
            metres = None if math.isnan(error) else round(error, 2)
            against = {"repeats": match.repeats, "cause": match.cause, "time_fault": match.time_fault}
            yield {"query": index, "query_name": name, **match.values(), "error_m": metres, **against}

    def csv_header(self) -> str:
        """The first line of a CSV file."""
        further = [f"{key}_{rank}" for rank in range(2, self.top + 1) for key in self._keys]
        return csv_line([*(column.name for column in self.columns), *(["score"] if self.top > 1 else []), *further])

    def csv(self, row: Row) -> str:
        """A row as a line of CSV."""
        return csv_line([*self.cells(row).values(), *self._further(row["candidates"])])

    def json(self, row: Row) -> str:
        """A row as a line of JSON: the columns by their names, why the query is doubtful, a list of candidates."""
        values = {column.name: row[column.name] for column in self.columns}
        against = {name: row[name] for name in ("cause", "unlike") if row.get(name) is not None}
        return json_line(values | against | ({"candidates": row["candidates"]} if self.top > 1 else {}))

    def cells(self, row: Row) -> dict[str, str]:
        """The text of every column by its name; empty where a value is not known."""
        values = ((column, row[column.name]) for column in self.columns)
        return {column.name: "" if value is None else column.text(value) for column, value in values}

    @property
    def _keys(self) -> tuple[str, ...]:
        """Callback for each candidate."""
        return ("place", "place_name", "score", *(("probability",) if self.chances else ()))

    def _further(self, best: list[Row]) -> list[object]:
        """The cells of a query's candidates; the first one's place and name stand in columns of their own."""
        if self.top == 1:
            return []
        cells: list[object] = [best[0]["score"] if best else ""]
        for rank in range(1, self.top):
            cells += [best[rank][key] if rank < len(best) else "" for key in self._keys]
        return cells


NOTES = {
    STUCK: "show the same, though the robot moves: a stuck camera",
    BORDER: "have an empty border where the map has none",
    BLANK: "show nothing",
    MIRRORED: "are mirrored",
    UPSIDE_DOWN: "are upside down",
    BACKWARDS: "was taken before one that came before it, by its time",
    NO_NUMBER: "has a time that is no number",
    GAP: "was taken long after the one before it, by its time",
}


class Notes:
    """Tells each cause, and each fault of times, in one line on stderr when it is first met."""

    def __init__(self) -> None:
        self._told: set[str | None] = {None}

    def take(self, index: int, match: Match) -> None:
        """Look at the match of image ``index``."""
        for what in (match.cause, match.time_fault):
            if what is not None and what not in self._told:
                self._told.add(what)
                run = f"image {index}: the last {RUN} images {NOTES[what]}; none is accepted"
                stderr.print(f"warning: {run if what == match.cause else f'image {index} {NOTES[what]}'}")


def sentences(table: MatchTable, row: Row, least: float) -> str:
    """One row for a person: where the query was taken, how likely that is, and the candidates.

    Args:
        table: The table of the row.
        row: The query.
        least: The probability from which on a match is accepted; NaN where that is not what decides.
    """
    cells = table.cells(row)
    if row["place"] < 0:
        return f"{cells['query_name']} matches no place of the map.\n"
    good = bool(row["accepted"])
    at = [f"{name} {cells[name]}" for name in ("x", "y", "lat", "lon") if name in cells]
    where = f" at {', '.join(at)}" if at else ""
    chance = row["probability"]
    sure = "" if chance is None else f"probability {chance:.0%}"
    if math.isnan(least):
        confidence = -math.inf if row["confidence"] is None else row["confidence"]
        sure += f"{', ' if sure else ''}confidence {confidence:.3g}"
    elif not good and row.get("unlike") is not None:
        sure += ", but it is unlike all that the map has seen"
    elif not good:
        sure += (
            f", below the threshold of {least:.0%} (--target-precision)"
            if least <= 1
            else ", and no probability is high enough (--target-precision, --off-map)"
        )
    shows = "shows" if good else "may show"
    verdict = "accepted" if good else "not accepted"
    text = f"{cells['query_name']} {shows} place {cells['place']} ({cells['place_name']}){where}: {verdict}, {sure}.\n"
    for rank, candidate in enumerate(row["candidates"][1:], start=2):
        chance = candidate["probability"]
        likely = "" if chance is None else f", probability {chance:.0%}"
        text += (
            f"{rank}. place {candidate['place']} ({candidate['place_name']}): score {candidate['score']:.4g}{likely}\n"
        )
    return text
