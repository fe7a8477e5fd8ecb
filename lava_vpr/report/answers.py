"""The page of ``query --report``: each query beside its matched place, with the probability of the match.

The page needs no ground truth. It uses the sections of the evaluation report.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.matching.probability import ASSUMED, UNREACHED
from lava_vpr.report import layers, season
from lava_vpr.report.data import MapData
from lava_vpr.report.layers import Layers
from lava_vpr.report.plots import Mark, followed_drive, route_map
from lava_vpr.report.season import Trusted
from lava_vpr.report.sections import bars, heights, sheets
from lava_vpr.show.numbers import counted
from lava_vpr.show.page import Section, reproduction, sheet
from lava_vpr.show.templates import plain, render, safe, text


@dataclass(frozen=True, eq=False)
class AnswersData:
    """The data of the page for n queries.

    Attributes:
        command: Command line that makes the page again.
        summary: Short facts by name, in order.
        query_names, query_numbers: File name and absolute index of each query.
        query_thumbnails: uint8 (n, h, w, 3), BGR.
        place_names, place_numbers: File name and absolute index of each place of the map.
        place_thumbnails: uint8 (places, h, w, 3), BGR.
        matches: Matched place of each query, an index of the places' arrays, -1 for none, int64 (n,).
        accepted: Whether each match is accepted, bool (n,).
        probability: Probability that each match is right, float64 (n,); NaN where it is not known.
        confidence: Confidence of each match, float64 (n,).
        least: Probability threshold of accepted matches, inf if none reaches the target precision; NaN if something
            else decides.
        off_map, followed: A forward filter's probabilities that the query is off the map, and that the filter follows
            the robot, float64 (n,) each; None without a filter.
        map: Where places and queries were taken; None if the positions of the places are not known.
        season: The gains after the last query; None if all inputs count alike.
        layers: The spikes of the front end for one query; None without a spiking front end.
    """

    command: str
    summary: Mapping[str, str]
    query_names: tuple[str, ...]
    query_numbers: NDArray[np.int64]
    query_thumbnails: NDArray[np.uint8]
    place_names: tuple[str, ...]
    place_numbers: NDArray[np.int64]
    place_thumbnails: NDArray[np.uint8]
    matches: NDArray[np.int64]
    accepted: NDArray[np.bool_]
    probability: NDArray[np.float64]
    confidence: NDArray[np.float64]
    least: float
    off_map: NDArray[np.float64] | None = None
    followed: NDArray[np.float64] | None = None
    map: MapData | None = None
    season: Trusted | None = None
    layers: Layers | None = None

    @property
    def probable(self) -> bool:
        """Whether any probability is known."""
        return bool(np.isfinite(self.probability).any())

    @property
    def refused(self) -> int:
        """Number of matches that reach the threshold but are not accepted, because their images are doubtful."""
        return int(np.count_nonzero((self.probability >= self.least) & (self.matches >= 0) & ~self.accepted))

    @property
    def what(self) -> str:
        """The measure of certainty that the page shows: ``probability`` or ``confidence``."""
        return "probability" if self.probable else "confidence"

    @property
    def marks(self) -> tuple[Mark, ...]:
        """The marks of matched queries in drawings, accepted or not."""
        there = self.matches >= 0
        return (
            Mark("open", "muted", "s", there & ~self.accepted),
            Mark("accepted", "right", "o", there & self.accepted),
        )


def _header(data: AnswersData) -> str:
    """The head of the page: the number of accepted matches, and the rule that accepts them."""
    said = ""
    if math.isfinite(data.least):
        but = f", but for {counted(data.refused, 'doubtful image')}" if data.refused else ""
        said = f"Matches of a probability of {100 * data.least:.1f} % or more are accepted{but}. {ASSUMED}"
    elif math.isinf(data.least):
        said = UNREACHED
    elif not data.probable:
        said = "The probability of these matches is not known."
    facts = "".join(f"<div><dt>{safe(k)}</dt><dd>{safe(v)}</dd></div>" for k, v in data.summary.items())
    accepted, queries = int(data.accepted.sum()), len(data.matches)
    return render("answers_header.html", accepted=str(accepted), queries=str(queries), said=said, facts=facts)


def _in_order(data: AnswersData) -> str:
    """The section with a bar for each query, in order."""
    tops = 0.03 + 0.95 * np.nan_to_num(data.probability) if data.probable else heights(data.confidence)
    line = 0.03 + 0.95 * data.least if data.probable and math.isfinite(data.least) else None
    alt = f"{data.what.capitalize()} of {len(tops)} matches, {int(data.accepted.sum())} of them accepted"
    drawing = bars(tops, np.where(data.accepted, "r", "n"), line, alt)
    dashed = "" if line is None else "; on or above the dashed line it is accepted"
    dashed += ", unless the image is doubtful" if line is not None and data.refused else ""
    return render("answers_order.html", what=data.what, line=dashed, drawing=drawing)


def _drive(data: AnswersData) -> str:
    """The drawing of the drive through the map; empty without a filter."""
    if data.off_map is None or data.followed is None:
        return ""
    numbers = np.where(data.matches >= 0, data.place_numbers[data.matches], -1)
    alt = f"Matched places of {len(numbers)} images in order, with the probability of being off the map"
    drawing = followed_drive(numbers, data.marks, data.off_map, data.followed, alt)
    return f'<div class="panel scroll">{drawing}</div>'


def _map(data: AnswersData) -> str:
    """The drawing of the map; empty if positions are not known."""
    if data.map is None:
        return ""
    alt = f"Map of {len(data.map.places)} places and of the matches of {len(data.matches)} images"
    return f'<div class="panel scroll map">{route_map(data.map, data.matches, data.marks, alt)}</div>'


def _payload(data: AnswersData, places: NDArray[np.intp], sheets: dict[str, Any]) -> str:
    """The script's data, as JSON that is safe within its element; ``places``: those on the contact sheet."""
    known = data.probability if data.probable else data.confidence
    shown = [f"{100 * p:.1f} %" if data.probable else f"{p:.3g}" for p in known.tolist()]
    content = {
        "queries": [f"{k} · {plain(n)}" for k, n in zip(data.query_numbers.tolist(), data.query_names, strict=True)],
        "places": [f"{data.place_numbers[k]} · {plain(data.place_names[k])}" for k in places.tolist()],
        "match": np.where(data.matches >= 0, np.searchsorted(places, data.matches), -1).tolist(),
        "accepted": data.accepted.tolist(),
        "what": data.what,
        "shown": shown,
        "rank": np.argsort(np.argsort(-np.nan_to_num(known, nan=-1.0, neginf=-1e300), kind="stable")).tolist(),
        **sheets,
    }
    return json.dumps(content, ensure_ascii=True, separators=(",", ":")).replace("<", "\\u003c")


