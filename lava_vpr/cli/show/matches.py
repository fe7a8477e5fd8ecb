"""The table of matches: its columns, and its rows as CSV or JSON lines; one match as a sentence."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.matching.answers import Answers, Candidates
from lava_vpr.model import Model
from lava_vpr.positions.frames import LAT_LON, Positions, columns
from lava_vpr.positions.stamps import shown_stamp
from lava_vpr.storage.tables import csv_line, json_line
from lava_vpr.traverse import Traverse
from lava_vpr.truth.alignment import Located


class Some(NamedTuple):
    """Some queries in order, and what is said of each.

    Attributes:
        model: The model that answered.
        images: The queries.
        answers: Its answers.
        accepted: Which of them are accepted, bool (n,).
    """

    model: Model
    images: Traverse
    answers: Answers
    accepted: NDArray[np.bool_]

    def matched(self, cells: Callable[[int], object], otherwise: object = "") -> list[object]:
        """A cell of each query's matched place, by its number; ``otherwise`` without a match."""
        return [cells(match) if match >= 0 else otherwise for match in self.answers.matches.tolist()]


class Column(NamedTuple):
    """A column: its name, its cells for some queries, and what a cell is in JSON, where an empty one is null."""

    name: str
    cells: Callable[[Some], Iterable[object]]
    value: Callable[[str], object] = str


ALWAYS = (
    Column("query", lambda some: some.images.indices.tolist(), int),
    Column("query_name", lambda some: some.images.names),
    Column("place", lambda some: some.matched(lambda place: int(some.model.place_indices[place]), -1), int),
    Column("place_name", lambda some: some.matched(lambda place: some.model.place_names[place])),
    Column("confidence", lambda some: _if_matched(some, map(_confidence, some.answers.confidence.tolist())), float),
    Column(
        "accepted", lambda some: [str(good).lower() for good in some.accepted.tolist()], lambda cell: cell == "true"
    ),
    Column("probability", lambda some: _if_matched(some, map(_probability, some.answers.probability.tolist())), float),
)
"""The columns that every table has; a query without match has place -1, no name, no confidence and no probability."""


@dataclass(frozen=True)
class Table:
    """What is said of every query.

    Attributes:
        columns: The columns but those of candidates, in order.
        top: Number of best places that are named; 1: only the match.
        chances: Whether the probability of each of them is known.
    """

    columns: tuple[Column, ...]
    top: int = 1
    chances: bool = False

    def csv_header(self) -> str:
        """The first line of a CSV file."""
        return csv_line([*(column.name for column in self.columns), *candidate_columns(self.top, self.chances)])

    def csv(self, some: Some) -> str:
        """A line of CSV for each of some queries."""
        cells = zip(*(column.cells(some) for column in self.columns), strict=True)
        named = self.candidates(some)
        return "".join(csv_line([*row, *self._further(best)]) for row, best in zip(cells, named, strict=True))

    def json(self, some: Some) -> str:
        """A line of JSON for each of some queries: the columns by their names, and a list of candidates."""
        lines = []
        cells = zip(*(map(str, column.cells(some)) for column in self.columns), strict=True)
        for row, best in zip(cells, self.candidates(some), strict=True):
            texts = zip(self.columns, row, strict=True)
            values = {column.name: column.value(cell) if cell else None for column, cell in texts}
            lines.append(json_line(values | ({"candidates": best} if self.top > 1 else {})))
        return "".join(lines)

    def candidates(self, some: Some) -> list[list[dict[str, object]]]:
        """The best places of each query, best first; none of who matches none."""
        found = some.answers.candidates
        if found is None or self.top == 1:
            return [[] for _ in range(len(some.accepted))]
        return [list(named(some.model, found, query)) for query in range(len(some.accepted))]

    def _further(self, best: list[dict[str, object]]) -> list[object]:
        """The cells of a query's candidates; the first one's place and name stand in columns of their own."""
        if self.top == 1:
            return []
        keys = [*_FURTHER, *(("probability",) if self.chances else ())]
        cells: list[object] = [best[0]["score"] if best else ""]
        for rank in range(1, self.top):
            cells += [best[rank][key] if rank < len(best) else "" for key in keys]
        return cells


_FURTHER = ("place", "place_name", "score")


def candidate_columns(top: int, chances: bool) -> list[str]:
    """The names of the columns that tell the ``top`` best places, with or without the probability of each."""
    if top == 1:
        return []
    keys = [*_FURTHER, *(("probability",) if chances else ())]
    return ["score", *(f"{key}_{rank}" for rank in range(2, top + 1) for key in keys)]


