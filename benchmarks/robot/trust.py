"""Whether single answers keep what they promise: the precision that was asked for, and the calibration error.

    python -m benchmarks robot.trust [--seeds 0,1,2] [--chosen] [--record]

Of answers accepted by ``--target-precision``, the share that is right with its 95 % interval (Clopper and Pearson,
Biometrika 1934), all seeds together, and the share of the images on the map that is accepted; with as many images off
the map as on it, and with all of them on it and ``--off-map 0``, where the calibration error counts. ``--chosen``
prints the maps on which the calibration's numbers were chosen, learned in either season; without it, maps on which
nothing was.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import click
import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from benchmarks.learning_pays import encoded
from benchmarks.places import ALL_CORES, places
from benchmarks.program import BenchmarkTable, Printed, program, seeds_option
from benchmarks.robot.day import CHOSEN, UNSEEN, Map
from lava_vpr.backends.asking import calibration_of
from lava_vpr.config import Config, preset
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.presentations import cores
from lava_vpr.matching.probability import HALF, Calibration, reliability
from lava_vpr.model import prepare
from lava_vpr.recognition import count_query_spikes
from lava_vpr.synthetic.world import World, render
from lava_vpr.training.loop import train

TARGETS = (0.95, 0.99)
PLACES = 200


class AskedImages(NamedTuple):
    """References, queries of their places, and queries of other places."""

    learned: EncodedTraverse
    on: EncodedTraverse
    off: EncodedTraverse


def real(where: Map, back: bool, config: Config) -> AskedImages:
    """AskedImages of a map; ``back`` in time, so that its queries are learned."""
    season = 0 if back else 1
    learned, on, off = (
        places(section, which, config)[0]
        for section, which in ((where.learned, 1 - season), (where.learned, season), (where.off, season))
    )
    return AskedImages(learned, on, off)


def synthetic(config: Config) -> AskedImages:
    """The first half of a synthetic route, learned in summer; all of it asked in winter."""
    world = World(seed=config.seed, places=2 * PLACES)
    summer = encoded([render(world, place, "summer") for place in range(PLACES)], config)
    winter = encoded([render(world, place, "winter") for place in range(2 * PLACES)], config)
    return AskedImages(summer, winter.take(slice(0, PLACES)), winter.take(slice(PLACES, 2 * PLACES)))


class ScoredMap(NamedTuple):
    """A calibration, and scores (n, places) of queries on and off the map."""

    calibration: Calibration
    on: NDArray[np.float64]
    off: NDArray[np.float64]


def scored(images: AskedImages, config: Config) -> ScoredMap:
    """Learn a map and ask it."""
    model = train([images.learned], config, pool=ALL_CORES)
    calibration, scores_of = calibration_of(model, ALL_CORES), prepare(model)
    if calibration is None:
        raise TypeError("an integer model has a calibration")
    on, off = (scores_of(count_query_spikes(model, some, threads=cores())[0]) for some in images[1:])
    return ScoredMap(calibration, on, off)


def kept(some: ScoredMap, target: float, off_map: float) -> tuple[int, int, int, int]:
    """Of as many answers on the map as off it, or of all on the map: how many were accepted and right, accepted,
    accepted on the map, and how many on the map there were."""
    number = min(len(some.on), len(some.off)) if off_map else len(some.on)
    chosen = np.linspace(0, len(some.on) - 1, number).round().astype(np.int64)
    least = some.calibration.keeping(target, off_map).probability
    on = some.calibration.probabilities(some.on[chosen], off_map) >= least
    off = some.calibration.probabilities(some.off[:number], off_map) >= least
    right = on & (some.on[chosen].argmax(axis=1) == chosen)
    return int(right.sum()), int(on.sum() + (off.sum() if off_map else 0)), int(on.sum()), number


def cell(found: Sequence[ScoredMap], target: float, off_map: float) -> str:
    """Precision, its interval and what is accepted, in percent, of all seeds together."""
    right, accepted, on, of = np.sum([kept(some, target, off_map) for some in found], axis=0).tolist()
    if not accepted:
        return "- / 0.0"
    low, high = binomtest(right, accepted).proportion_ci(method="exact")
    return "{:.1f} ({:.1f} to {:.1f}) / {:.1f}".format(
        *(100 * share for share in (right / accepted, low, high, on / of))
    )


def error(some: ScoredMap) -> float:
    """The calibration error where all images are on the map, and said to be."""
    right: NDArray[np.bool_] = some.on.argmax(axis=1) == np.arange(len(some.on))
    return reliability(some.calibration.probabilities(some.on, 0.0), right)[1]


def maps(chosen: bool) -> dict[str, Callable[[Config], AskedImages]]:
    """Maps by name."""
    if chosen:
        ways = (("forth", False), ("back", True))
        return {f"{name}, {way}": partial(real, where, back) for name, where in CHOSEN.items() for way, back in ways}
    unseen = {name: partial(real, where, False) for name, where in reversed(UNSEEN.items())}
    return {f"synthetic world, {PLACES} places": synthetic, **unseen}


@program("nordland", "nordland_long", "gardens")
@click.option("--chosen", is_flag=True, help="The maps on which numbers were chosen.")
@seeds_option
def main(seeds: Sequence[int], chosen: bool) -> Printed:
    """Precisions that were asked for and reached, and calibration errors."""
    rows = []
    for name, made in maps(chosen).items():
        configs = [dataclasses.replace(preset("loihi"), seed=seed) for seed in seeds]
        found = [scored(made(config), config) for config in configs]
        half, whole = ([cell(found, target, share) for target in TARGETS] for share in (HALF, 0.0))
        rows.append([name, *half, f"{100 * np.mean([error(some) for some in found]):.1f}", *whole])
    half, whole = ([f"{words}: {target}" for target in TARGETS] for words in ("half off it", "all on it"))
    columns = ["map", *half, "all on it: calibration error", *whole]
    title = "target precision: precision (95 % interval) / accepted of those on the map, percent"
    yield BenchmarkTable(columns, rows, title=title, record="" if chosen else "robot-precision")
