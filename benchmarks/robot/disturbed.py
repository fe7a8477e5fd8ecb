"""Disturbed cameras: borders, mirrored, upside down, stuck, black; and how many drives that are none are called so.

    python -m benchmarks robot.disturbed [--seeds 0,1,2] [--chosen] [--record]

Drives are of `LENGTH` query images in a row, from every `EVERY`-th place of a map on, each with a localizer that knows
of none before; what disturbs them is drawn at 640 x 320. Each season is learned, and the other driven. In the last row
the references are disturbed alike. ``--chosen`` prints the maps on which the numbers of `lava_vpr.inputs.doubts` and
`lava_vpr.inputs.likeness` were chosen; two of them, `SURE` and `BETTER`, were chosen with the others in sight.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import click
import numpy as np

from benchmarks.places import FOLDERS, PlacesSection
from benchmarks.program import BenchmarkTable, Printed, program, seeds_option
from benchmarks.robot.cameras import BARS, TURNED
from benchmarks.robot.day import percent
from benchmarks.robot.drives import Image, large, squeezed
from lava_vpr import Localizer, train
from lava_vpr.config import preset

LENGTH, EVERY = 40, 20
Drive = list[Image]
Disturb = Callable[[Drive], Drive]
UNSEEN = {PlacesSection("nordland_long", 0, 1000): "robot-disturbed"}
CHOSEN = {PlacesSection("nordland", 0, 200): "", PlacesSection("gardens", 0, 50): ""}


def each(change: Callable[[Image], Image]) -> Disturb:
    """Every image of a drive changed alike."""
    return lambda drive: [change(image) for image in drive]


DISTURBANCES: dict[str, Disturb] = {
    "none": lambda drive: drive,
    "12 % above and below, painted": each(BARS["bars of 12 %, painted"]),
    "20 % above, painted": each(BARS["a strip of 20 % at the top"]),
    "12 % above and below, squeezed": each(BARS["bars of 12 %, squeezed"]),
    "20 % above, squeezed": each(partial(squeezed, above=0.2)),
    **{name: each(change) for name, change in TURNED.items()},
    "stuck": lambda drive: [drive[0]] * len(drive),
    "black": lambda drive: [np.zeros_like(image) for image in drive],
}
PARTS = ("accepted / right of those", "drives named")
SHARED = "20 % above, painted"
"""What disturbs the references, too, in the last row."""


class DrivenFigures(NamedTuple):
    """What became of some drives.

    Attributes:
        images, accepted, right: How many images there were, were accepted, and were accepted within a place.
        named: In how many drives each cause was named.
        drives: How many drives there were.
    """

    images: int
    accepted: int
    right: int
    named: Counter[str]
    drives: int

    @classmethod
    def of(cls, robot: Localizer, queries: Drive, disturbed: Disturb) -> DrivenFigures:
        """Drive from every `EVERY`-th place on, 5 m an image by the odometer."""
        length, images, good, named, drives = min(LENGTH, len(queries)), 0, list[bool](), Counter[str](), 0
        for start in range(0, len(queries) - length + 1, EVERY):
            robot.reset()
            shown = disturbed(queries[start : start + length])
            found = [robot.update(image, odometry=5.0 if number else None) for number, image in enumerate(shown)]
            good += [abs(match.place - start - k) <= 1 for k, match in enumerate(found) if match.accepted]
            named.update({match.cause for match in found if match.cause is not None})
            images, drives = images + len(found), drives + 1
        return cls(images, len(good), sum(good), named, drives)

    def cells(self) -> list[str]:
        """Accepted and right, in percent, and causes with how many drives they are named in."""
        right = percent(self.right / self.accepted) if self.accepted else "-"
        causes = ", ".join(f"{cause} {times}" for cause, times in sorted(self.named.items())) or "none"
        return [f"{percent(self.accepted / self.images)} / {right}", f"{causes} of {self.drives}"]


def together(found: Sequence[DrivenFigures]) -> DrivenFigures:
    """Those of all seeds in one."""
    images, accepted, right, named, drives = zip(*found, strict=True)
    return DrivenFigures(sum(images), sum(accepted), sum(right), sum(named, Counter()), sum(drives))


def asked(references: Drive, queries: Drive, seeds: Sequence[int]) -> Iterator[list[str]]:
    """Cells for each disturbance, and for the one that the references share."""
    positions = np.stack([5.0 * np.arange(len(references)), np.zeros(len(references))], axis=1)

    def robots(learned: Drive) -> list[Localizer]:
        configs = [dataclasses.replace(preset("loihi"), seed=seed) for seed in seeds]
        return [Localizer(train(learned, config=config, positions=positions)) for config in configs]

    plain = robots(references)
    for disturbed in DISTURBANCES.values():
        yield together([DrivenFigures.of(robot, queries, disturbed) for robot in plain]).cells()
    shared = DISTURBANCES[SHARED]
    yield together([DrivenFigures.of(robot, queries, shared) for robot in robots(shared(references))]).cells()


@program("nordland", "nordland_long", "gardens")
@seeds_option
@click.option("--chosen", is_flag=True, help="The maps on which numbers were chosen.")
def main(seeds: Sequence[int], chosen: bool) -> Printed:
    """Accepted, right, and named, by disturbance; all seeds together."""
    names = [*DISTURBANCES, f"{SHARED}, as the map is"]
    for section, record in (CHOSEN if chosen else UNSEEN).items():
        images = [large(section, which) for which in (0, 1)]
        ways = [asked(images[which], images[1 - which], seeds) for which in (0, 1)]
        made = [[name, *forth, *back] for name, forth, back in zip(names, *ways, strict=True)]
        title = f"{section}: accepted, and right of those (within a place), percent of the images; drives named"
        first, second = FOLDERS[section.dataset]
        columns = ["disturbed", *(f"{season} driven: {part}" for season in (second, first) for part in PARTS)]
        yield BenchmarkTable(columns, made, title=title, record=record)