def page(data: AnswersData) -> str:
    """The whole page as HTML text; equal data give equal text."""
    places = np.unique(data.matches[data.matches >= 0])
    some = places if len(places) else np.zeros(1, np.intp)  # a contact sheet needs at least one image
    found, style = sheets(data.query_thumbnails, data.place_thumbnails[some])
    parts = (
        Section("order", "In order", [_in_order(data)]),
        Section("drive", "Drive", [_drive(data)], "Through the map", _DRIVE),
        Section("map", "Map", [_map(data)], "Map", _MAP.format(_of_positions(data.map))),
        Section("pairs", "Pairs", [render("answers_pairs.html", what=data.what)]),
        layers.section(data.layers),
        season.section(data.season),
        reproduction(data.command),
    )
    script = f"\n{text('sprite.js')}\n{text('answers.js')}\n"
    title = "Where these images were taken"
    style = f"\n{text('answers.css')}\n{style}"
    return sheet(title, _header(data), parts, style=style, payload=_payload(data, places, found), script=script)


_DRIVE = (
    "Above: the matched place of each image; ring: accepted, square: not accepted. Below: the probability that the "
    "image is off the map (line), and that the filter follows the robot (dashed)."
)
_MAP = (
    "Dots joined by a line: the places along the route. {} Ring: accepted; square: not accepted. Metres count from the "
    "middle of the map."
)


def _of_positions(data: MapData | None) -> str:
    """A sentence about where the map shows the images: where they were taken, or else at their matches."""
    if data is None or not data.figures:
        return "Each image stands at the place that it was matched with."
    figures = data.figures
    return f"A line leads from each image to its match. {figures[:1].upper()}{figures[1:]}."
