"""A robot's day: Nordland, summer learned and winter driven; Gardens Point, one side of the path and the other.

    python -m benchmarks robot.day [--seeds 0,1,2] [--chosen] [--updates 100000] [--record]

All answers are causal. Drives are made of the query images of a map (`benchmarks/robot/drives.py`); stops and rest
carry a camera's noise. Off the map are query images of places that the map does not have. ``--chosen`` prints the maps
of Nordland 0:200 and Gardens Point 0:50, on which the filter's and the calibration's numbers were chosen; without it,
the maps on which nothing was.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import click
import cv2
import numpy as np
import psutil
from numpy.typing import NDArray

from benchmarks.places import ALL_CORES, PlacesSection, images_of, learned, places
from benchmarks.program import BenchmarkTable, Printed, program, seeds_option
from benchmarks.robot import drives
from benchmarks.robot.cameras import every_camera
from benchmarks.robot.drives import AFTER, BEFORE, REST, RESTING, Dull, Frames, kidnappings
from lava_vpr import Localizer, train
from lava_vpr.backends.asking import Asking, calibration_of
from lava_vpr.backends.interface import Presentations, query_presentations
from lava_vpr.config import preset
from lava_vpr.engine.adaptation import Adaptation, Motion
from lava_vpr.matching.answers import Answerer, Answers, Together, accepted, answers_of, least_probability
from lava_vpr.matching.beliefs import filtered
from lava_vpr.matching.forward_filter import MOTIONS, NONE, ForwardFilter
from lava_vpr.matching.probability import Calibration
from lava_vpr.matching.trust import Trust, trust
from lava_vpr.model import IntegerModel, Model, integer_model
from lava_vpr.traverse import open_traverse

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
CAMERAS = {"1,000 places": "robot-cameras"}
RECORDS = {"1,000 places": "robot-drives", "500 places": "robot-drives-500"}
CHOSEN = {
    "places 0:100": Map(PlacesSection("nordland", 0, 100), PlacesSection("nordland", 100, 200)),
    "places 100:200": Map(PlacesSection("nordland", 100, 200), PlacesSection("nordland", 0, 100)),
    "places 0:200": Map(PlacesSection("nordland", 0, 200), PlacesSection("nordland", 200, 400)),
    "Gardens Point 0:50": Map(PlacesSection("gardens", 0, 50), PlacesSection("gardens", 50, 100)),
}


@dataclass(frozen=True)
class DrivenMap:
    """A model, and what it is shown.

    Attributes:
        model, calibration: The model.
        on, off: The map's queries, and queries of other places.
        stops: A drive with stops, drawn with noise.
        rest: `REST` places, `RESTING` frames each, drawn with noise.
        dull: The stretch that is least distinguishable.
    """

    model: IntegerModel
    calibration: Calibration
    on: Presentations
    off: Presentations
    stops: Presentations
    rest: tuple[Presentations, ...]
    dull: Dull

    def adapted(self, shown: Presentations) -> Presentations:
        """A drive as the model's own time constant has it."""
        tau = Asking.wanted().tracking(self.model, "any").adapt
        return shown if tau is None else replace(shown, bias=Adaptation(self.model.network, tau).biases(shown.rates))


def driven_map(where: Map, seed: int) -> DrivenMap:
    """Learn a map, and encode what it is shown."""
    model = integer_model(learned(where.learned, replace(preset("loihi"), seed=seed)), "driving")
    on, off = (query_presentations(model, places(section, 1, model.config)[0]) for section in where)
    calibration = calibration_of(model, ALL_CORES)
    if calibration is None:
        raise TypeError("an integer model has a calibration")

    images = drives.queries_of(where.learned)

    def seen(frames: Frames) -> Presentations:
        return drives.shown_of(model, drives.noisy(images, frames, seed))

    stops = seen(drives.with_stops(model.places))
    rest = tuple(seen(np.full(RESTING, place)) for place in resting(model.places))
    return DrivenMap(model, calibration, on, off, stops, rest, drives.dull(model, images))


def resting(n: int) -> list[int]:
    """The places of ``n`` at which a robot is switched on."""
    return np.unique(np.linspace(0, n - 1, REST).astype(np.int64)).tolist()


def follow(some: DrivenMap, shown: Presentations, motion: str = "any") -> Answers:
    """What the filter answers to a drive."""
    start = Answerer.of(some.model.config.decoder.default, some.model.places, together(some, motion))
    return start.step(drives.scored(some.model, shown), Motion().moving(shown.rates))[1]


def together(some: DrivenMap, motion: str) -> Together:
    """How queries are matched."""
    return Together(motion=motion, calibration=some.calibration)


