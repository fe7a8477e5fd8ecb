"""A robot's day: Nordland, summer learned and winter driven; Gardens Point, one side of the path and the other.

    python -m benchmarks robot.day [--seeds 0,1,2] [--chosen] [--updates 100000] [--record]

All answers are causal. Drives are made of the query images by repeating, leaving out or reversing them; an image that
shows what the last one showed is no news to the filter. Off the map are query images of places that the map does not
have. ``--chosen`` prints the maps of Nordland 0:200 and Gardens Point 0:50, on which the filter's and the
calibration's numbers were chosen; without it, the maps on which nothing was.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import click
import cv2
import numpy as np
import psutil
from numpy.typing import NDArray

from benchmarks.places import PlacesSection, images_of, learned, places
from benchmarks.program import BenchmarkTable, Printed, program, seeds_option
from lava_vpr import Localizer, train
from lava_vpr.backends.asking import calibration_of
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import preset
from lava_vpr.engine.presentations import cores
from lava_vpr.matching.answers import Answerer, Answers, Together, answers_of
from lava_vpr.matching.forward_filter import MOTIONS, NONE
from lava_vpr.matching.probability import Calibration
from lava_vpr.matching.trust import Trust, trust
from lava_vpr.model import Model, prepare
from lava_vpr.recognition import count_query_spikes
from lava_vpr.traverse import open_traverse

SPEEDS = {"half the speed": 0.5, "the same speed": 1.0, "1.2 times": 1.2, "1.5 times": 1.5, "twice": 2.0}
EVERY, STOP = 50, 30
"""A stop of so many frames after so many places."""
BEFORE, AFTER = 25, 10
"""Frames before a robot is carried off, and after."""

REVERSED = "reversed"

Frames = NDArray[np.int64]


def at_speed(speed: float, places: int) -> Frames:
    """The place of every frame at so many times the references' speed."""
    return np.minimum((np.arange(int(places / speed)) * speed).astype(np.int64), places - 1)


