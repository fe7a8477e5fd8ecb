"""The example of LENS: 100 places as frames of an event camera, two drives, with its ground truth.

    LAVA_VPR_DATA=... python -m benchmarks events.lens [--record]
    LAVA_VPR_DATA=... python -m benchmarks events.lens --choose

``--choose`` is how settings were chosen, on places 0:50 alone: each line is a candidate, with the mean R@1 and R@100P
over seeds of its best decoder, by their sum; of equal sums the first is taken, which has fewer views. The spiking front
end has candidates of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.places import images_of, recognised
from benchmarks.program import BenchmarkTable, Printed, fraction, program
from lava_vpr.config import Config, for_events, preset
from lava_vpr.inputs.encoder import INPUTS, spiking_input
from lava_vpr.inputs.front_end_settings import EVENT_FRONT_END
from lava_vpr.recognition import Comparison
from lava_vpr.traverse import Traverse, open_traverse, vector_traverse
from lava_vpr.vectors.files import Vectors

TOLERANCE = 3
SEEDS = (0, 1, 2)
PLAIN, EVENTS = preset("loihi"), for_events(preset("loihi"))
SPIKING = replace(EVENTS, encoder=replace(EVENTS.encoder, kind="frontend-events"))
CHOSEN_ON, UNSEEN, ALL = slice(0, 50), slice(50, 100), slice(0, 100)


class LearningWay(NamedTuple):
    """How frames are learned: settings, and cells and blur of counts as vectors (0 cells: the images themselves)."""

    config: Config
    cells: int = 0
    blur: float = 0.0


WAYS: Mapping[str, LearningWay] = {
    "events": LearningWay(EVENTS),
    "front end": LearningWay(SPIKING),
    "front end, one view": LearningWay(replace(SPIKING, views=PLAIN.views)),
    "orientation": LearningWay(PLAIN),
    "counts": LearningWay(replace(PLAIN, encoder=replace(PLAIN.encoder, vector_dead_zone=0.0)), 14, 2.0),
}
ROWS = (
    ("**input `events`, decoder `standard`**", "events", "standard"),
    ("the same, decoder `contrast`", "events", "contrast"),
    ("cosine of the same inputs", "events", "cosine"),
    ("templates of the same inputs", "events", "template"),
    ("**input `frontend-events`, decoder `standard`**", "front end", "standard"),
    ("templates of the same inputs", "front end", "template"),
    ("SAD, three views", "events", "sad"),
    ("HOG, three views", "events", "hog"),
    ("input `orientation`, one view, `standard`", "orientation", "standard"),
    ("the same, `contrast`", "orientation", "contrast"),
    ("cosine of the same inputs", "orientation", "cosine"),
    ("input `frontend-events`, one view, `standard`", "front end, one view", "standard"),
    ("SAD, one view", "orientation", "sad"),
    ("HOG, one view", "orientation", "hog"),
    ("cosine of 14 x 14 counts", "counts", "vectors"),
    ("the same, the references' mean off", "counts", "standardised"),
    ("the same as input `vector`, `standard`", "counts", "standard"),
)
"""The table: what a row is called, how frames are learned, and the matcher."""


def drive(which: str, places: slice, way: LearningWay) -> Traverse:
    """Frames of the ``reference`` or the ``query`` drive, or how many events each part of them has, after a blur."""
    folder = images_of("lens_example", "reference").parent
    frames = open_traverse(folder / which, places=(places.start, places.stop))
    if not way.cells:
        return frames
    rows = []
    for image in frames.images():
        values = image.astype(np.float32)
        values = cv2.GaussianBlur(values, (0, 0), way.blur) if way.blur else values
        rows.append(cv2.resize(values, (way.cells, way.cells), interpolation=cv2.INTER_AREA).ravel())
    return vector_traverse("counts", Vectors(np.stack(rows)))


def truth(places: slice) -> NDArray[np.bool_]:
    """Which places are right for which query, bool (queries, places): those of LENS's own truth, 3 places around."""
    own = np.load(images_of("lens_example", "reference").parent / "ground_truth.npy").astype(np.uint8)
    near = cv2.dilate(own, np.ones((1, 2 * TOLERANCE + 1), np.uint8))  # along the places
    return np.asarray(near[places, places] > 0)