def good(some: DrivenMap, answers: Answers, motion: str = "any") -> NDArray[np.bool_]:
    """Which answers are accepted."""
    return accepted(answers, least_probability(together(some, motion)))


def found_again(some: DrivenMap) -> float:
    """Share of kidnappings after which a place is exact within ten frames, and the last is within one."""
    cases, again = kidnappings(some.model.places, KIDNAPPED, seed=1), 0
    for frames in cases:
        apart = np.abs(follow(some, some.adapted(some.on.part(frames))).matches - frames)[BEFORE:]
        again += bool((apart == 0).any() and apart[-1] <= 1)
    return again / len(cases)


class Driven(NamedTuple):
    """Shares of the frames of a drive that are on the map: exact alone; filtered: exact, within 3 places, accepted;
    and of all that is accepted the share within a place of the truth; then all but the first without adapting."""

    alone: float
    exact: float
    near: float
    accepted: float
    right: float
    plain_exact: float
    plain_near: float
    plain_accepted: float
    plain_right: float


def driven(some: DrivenMap, shown: Presentations, truth: Frames, part: slice = slice(None)) -> Driven:
    """How a drive, or a ``part`` of it, is answered; -1 is off the map."""
    there, truth = truth[part] >= 0, truth[part]

    def shares(answers: Answers) -> list[float]:
        sure = good(some, answers)[part]
        apart = np.where(there, np.abs(answers.matches[part] - truth), some.model.places)
        right = float((apart <= 1)[sure].mean()) if sure.any() else float("nan")
        return [*(float(of[there].mean()) for of in (apart == 0, apart <= 3, sure)), right]

    alone = drives.scored(some.model, shown).argmax(axis=1)[part] == truth
    ways = (some.adapted(shown), shown)
    return Driven(float(alone[there].mean()), *(share for way in ways for share in shares(follow(some, way))))


def every_drive(some: DrivenMap) -> Iterator[tuple[str, Driven]]:
    """All drives by name."""
    n = some.model.places
    made = {name: drives.at_speed(speed, n) for name, speed in drives.SPEEDS.items()}
    order = np.random.default_rng(0).permutation(n)
    for name, frames in (made | {"reversed": np.arange(n)[::-1], "in random order": order}).items():
        yield name, driven(some, some.on.part(frames), frames)
    stops = f"{drives.STOP} frames at rest, every {drives.EVERY} places"
    yield stops, driven(some, some.stops, drives.with_stops(n))
    half = Presentations.joined([some.on, some.off.part(slice(n))])
    yield "as many off the map as on it", driven(some, half, np.append(np.arange(n), np.full(len(half.rates) - n, -1)))
    first, length = some.dull.first, len(some.dull.shown.rates)
    rates = some.on.rates.copy()
    rates[first : first + length] = some.dull.shown.rates
    for name, frames in {
        "a dull stretch": np.arange(n),
        "the same, 1.5 times": drives.at_speed(1.5, n),
        "the same, reversed": np.arange(n)[::-1],
    }.items():
        within = np.flatnonzero((frames >= first) & (frames < first + length))
        shown = replace(some.on, rates=rates).part(frames)
        yield name, driven(some, shown, frames, slice(within[0], within[-1] + 1))
        if within[-1] + 1 < len(frames):
            yield f"{name}: what follows", driven(some, shown, frames, slice(within[-1] + 1, None))


def alone(some: DrivenMap, shown: Presentations) -> Answers:
    """What each query is answered by itself."""
    return answers_of(some.model.config.decoder.default, drives.scored(some.model, shown), some.calibration)


def at_rest(some: DrivenMap) -> tuple[float, float, float]:
    """Share of the places where a robot is switched on that are accepted alone, and that are after `RESTING` frames,
    adapting and not."""
    after = [[bool(good(some, follow(some, way))[-1]) for way in (some.adapted(shown), shown)] for shown in some.rest]
    first = Presentations.joined([shown.part(slice(1)) for shown in some.rest])
    return float(good(some, alone(some, first), NONE).mean()), *np.mean(after, axis=0).tolist()


