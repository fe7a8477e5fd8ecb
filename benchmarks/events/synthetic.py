"""Synthetic drives of an event camera: written to files, read, learned, and recognised from drives at other speeds.

python -m benchmarks.events.synthetic             the figures of docs/events.md, on world 0
python -m benchmarks.events.synthetic --choose    windows and images compared on world 7, on which they were chosen
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

from lava_vpr.config import Config, for_events, preset
from lava_vpr.encoding import EncodedTraverse, Keep, encode_traverse, encode_views
from lava_vpr.events.writing import write_events
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.positions.frames import XY, Positions
from lava_vpr.recognition import Comparison, recognise
from lava_vpr.synthetic.drives import EventDrive
from lava_vpr.synthetic.world import World
from lava_vpr.training.loop import train
from lava_vpr.traverse import Traverse, open_traverse
from lava_vpr.truth.alignment import Located

PLACES, SPEED, RADIUS_M = 50, 14.0, 10.0
SEEDS = (0, 1, 2)
QUERIES = (("summer", SPEED), ("rain", SPEED), ("winter", SPEED), ("winter", 7.0), ("night", SPEED))


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


def measured(config: Config, reference: Written, query: Written) -> tuple[int, int, dict[str, float]]:
    """Places, queries, and R@1 by matcher over `SEEDS`: of the default decoder the mean, of the others once."""
    images, places = seen(reference, config.events)
    asked, positions = seen(query, config.events)
    learned = list(encode_views(images, config.encoder, config.views.views, Keep.ALL))
    queries: EncodedTraverse = encode_traverse(asked, config.encoder, Keep.ALL)
    right = Located.of(places, positions, "synthetic").truth(RADIUS_M)
    ours, found = [], {}
    for seed in SEEDS:
        result = recognise(
            train(learned, replace(config, seed=seed)), queries, right, Comparison(motion="any", keep_scores=False)
        )
        figures = {**result.metrics, **result.followed}
        ours.append(figures[result.default].recall_at_1)
        found = {name: one.recall_at_1 for name, one in figures.items()}
    return len(images), len(asked), {**found, "ours": float(np.mean(ours))}


def choose(folder: Path) -> None:
    """Compare windows and images on a world of their own, in winter after summer and at another speed."""
    world = World(seed=7, places=PLACES)
    reference, query = written(folder, world, "summer", 10.0), written(folder, world, "winter", SPEED)
    base = for_events(preset("loihi"))
    for image in ("counts", "surface"):
        for said in (*({"window_ms": ms} for ms in (25.0, 50.0, 100.0, 200.0, 400.0)), {"window_events": 3000},
                     {"window_events": 10_000}):  # fmt: skip
            config = replace(base, events=EventsConfig(image=image, **said))
            places, queries, found = measured(config, reference, query)
            what = ", ".join(f"{name} {value:g}" for name, value in said.items())
            print(f"{image:8} {what:20} {places:3} places {queries:3} queries  R@1 {found['ours']:.3f}", flush=True)


def figures(folder: Path) -> None:
    """Print the figures."""
    world = World(seed=0, places=PLACES)
    reference = written(folder, world, "summer", 10.0)
    config = for_events(preset("loihi"))
    length = PLACES * world.spacing_m
    print(f"world 0, {length:g} m; learned in summer at 10 m/s; right within {RADIUS_M:g} m; mean of seeds")
    names = ("ours", "filtered", "cosine", "sad", "hog", "template")
    print(f"{'query':22} {'file':5} queries " + " ".join(f"{name:>9}" for name in names), flush=True)
    for condition, speed in QUERIES:
        end = ".npz" if condition == "summer" else ".h5"
        query = written(folder, world, condition, speed, end)
        _, count, found = measured(config, reference, query)
        row = " ".join(f"{found[name]:9.3f}" for name in names)
        print(f"{condition + f', {speed:g} m/s':22} {end:5} {count:7} {row}", flush=True)


@click.command()
@click.option("--choose", "choosing", is_flag=True)
def main(choosing: bool) -> None:
    """Print what is asked for."""
    with tempfile.TemporaryDirectory() as folder:
        (choose if choosing else figures)(Path(folder))


if __name__ == "__main__":
    main()
