"""The report's picture sections: route, score matrices, receptive fields, spikes, matches, cost, configuration."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.report.data import MapData, Raster, ReportData, label
from lava_vpr.report.images import contact_sheet, data_uri, representatives, shrunk, strokes, weight_image
from lava_vpr.report.plots import MATRIX_BOX, held_marks, route_map, score_matrix, spike_raster
from lava_vpr.show.numbers import counted, is_number
from lava_vpr.show.templates import render, safe

_FIELDS = 20
_WRONG_SHOWN = 24
_RIGHT_SHOWN = 8
_THUMBNAIL = 320


def true_place(data: ReportData, query: int) -> int:
    """The true place nearest to the query's match, or the middle one without a match; -1: there is no true place."""
    places, match = np.flatnonzero(data.truth[query]), data.matches[query]
    if not len(places):
        return -1
    return int(places[len(places) // 2 if match < 0 else np.abs(places - match).argmin()])


def true_role(data: ReportData, query: int) -> str:
    """The caption of `true_place`: the only true place of the query, or which of several."""
    places = int(data.truth[query].sum())
    which = "the middle one" if data.matches[query] < 0 else "the nearest"
    return "True place" if places <= 1 else f"True place, {which} of {places}"


def correct_queries(data: ReportData) -> NDArray[np.bool_]:
    """Whether each query was matched to a true place, bool (n_queries,)."""
    known = data.matches >= 0
    correct = np.zeros(len(data.matches), dtype=np.bool_)
    correct[known] = data.truth[np.flatnonzero(known), data.matches[known]]
    return correct


def _place(data: ReportData, place: int) -> str:
    """A place's number and name."""
    return f"{data.place_numbers[place]} · {safe(data.place_names[place])}" if place >= 0 else "none"


def _image(images: NDArray[np.uint8], index: int, alt: str) -> str:
    """A thumbnail as HTML; ``alt`` is escaped already."""
    small = shrunk(images[index], _THUMBNAIL)
    height, width = small.shape[:2]
    return f'<img src="{data_uri(small)}" width="{width}" height="{height}" alt="{alt}">'


def _query_figure(data: ReportData, query: int) -> str:
    """A query's image above its number and name."""
    name = safe(data.query_names[query])
    image = _image(data.query_thumbnails, query, f"Query {data.query_numbers[query]}, {name}")
    return f"<figure>{image}<figcaption>Query<br>{data.query_numbers[query]} · {name}</figcaption></figure>"


def _place_figure(data: ReportData, place: int, role: str) -> str:
    """A reference image under its role, or an empty frame of the same size."""
    if place < 0:
        height, width = data.place_thumbnails.shape[1:3]
        frame = f'<div class="none" style="aspect-ratio:{width}/{height}">none</div>'
        return f"<figure>{frame}<figcaption>{role}</figcaption></figure>"
    text = _place(data, place)
    image = _image(data.place_thumbnails, place, f"{role}: place {text}")
    return f"<figure>{image}<figcaption>{role}<br>{text}</figcaption></figure>"


def _pictures(data: ReportData, query: int, place: int) -> str:
    """The query beside its match, and beside the true place if that is another."""
    pictures = _query_figure(data, query) + _place_figure(data, place, "Matched place")
    if place >= 0 and data.truth[query, place]:
        return f'<div class="duo">{pictures}</div>'
    return f'<div class="trio">{pictures}{_place_figure(data, true_place(data, query), true_role(data, query))}</div>'


def _verdict(data: ReportData, query: int, place: int) -> tuple[str, str]:
    """CSS class and words for the match of ``query`` with ``place``."""
    if place < 0:
        return "", "no match"
    if data.truth[query, place]:
        return "right", "✓ right"
    true = true_place(data, query)
    if true < 0:
        return "wrong", "✗ wrong, has no true place"
    return "wrong", f"✗ wrong by {counted(abs(true - place), 'place')}"


def _route_drawing(data: ReportData, correct: NDArray[np.bool_]) -> str:
    """Confidence of every query as bars, with the threshold above which no match is wrong."""
    tops, wrong = heights(data.confidence), (data.matches >= 0) & ~correct
    kinds = np.where(data.matches < 0, "n", np.where(correct, "r", "w"))
    alt = f"Confidence of {len(tops)} queries, {int(correct.sum())} of them right"
    return bars(tops, kinds, float(tops[wrong].max()) if wrong.any() else None, alt)


def heights(confidence: NDArray[Any]) -> NDArray[np.float64]:
    """Confidence (n,) as heights of `bars`, float64 (n,): the surest is .98 high."""
    values = np.nan_to_num(confidence.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)
    floor = min(0.0, float(values.min(initial=0.0)))
    # Confidences of distances are negative; their bars rise from the lowest one.
    span = float(values.max(initial=0.0)) - floor
    # 0.03: the bar of a query without confidence can still be pointed at.
    return 0.03 + 0.95 * (values - floor) / span if span > 0 else np.full(len(values), 0.03)


def bars(tops: NDArray[np.float64], kinds: NDArray[np.str_], line: float | None, alt: str) -> str:
    """A drawing with a bar for each query, in order.

    Args:
        tops: Heights, 0 to 1, float64 (n_queries,).
        kinds: Class of each: ``r``, ``w`` (with a mark below) or ``n``.
        line: Height of a line across the drawing, 0 to 1; None: no line.
        alt: Text alternative of the drawing.
    """
    drawn = []
    for query, (kind, top) in enumerate(zip(kinds.tolist(), tops.tolist(), strict=True)):
        drawn.append(f'<rect class="{kind}" x="{query + 0.08:g}" y="{100 - 100 * top:.4g}" width=".84" '
                     f'height="{100 * top:.4g}"/>')  # fmt: skip
        if kind == "w":
            drawn.append(f'<path class="w" d="M{query + 0.1:g} 107h.8l-.4-5z"/>')
    if line is not None:
        y = f"{100 - 100 * line:.4g}"
        drawn.append(f'<line x1="0" x2="{len(tops)}" y1="{y}" y2="{y}"/>')
    return (
        f'<svg class="route" viewBox="0 0 {max(1, len(tops))} 108" preserveAspectRatio="none" role="img" '
        f'aria-label="{alt}"><rect class="now" x="0" y="0" width="1" height="108"/>{"".join(drawn)}'
        f'<rect class="hit" x="0" y="0" width="{len(tops)}" height="108"/></svg>'
    )


def route(data: ReportData, correct: NDArray[np.bool_]) -> tuple[str, dict[str, Any], str]:
    """The section of the queries in order, in which each can be opened.

    Returns:
        The section, the data by which its script finds images, and the style that holds the images.
    """
    values, style = sheets(data.query_thumbnails, data.place_thumbnails)
    frames = "".join(
        f'<figure><div class="sheet of-{kind}" id="browse-{key}" role="img" aria-label=""></div>'
        f'<figcaption id="browse-{key}-name"></figcaption></figure>'
        for key, kind in (("query", "query"), ("match", "place"), ("truth", "place"))
    )
    last = len(data.query_names) - 1
    section = render("report_route.html", drawing=_route_drawing(data, correct), last=str(last), images=frames)
    return section, {**values, "matrixBox": list(MATRIX_BOX)}, style


def sheets(queries: NDArray[np.uint8], places: NDArray[np.uint8]) -> tuple[dict[str, Any], str]:
    """Data by which a script finds the image of a query or place on its contact sheet, and the style with both sheets.

    Args:
        queries, places: uint8 (n, h, w, 3), BGR.
    """
    of_queries, of_places = contact_sheet(queries), contact_sheet(places)
    values = {"querySheet": of_queries[1:3], "placeSheet": of_places[1:3]}
    return values, of_queries.style(".of-query") + of_places.style(".of-place")


def where(data: MapData | None, matches: NDArray[np.integer[Any]], correct: NDArray[np.bool_]) -> str:
    """The section of the map; empty if positions are not known.

    Args:
        data: Where places and queries were taken.
        matches: Place of each query, -1 for none, int (n_queries,).
        correct: Whether each match is right, bool (n_queries,).
    """
    if data is None:
        return ""
    alt = f"Map of {len(data.places)} places and {len(correct)} queries, {int(correct.sum())} of them right"
    drawing = route_map(data, matches, held_marks(matches, correct), alt)
    figures = data.figures
    return render("report_map.html", figures=safe(figures[:1].upper() + figures[1:]), drawing=drawing)


def scores(data: ReportData) -> str:
    """The section of score matrices, one for each matcher in the data; the default decoder's has its matches marked."""
    if not data.matrices:
        return ""
    panels, blocks = [], 1
    for k, (name, matrix) in enumerate(data.matrices.items()):
        if name == data.default_decoder:
            matches = data.matches
        else:
            filled = np.where(np.isfinite(matrix), matrix, -np.inf)
            # As in `lava_vpr.matching.evaluation`: a query whose scores are all 0 matches no place.
            matches = np.where((np.isfinite(matrix) & (matrix != 0)).any(axis=1), filled.argmax(axis=1), -1)
        known = np.flatnonzero(matches >= 0)
        correct = int(data.truth[known, matches[known]].sum())
        name = safe(label(name))
        alt = f"{name}: scores of {len(matrix)} queries by {matrix.shape[1]} places; {correct} best matches right"
        drawing, block = score_matrix(matrix, data.truth, matches, f"m{k}", alt)
        blocks = max(blocks, block)
        panels.append(
            f'<figure class="panel"><h3>{name}</h3><div class="matrix-box">{drawing}</div>'
            f'<p class="readout">{correct} of {len(matrix)} best matches right</p></figure>'
        )
    block_note = "" if blocks == 1 else f" Each pixel shows the best of up to {blocks} × {blocks} scores."
    return render("report_scores.html", block_note=block_note, matrices="".join(panels))


def receptive_fields(data: ReportData) -> str:
    """The section of receptive fields: weights of some neurons, spread over the route, as strokes or images."""
    neurons = representatives(data.neuron_places, _FIELDS)
    if data.weights is None or not len(neurons):
        return ""
    tiles = []
    for neuron in neurons.tolist():
        place = int(data.neuron_places[neuron])
        weights = data.weights[:, neuron]
        if data.drawing == "strokes":
            drawn = strokes(weights, data.input_layout.channels, data.input_layout.grid)
        else:
            image = data_uri(weight_image(weights, *data.input_layout[1:]), lossless=True)
            drawn = f'<img src="{image}" alt="Weights of neuron {neuron}">'
        height, width = data.place_thumbnails.shape[1:3]
        reference = _image(data.place_thumbnails, place, f"Place {_place(data, place)}")
        tiles.append(
            f'<figure class="field"><div class="pair">{reference}'
            f'<div class="drawn" style="aspect-ratio:{width}/{height}">{drawn}</div></div>'
            f"<figcaption>neuron {neuron}, place {data.place_numbers[place]}<br>"
            f"{safe(data.place_names[place])}</figcaption></figure>"
        )
    # Opaque images would hide the place.
    switch = (
        '<div class="tools"><label><input type="checkbox" id="overlay"> lay them over the image</label></div>'
        if data.drawing == "strokes"
        else ""
    )
    return render("report_fields.html", legend=safe(data.legend), switch=switch, fields="".join(tiles))


def _raster_groups(data: ReportData, raster: Raster) -> dict[str, NDArray[np.intp]]:
    """Highlighted neurons: those of the matched place, and those of the true one if that is another."""
    right = raster.place >= 0 and bool(data.truth[raster.query, raster.place])
    winners = np.flatnonzero(data.neuron_places == raster.place) if raster.place >= 0 else np.zeros(0, dtype=np.intp)
    if raster.place >= 0 and not len(winners) and len(raster.spike_neurons):
        # No neuron represents this place most; the busiest one decided the match.
        winners = np.array([np.bincount(raster.spike_neurons).argmax()])
    groups = {"right" if right else "wrong": winners}
    if not right and raster.true_place is not None:
        groups["right"] = np.flatnonzero(data.neuron_places == raster.true_place)
    return groups


def spikes(data: ReportData) -> str:
    """The section of spike rasters of a few queries, with their numbers of input and output spikes."""
    if not data.rasters:
        return ""
    unknown = len(data.place_names)
    order = np.argsort(np.where(data.neuron_places < 0, unknown, data.neuron_places), kind="stable")
    cards = []
    for k, raster in enumerate(data.rasters):
        groups = _raster_groups(data, raster)
        kind, words = _verdict(data, raster.query, raster.place)
        by_group = {c: int(np.isin(raster.spike_neurons, members).sum()) for c, members in groups.items()}
        winner = "right" if kind == "right" else "wrong"
        alt = f"Spikes of {raster.neurons} neurons in {raster.steps} steps for query {raster.query}"
        drawing = spike_raster(raster, groups, order, alt, f"r{k}")
        noun = "neuron" if len(groups[winner]) == 1 else "neurons"
        facts = [
            counted(raster.input_spikes, "input spike"),
            counted(len(raster.spike_steps), "output spike"),
            f'<span class="{winner}">{by_group[winner]} by the matched place’s {noun}</span>',
        ]
        if kind != "right" and "right" in groups:
            facts.append(f'<span class="right">{by_group["right"]} by the true place’s</span>')
        cards.append(
            f'<figure class="panel"><h3><span class="verdict {kind}">{words}</span></h3>'
            f"{_pictures(data, raster.query, raster.place)}{drawing}"
            f"<figcaption>{', '.join(facts)}</figcaption></figure>"
        )
    return render("report_spikes.html", rasters="".join(cards))


def _match_card(data: ReportData, query: int) -> str:
    """Query, matched and (if another) true reference image."""
    place = int(data.matches[query])
    kind, words = _verdict(data, query, place)
    return (
        f'<div class="panel match"><h3><span class="verdict {kind}">{words}</span><span class="note num">confidence '
        f"{data.confidence[query]:.3g}</span></h3>{_pictures(data, query, place)}</div>"
    )


def matches(data: ReportData, correct: NDArray[np.bool_]) -> str:
    """The section of matches: the most confident mistakes, then queries without a match, then some right matches."""
    rank = np.argsort(-np.nan_to_num(data.confidence.astype(np.float64), nan=-np.inf), kind="stable")
    wrong = [int(q) for q in rank if data.matches[q] >= 0 and not correct[q]]
    wrong += [int(q) for q in rank if data.matches[q] < 0]
    good = [int(q) for q in rank if correct[q]]
    half = _RIGHT_SHOWN // 2
    some = good if len(good) <= _RIGHT_SHOWN else good[:half] + good[-half:]
    shown = "".join(_match_card(data, q) for q in wrong[:_WRONG_SHOWN])
    nothing = '<p class="note">Every query was matched to a true place.</p>'
    extent = f"the first {_WRONG_SHOWN} of {len(wrong)}" if len(wrong) > _WRONG_SHOWN else f"all {len(wrong)}"
    note = f'<p class="note">The most confident first: {extent}.</p>' if wrong else nothing
    right = ""
    if some:
        which = "all" if len(some) == len(good) else f"the {half} most and the {half} least confident of {len(good)}"
        cards = "".join(_match_card(data, q) for q in some)
        right = render("report_right_matches.html", which=which, cards=cards)
    return render("report_matches.html", note=note, cards=shown, right=right)


def cost(data: ReportData) -> str:
    """The section with the counted events of one query."""
    if not data.events:
        return ""
    tiles = "".join(f"<div><dt>{safe(label(k))}</dt><dd>{number(v)}</dd></div>" for k, v in data.events.items())
    return render("report_cost.html", events=tiles)


def setup(data: ReportData) -> str:
    """The section with the command and the settings that give these figures again."""
    return render("report_setup.html", command=safe(data.command), configuration=safe(data.config_toml))


def number(value: float) -> str:
    """A count with thousands separated; three significant digits below 100 if it is no whole number."""
    if not is_number(value):
        return "–"
    if float(value).is_integer():
        return f"{int(value):,}"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