def named(model: Model, candidates: Candidates, query: int) -> Iterable[dict[str, object]]:
    """The candidates of one query as JSON tells them."""
    for place, score, chance in zip(*(array[query].tolist() for array in candidates), strict=True):
        if place >= 0:
            yield {
                "place": int(model.place_indices[place]),
                "place_name": model.place_names[place],
                "score": score,
                "probability": None if math.isnan(chance) else round(chance, 6),
            }


def columns_of(model: Model, queries: Traverse) -> tuple[Column, ...]:
    """The columns of a table: further ones follow those that are always there, where there is something to say.

    Of the matched place its position, in the model's frame; of the query its time, in seconds; and the metres between
    the two positions.

    Raises:
        InputError: the model's positions and the queries' cannot be compared.
    """
    further: list[Column] = []
    places = model.whereabouts
    if places is not None:
        further += [Column(name, _coordinate(places, axis), float) for axis, name in enumerate(columns(places.frame))]
    if queries.stamps is not None:
        further.append(Column("time", lambda some: map(shown_stamp, _stamps(some)), float))
    if places is not None and queries.positions is not None:
        Located.of(places, queries.positions, queries.source)  # before the work
        further.append(Column("error_m", lambda some: _if_matched(some, _errors(some, places)), float))
    return (*ALWAYS, *further)


def sentences(table: Table, some: Some, least: float) -> str:
    """What is said of one query, for a person: where it was taken, how likely that is, and the candidates.

    Args:
        table: The table of which this would be a row.
        some: The query.
        least: The probability from which on a match is accepted; NaN where that is not what decides.
    """
    (row,) = zip(*(map(str, column.cells(some)) for column in table.columns), strict=True)
    cells = {column.name: cell for column, cell in zip(table.columns, row, strict=True)}
    (best,) = table.candidates(some)
    if some.answers.matches[0] < 0:
        return f"{cells['query_name']} matches no place of the map.\n"
    good = bool(some.accepted[0])
    at = [f"{name} {cells[name]}" for name in ("x", "y", "lat", "lon") if name in cells]
    where = f" at {', '.join(at)}" if at else ""
    chance = some.answers.probability[0]
    sure = "" if math.isnan(chance) else f"probability {chance:.0%}"
    if math.isnan(least):
        sure += f"{', ' if sure else ''}confidence {float(some.answers.confidence[0]):.3g}"
    elif not good:
        why = f"less than the {least:.0%} from which on it is accepted" if least <= 1 else "and none is enough"
        sure += f", {why} for this precision"
    shows = "shows" if good else "may show"
    verdict = "accepted" if good else "not accepted"
    text = f"{cells['query_name']} {shows} place {cells['place']} ({cells['place_name']}){where}: {verdict}, {sure}.\n"
    for rank, candidate in enumerate(best[1:], start=2):
        chance = candidate["probability"]
        likely = "" if chance is None else f", probability {chance:.0%}"
        text += (
            f"{rank}. place {candidate['place']} ({candidate['place_name']}): score {candidate['score']:.4g}{likely}\n"
        )
    return text


def _confidence(value: float) -> str:
    """A confidence in full; none of an image without a spike, which a filter may place all the same."""
    return repr(value) if math.isfinite(value) else ""


def _probability(value: float) -> str:
    """A probability to six digits, where it is known."""
    return "" if math.isnan(value) else f"{value:.6f}"


def _if_matched(some: Some, cells: Iterable[str]) -> list[str]:
    """``cells``, empty where there is no match."""
    return [cell if match >= 0 else "" for cell, match in zip(cells, some.answers.matches.tolist(), strict=True)]


def _coordinate(places: Positions, axis: int) -> Callable[[Some], list[object]]:
    """The cells of one coordinate of the matched places: metres to a centimetre, degrees as finely."""
    digits = 7 if places.frame == LAT_LON else 2
    return lambda some: some.matched(lambda place: f"{places.values[place, axis]:.{digits}f}")


def _stamps(some: Some) -> list[float]:
    return [] if some.images.stamps is None else some.images.stamps.tolist()


def _errors(some: Some, places: Positions) -> list[str]:
    """Metres from each query to its matched place."""
    if some.images.positions is None:
        return []
    located = Located.of(places, some.images.positions, some.images.source)
    return [f"{metres:.2f}" for metres in located.errors(some.answers.matches).tolist()]