def drive_cells(all_seeds: Sequence[DrivenMap]) -> dict[str, list[str]]:
    """The cells of a map by drive: means over seeds in percent, and the least of a seed."""
    found = [dict(every_drive(some)) for some in all_seeds]
    cells = {}
    for name in found[0]:
        figures = np.array([of[name] for of in found])
        mean, least = ([percent(value) for value in of] for of in (_known(figures, np.mean), _known(figures, np.min)))
        shown = (mean[:1], mean[1:3], mean[3:5], least[1:5], mean[5:])
        cells[name] = [" / ".join(part) for part in shown]
    alone_rest, rest, plain_rest = (percent(of) for of in np.mean([at_rest(some) for some in all_seeds], axis=0))
    single = np.mean([good(some, alone(some, some.on), NONE).mean() for some in all_seeds])
    again = [found_again(some) for some in all_seeds]
    return cells | {
        "accepted alone": ["", "", percent(float(single)), "", ""],
        "at rest from the first image: accepted alone / filtered": ["", "", f"{alone_rest} / {rest}", "", plain_rest],
        f"kidnapped: found again within {AFTER} images": [
            "",
            percent(float(np.mean(again))),
            "",
            percent(min(again)),
            "",
        ],
    }


def _known(figures: NDArray[np.float64], of: Callable[..., float]) -> list[float]:
    """``of`` each column of (seeds, figures), without what is not known; NaN if nothing is."""
    return [float(of(column[~np.isnan(column)])) if (~np.isnan(column)).any() else float("nan") for column in figures.T]


def percent(share: float) -> str:
    """A share in percent; a dash where it is not known, as the precision of no accepted answer."""
    return "-" if np.isnan(share) else f"{100 * share:.1f}"


def drive_table(title: str, all_seeds: Sequence[DrivenMap], record: str) -> BenchmarkTable:
    """All drives on a map."""
    ways = ["alone: exact", "filtered: exact / within 3", "accepted / right of those", "the least of a seed"]
    ways.append("all of it with `--adapt off`")
    return BenchmarkTable(
        ["drive", *ways],
        [[name, *cells] for name, cells in drive_cells(all_seeds).items()],
        title=f"{title}: percent of the frames on the map; right: within a place",
        record=record,
    )


def camera_table(title: str, models: Sequence[IntegerModel], section: PlacesSection, record: str) -> BenchmarkTable:
    """Disturbed cameras on a map, means over seeds."""
    found, rows = [dict(every_camera(model, section)) for model in models], []
    for name in found[0]:
        figures = np.array([of[name][:4] for of in found])
        mean, least = ([percent(value) for value in _known(figures, of)] for of in (np.mean, np.min))
        named = sum((of[name].named for of in found), Counter[str]())
        causes = ", ".join(f"{cause} {times} of {len(found)}" for cause, times in sorted(named.items()))
        rows.append([name, *(" / ".join(part) for part in (mean[:2], mean[2:], least)), causes])
    ways = ["exact / within 3", "accepted / right of those", "the least of a seed", "named in drives"]
    title = f"{title}, disturbed cameras: percent of the images; right: within a place"
    return BenchmarkTable(["camera", *ways], rows, title=title, record=record)


def trusts(some: DrivenMap) -> dict[str, Trust | None]:
    """How far the probabilities can be trusted with as many images off the map as on it."""
    off = some.off.part(slice(some.model.places))
    on = some.on.part(slice(len(off.rates)))
    shown, both = Presentations.joined([on, off]), len(on.rates)
    truth = np.eye(2 * both, some.model.places, dtype=np.bool_) & (np.arange(2 * both) < both)[:, None]
    made = {"alone": trust(alone(some, shown), truth, Together(calibration=some.calibration))}
    for motion in MOTIONS:
        by_filter = follow(some, some.adapted(shown), motion)
        made[f"`--motion {motion}`"] = trust(by_filter, truth, together(some, motion))
    return made


def trust_table(maps: Mapping[str, Sequence[DrivenMap]], record: str) -> BenchmarkTable:
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


def filter_cost(places: int) -> str:
    """Milliseconds of a processor of the filter alone, of scores that are made up."""
    scores = np.random.default_rng(0).gamma(0.4, 4.0, (TIMED, places))
    state, _ = filtered(ForwardFilter.start(places), scores[:10])
    worked = time.process_time()
    filtered(state, scores)
    return f"{places:,} places: the filter alone: {1e3 * (time.process_time() - worked) / TIMED:.2f} ms of a processor"


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
    found = {name: [driven_map(where, seed) for seed in seeds] for name, where in maps.items()}
    for name, all_seeds in found.items():
        yield drive_table(name, all_seeds, RECORDS.get(name, ""))
        models = [some.model for some in all_seeds]
        yield camera_table(name, models, maps[name].learned, CAMERAS.get(name, ""))
    yield trust_table(dict(reversed(found.items())), "" if chosen else "robot-trust")
    if not chosen:
        for name, where in maps.items():
            yield from latency(name, found[name][0].model, where.learned.dataset)
        yield from latency("3,000 places", mirrored(), "nordland")
        yield from (filter_cost(places) for places in (2500, 10_000))
    if updates:
        yield memory(next(reversed(found.values()))[0].model, updates)