def decoder_recall(way: LearningWay, places: slice, rivals: Sequence[str] | None) -> dict[str, NDArray[np.float64]]:
    """R@1, R@5, R@10 and R@100P of every decoder, and of ``rivals`` (None: all), means over `SEEDS`."""
    pair = [drive(which, places, way) for which in ("reference", "query")]
    comparison = Comparison(rivals=rivals, keep_scores=False)
    results = recognised(way.config, *pair, truth(places), SEEDS, comparison)
    return {
        name: np.mean(
            [
                (m.recall_at_1, m.recall_at_n[5], m.recall_at_n[10], m.recall_at_100_precision)
                for m in (result.metrics[name] for result in results)
            ],
            axis=0,
        )
        for name in results[0].metrics
    }


def candidates() -> Iterator[tuple[str, LearningWay]]:
    """Everything that was tried, by name."""
    kinds = {kind: replace(PLAIN.encoder, kind=kind) for kind in ("orientation", "onoff")}
    for share in (0.8, 0.9, 0.95):
        kinds[f"events, saturation {share:g}"] = replace(PLAIN.encoder, kind="events", saturation=share)
    for shifts in (1, 3):
        for name, encoder in kinds.items():
            config = replace(PLAIN, encoder=encoder, views=replace(PLAIN.views, shifts=shifts))
            yield f"{name}, {shifts} view{'s' * (shifts > 1)}", LearningWay(config)
    for cells in (10, 14, 20):
        for blur in (0.0, 2.0):
            for zone in (0.0, 0.5):
                config = replace(PLAIN, encoder=replace(PLAIN.encoder, vector_dead_zone=zone))
                name = f"{cells} x {cells} counts less their mean, blur {blur:g}, dead zone {zone:g}"
                yield name, LearningWay(config, cells, blur)


def front_ends() -> Iterator[tuple[str, LearningWay]]:
    """Spiking front ends that were tried, by name; each is a kind of input for as long as it is looked at."""
    for levels, white, octaves in product((8, 12, 16), (20, 25, 32, 40, 64), (2.0, 3.0)):
        made = replace(EVENT_FRONT_END, levels=levels, white=white, pixel_octaves=octaves)
        name = f"frontend-events, {levels} levels, {octaves:g} octaves below {white} events, 3 views"
        row = INPUTS.register(spiking_input("candidate", lambda encoder, own=made: own, "A candidate."))
        yield name, LearningWay(replace(EVENTS, encoder=replace(EVENTS.encoder, kind=row.name)))
        INPUTS.remove(row.name)


def chosen(of: Iterator[tuple[str, LearningWay]]) -> Printed:
    """A line of each candidate, and the one that is chosen."""
    best: tuple[float, str] = (0.0, "none")
    for name, way in of:
        found = {decoder: (r1, full) for decoder, (r1, _, _, full) in decoder_recall(way, CHOSEN_ON, ()).items()}
        sums = {decoder: round(sum(pair), 6) for decoder, pair in found.items()}
        decoder = max(sums, key=lambda one: sums[one])
        (r1, full), total = found[decoder], sums[decoder]
        yield f"{name:58} {decoder:21} R@1 {r1:.3f}  R@100P {full:.3f}"
        best = (total, f"{name}; decoder {decoder}") if total > best[0] else best
    yield f"chosen: {best[1]}"


@program("lens_example")
@click.option("--choose", is_flag=True, help="How settings were chosen, on places 0:50.")
def main(choose: bool) -> Printed:
    """Recall on places that the search did not see (50:100), and on all; LENS's own: R@1 .63, R@5 .84, R@10 .95."""
    if choose:
        yield from chosen(candidates())
        yield from chosen(front_ends())
        return
    found = {(way, places.start): decoder_recall(WAYS[way], places, None) for way in WAYS for places in (UNSEEN, ALL)}
    columns = ["", "50:100: R@1", "R@5", "R@10", "R@100P", "0:100: R@1", "R@5", "R@10", "R@100P"]
    rows = [
        [title, *(fraction(value) for places in (UNSEEN, ALL) for value in found[way, places.start][matcher])]
        for title, way, matcher in ROWS
    ]
    yield BenchmarkTable(columns, rows, record="lens")