def with_stops(places: int) -> Frames:
    """The place of every frame of a drive at the references' speed that stands still in between."""
    return np.concatenate([np.full(1 + STOP * (place % EVERY == EVERY // 2), place) for place in range(places)])


def every_drive(places: int) -> dict[str, Frames]:
    """All drives by name."""
    made = {name: at_speed(speed, places) for name, speed in SPEEDS.items()}
    stops = f"{STOP} frames at rest, every {EVERY} places"
    return made | {stops: with_stops(places), REVERSED: np.arange(places)[::-1]}


def kidnappings(places: int, number: int, seed: int) -> list[Frames]:
    """Drives that go on elsewhere, at least a twentieth of the map away, or half of what a short map allows."""
    rng, made = np.random.default_rng(seed), []
    least = min(places // 20 + BEFORE, (places - BEFORE - AFTER) // 2)
    while len(made) < number:
        here, there = rng.integers(0, places - BEFORE - AFTER, 2).tolist()
        if abs(here - there) >= least:
            made.append(np.concatenate([np.arange(here, here + BEFORE), np.arange(there, there + AFTER)]))
    return made


KIDNAPPED = 60
TIMED = 200


class Map(NamedTuple):
    """A map, and which images are driven on and off it."""

    learned: PlacesSection
    off: PlacesSection


UNSEEN = {
    "1,000 places": Map(PlacesSection("nordland_long", 0, 1000), PlacesSection("nordland", 0, 500)),
    "500 places": Map(PlacesSection("nordland", 0, 500), PlacesSection("nordland_long", 0, 500)),
}
CHOSEN = {
    "places 0:100": Map(PlacesSection("nordland", 0, 100), PlacesSection("nordland", 100, 200)),
    "places 100:200": Map(PlacesSection("nordland", 100, 200), PlacesSection("nordland", 0, 100)),
    "places 0:200": Map(PlacesSection("nordland", 0, 200), PlacesSection("nordland", 200, 400)),
    "Gardens Point 0:50": Map(PlacesSection("gardens", 0, 50), PlacesSection("gardens", 50, 100)),
}


@dataclass(frozen=True)
class ScoredImages:
    """A model and what its network made of images on the map and off it: scores (n, places)."""

    model: Model
    on: NDArray[np.float64]
    off: NDArray[np.float64]
    calibration: Calibration


def answered(where: Map, seed: int) -> ScoredImages:
    """Learn a map and ask it everything."""
    model = learned(where.learned, dataclasses.replace(preset("loihi"), seed=seed))
    scores_of = prepare(model)
    on, off = (
        scores_of(count_query_spikes(model, places(section, 1, model.config)[0], threads=cores())[0])
        for section in where
    )
    calibration = calibration_of(model, Pool(cores()))
    if calibration is None:
        raise TypeError("an integer model has a calibration")
    return ScoredImages(model, on, off, calibration)


def follow(scores: NDArray[np.float64], motion: str, frames: NDArray[np.int64]) -> Answers:
    """What the filter answers to frames, by their rows of scores; the same row again is a robot that stands still."""
    moving = np.append(True, np.diff(frames) != 0)
    start = Answerer.of(preset("loihi").decoder.default, scores.shape[1], Together(motion=motion))
    return start.step(scores[frames], moving)[1]


def found_again(some: ScoredImages, motion: str) -> float:
    """Percent of kidnappings after which a place is exact within ten frames, and the last is within one."""
    cases = kidnappings(some.model.places, KIDNAPPED, seed=1)
    again = 0
    for frames in cases:
        apart = np.abs(follow(some.on, motion, frames).matches - frames)[BEFORE:]
        again += bool((apart == 0).any() and apart[-1] <= 1)
    return 100 * again / len(cases)


def driven(some: ScoredImages, motion: str, frames: NDArray[np.int64]) -> list[float]:
    """Percent of the frames of a drive that are answered exactly, and within 3 places."""
    found = some.on[frames].argmax(axis=1) if motion == NONE else follow(some.on, motion, frames).matches
    return [100 * float((np.abs(found - frames) <= off).mean()) for off in (0, 3)]


def drive_cells(all_seeds: Sequence[ScoredImages]) -> list[list[str]]:
    """The cells of a map, a row for each drive: exact / within three places, in percent, means over seeds."""
    rows = []
    for drive, frames in every_drive(all_seeds[0].model.places).items():
        cells = []
        for motion in (NONE, *MOTIONS):
            figures = np.mean([driven(some, motion, frames) for some in all_seeds], axis=0)
            backwards = motion == "forward" and drive == REVERSED
            cells.append("" if backwards else " / ".join(f"{value:.1f}" for value in figures))
        rows.append(cells)
    again = [np.mean([found_again(some, motion) for some in all_seeds]) for motion in MOTIONS]
    return [*rows, ["", *(f"{of:.0f}" for of in again)]]


def drive_table(maps: Mapping[str, Sequence[ScoredImages]], record: str) -> BenchmarkTable:
    """All drives on all maps."""
    names = [*every_drive(KIDNAPPED), f"carried off: found again within {AFTER} images"]
    columns = [name for title in maps for name in (f"{title}: alone", "`--motion any`", "`forward`")]
    rows = zip(*(drive_cells(seeds) for seeds in maps.values()), strict=True)
    return BenchmarkTable(
        ["drive", *columns],
        [[name, *(cell for cells in row for cell in cells)] for name, row in zip(names, rows, strict=True)],
        title="exact / within 3 places, percent",
        record=record,
    )


def trusts(some: ScoredImages) -> dict[str, Trust | None]:
    """How far the probabilities can be trusted with as many images off the map as on it."""
    off = some.off[: some.model.places]
    on = some.on[: len(off)]
    scores = np.concatenate([on, off])
    truth = np.zeros(scores.shape, np.bool_)
    truth[np.arange(len(on)), np.arange(len(on))] = True
    alone = answers_of(some.model.config.decoder.default, scores, some.calibration)
    made = {"alone": trust(alone, truth, Together(calibration=some.calibration))}
    for motion in MOTIONS:
        by_filter = follow(scores, motion, np.arange(len(scores)))
        made[f"`--motion {motion}`"] = trust(by_filter, truth, Together(motion=motion))
    return made


def trust_table(maps: Mapping[str, Sequence[ScoredImages]], record: str) -> BenchmarkTable:
    """What each target precision gives, half of the images being off the map."""
    rows = []
    for title, all_seeds in maps.items():
        found = [trusts(some) for some in all_seeds]
        for number, way in enumerate(found[0]):
            known = [one for one in (of[way] for of in found) if one is not None]
            row = ["" if number else title, way, f"{100 * np.mean([one.error for one in known]):.1f}"]
            for target in range(4):
                thresholds = [one.thresholds[target] for one in known]
                figures = [(r.precision, r.kept, r.false_accepts) for r in thresholds]
                row.append(" / ".join(mean_percent(of) for of in zip(*figures, strict=True)))
            rows.append(row)
    columns = ["map", "answers", "expected calibration error", "`--target-precision` 0.9", "0.95", "0.98", "0.99"]
    title = "as many images off the map as on it: precision / kept of those on it / accepted off it, percent"
    return BenchmarkTable(columns, rows, title=title, record=record)


def mean_percent(figures: Sequence[float]) -> str:
    """The mean in percent of those that are known; a dash if none is, as the precision of no accepted answer."""
    known = [figure for figure in figures if not np.isnan(figure)]
    return f"{100 * np.mean(known):.1f}" if known else "-"


def latency(name: str, model: Model, dataset: str) -> Printed:
    """Milliseconds of `Localizer.update` of a 640 x 480 image."""
    traverse = open_traverse(images_of(dataset, "winter"))
    seen = [cv2.resize(traverse.load(k), (640, 480), interpolation=cv2.INTER_CUBIC) for k in range(TIMED)]
    for motion in (NONE, *MOTIONS):
        robot, wall, busy = Localizer(model, motion), [], []
        robot.update(seen[0])
        for image in seen:
            started, worked = time.perf_counter(), time.process_time()
            robot.update(image)
            wall.append(time.perf_counter() - started)
            busy.append(time.process_time() - worked)
        p50, p99 = np.percentile(wall, [50, 99]) * 1e3
        yield (
            f"{name}, motion {motion}: Localizer.update of 640 x 480: p50 {p50:.2f} ms, p99 {p99:.2f} ms elapsed, "
            f"{1e3 * float(np.median(busy)):.2f} ms of a processor"
        )


def mirrored() -> Model:
    """A map of 3,000 places: the 1,500 of Nordland, and their mirror images."""
    seen = [
        image for name in ("nordland", "nordland_long") for image in open_traverse(images_of(name, "summer")).images()
    ]
    return train(seen + [np.ascontiguousarray(image[:, ::-1]) for image in seen])


def memory(model: Model, updates: int) -> str:
    """Memory of the process before and after so many updates."""
    robot, seen = Localizer(model), list(open_traverse(images_of("nordland", "winter")).images())
    for image in seen:
        robot.update(image)
    process = psutil.Process()
    before = process.memory_info().rss
    for number in range(updates):
        robot.update(seen[number % len(seen)])
    return f"{updates:,} updates: {before / 1e6:.1f} MB before, {process.memory_info().rss / 1e6:.1f} MB after"


@program("nordland", "nordland_long", "gardens")
@click.option("--updates", default=0, help="Also: how memory changes over so many updates.")
@seeds_option
@click.option("--chosen", is_flag=True, help="The maps on which numbers were chosen.")
def main(updates: int, seeds: Sequence[int], chosen: bool) -> Printed:
    """Drives, trust and milliseconds an image."""
    maps = CHOSEN if chosen else UNSEEN
    found = {name: [answered(where, seed) for seed in seeds] for name, where in maps.items()}
    yield drive_table(found, "" if chosen else "robot-drives")
    yield trust_table(dict(reversed(found.items())), "" if chosen else "robot-trust")
    if not chosen:
        for name, where in maps.items():
            yield from latency(name, found[name][0].model, where.learned.dataset)
        yield from latency("3,000 places", mirrored(), "nordland")
    if updates:
        yield memory(next(reversed(found.values()))[0].model, updates)
