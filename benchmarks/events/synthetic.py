"""Synthetic drives of an event camera: written to files, read, learned, and recognised from drives at other speeds.

python -m benchmarks events.synthetic [--record]      the figures of docs/events.md, on world 0
python -m benchmarks events.synthetic --choose        windows and images compared on world 7, on which they were chosen
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

from benchmarks.places import recognised
from benchmarks.program import BenchmarkTable, Printed, fraction, program
from lava_vpr.config import Config, for_events, preset
from lava_vpr.events.camera import write_events
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.positions.frames import XY, Positions
from lava_vpr.recognition import Comparison
from lava_vpr.storage.writing import temporary_folder
from lava_vpr.synthetic.drives import EventDrive
from lava_vpr.synthetic.world import World
from lava_vpr.traverse import Traverse, open_traverse
from lava_vpr.truth.alignment import Located

PLACES, SPEED, RADIUS_M = 50, 14.0, 10.0
SEEDS = (0, 1, 2)
QUERIES = (("summer", SPEED), ("rain", SPEED), ("winter", SPEED), ("winter", 7.0), ("night", SPEED))
MATCHERS = {
    "R@1": "ours",
    "filtered": "filtered",
    "cosine": "cosine",
    "template": "template",
    "SAD": "sad",
    "HOG": "hog",
}


class Written(NamedTuple):
    """A drive and the file that holds it."""

    drive: EventDrive
    path: Path


def written(folder: Path, world: World, condition: str, speed: float, end: str = ".h5") -> Written:
    """Drive, and write the events."""
    drive = EventDrive(world, condition, speed)
    path = folder / f"{condition}_{speed:g}{end}"
    write_events(path, drive.events(), (world.width, world.height))
    return Written(drive, path)


def seen(one: Written, config: EventsConfig) -> tuple[Traverse, Positions]:
    """The windows of a drive, one begun every second, and where the vehicle was in the middle of each."""
    traverse = open_traverse(one.path, events=config)
    times, xy = one.drive.truth()
    stamps = traverse.stamps if traverse.stamps is not None else np.empty(0)
    at = np.stack([np.interp(stamps, times, axis) for axis in xy.T], axis=1)
    return traverse, Positions(at, XY)


def drive_recall(config: Config, reference: Written, query: Written) -> tuple[int, int, dict[str, float]]:
    """Places, queries, and R@1 by matcher over `SEEDS`: of the default decoder the mean, of the others once."""
    (images, places), (asked, positions) = seen(reference, config.events), seen(query, config.events)
    right = Located.of(places, positions, "synthetic").truth(RADIUS_M)
    results = recognised(config, images, asked, right, SEEDS, Comparison(motion="any", keep_scores=False))
    last = results[-1].metrics | results[-1].followed
    ours = float(np.mean([result.metrics[result.default].recall_at_1 for result in results]))
    return len(images), len(asked), {name: one.recall_at_1 for name, one in last.items()} | {"ours": ours}


def chosen(folder: Path) -> Printed:
    """Windows and images compared on a world of their own, in winter after summer and at another speed."""
    world = World(seed=7, places=PLACES)
    reference, query = written(folder, world, "summer", 10.0), written(folder, world, "winter", SPEED)
    windows = [{"window_ms": ms} for ms in (25.0, 50.0, 100.0, 200.0, 400.0)]
    windows += [{"window_events": number} for number in (3000, 10_000)]
    for image in ("counts", "surface"):
        for window in windows:
            config = replace(for_events(preset("loihi")), events=EventsConfig(image=image, **window))  # type: ignore[arg-type]
            places, queries, found = drive_recall(config, reference, query)
            what = ", ".join(f"{name} {value:g}" for name, value in window.items())
            yield f"{image:8} {what:20} {places:3} places {queries:3} queries  R@1 {found['ours']:.3f}"


def figures(folder: Path) -> BenchmarkTable:
    """The table of drives."""
    world, rows = World(seed=0, places=PLACES), []
    reference = written(folder, world, "summer", 10.0)
    for condition, speed in QUERIES:
        query = written(folder, world, condition, speed, ".npz" if condition == "summer" else ".h5")
        _, count, found = drive_recall(for_events(preset("loihi")), reference, query)
        cells = (fraction(found[name]) for name in MATCHERS.values())
        rows.append([f"{condition}, {speed:g} m/s", str(count), *cells])
    return BenchmarkTable(["query", "queries", *MATCHERS], rows, record="event-drives")


@program()
@click.option("--choose", is_flag=True, help="Windows and images compared on world 7.")
def main(choose: bool) -> Printed:
    """Drives in other conditions and at other speeds, recognised on one learned in summer at 10 m/s."""
    with temporary_folder() as folder:
        yield from chosen(folder) if choose else [figures(folder)]
