"""Does learning the season pay elsewhere? The same answers without gains and with them, on drives of every sort.

    LAVA_VPR_DATA=... python -m benchmarks learning.elsewhere [--seeds 0,1,2] [--record]

Learning counts as the difference to the same network, decoder and adaptation without gains, query by query. Preset
``loihi``; every image is answered alone, adapted to the last 30 queries, and teaches by its image alone. The drives are
those of `benchmarks.learning_pays` (sections 200:500 of Nordland, synthetic worlds), LENS's frames of events, Gardens
Point in five views and three scales, HOG vectors, a second drive in the same season, and one within which it turns.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.descriptors.recall import hogs
from benchmarks.events import lens
from benchmarks.learning.season import ADAPTING, LEARNING, RULES, Drive, answered
from benchmarks.learning_pays import PLACES, SCENARIOS, SECTIONS, WORLDS, Random, encoded, grainy, nordland, synthetic
from benchmarks.places import ALL_CORES, PlacesSection, Views, near, places
from benchmarks.program import BenchmarkTable, Printed, program, recall, seeds_option
from benchmarks.results.tables import VIEWS
from lava_vpr.backends.answering import teachers
from lava_vpr.config import Config, for_events, preset
from lava_vpr.configfile import update
from lava_vpr.encoding import encode_traverse
from lava_vpr.inputs.vectors import Standard
from lava_vpr.inputs.views import View, ViewsConfig, seen_as
from lava_vpr.learning.references import encode_route
from lava_vpr.matching.against_truth import InBlocks, hold
from lava_vpr.matching.answers import Together
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.training.loop import train
from lava_vpr.traverse import Traverse, vector_traverse
from lava_vpr.vectors.files import Vectors

BASE = preset("loihi")
AGAIN = (0.03, 10.0)
"""A second drive made of one: the most that an image is shifted to a side, in widths of it, and the standard deviation
of its pixels' noise, in grey levels."""


class SeasonDrive(NamedTuple):
    """What is learned and asked.

    Attributes:
        references: The references in all views.
        queries: The queries, in order.
        truth: Which places are right, bool (queries, places).
        config: Settings.
        standard: What vectors are measured by.
        before: A drive before, whose season the queries begin with; None: there was none.
        counted: The queries that count.
    """

    references: Views
    queries: Views
    truth: NDArray[np.bool_]
    config: Config = BASE
    standard: Standard | None = None
    before: Views | None = None
    counted: slice = slice(None)


def of_scenario(title: str) -> Callable[[int, Random], SeasonDrive]:
    """A scenario of `benchmarks.learning_pays`."""

    def made(part: int, rng: Random) -> SeasonDrive:
        scenario = SCENARIOS[title][0](part, rng)
        references = tuple(encoded(images, BASE) for images in scenario.references)
        return SeasonDrive(references, (encoded(scenario.queries, BASE),), near(PLACES, scenario.tolerance))

    return made


def of_traverses(config: Config, references: Traverse, queries: Traverse, truth: NDArray[np.bool_]) -> SeasonDrive:
    """Traverses of anything, in the views of settings."""
    config, standard, learned = encode_route([references], config)
    asked = encode_traverse(queries, config.encoder, standard=standard)
    return SeasonDrive(tuple(learned), (asked,), truth, config, standard)


def events(part: int, rng: Random) -> SeasonDrive:
    """LENS's example."""
    way = lens.LearningWay(for_events(BASE))
    references, queries = (lens.drive(which, lens.ALL, way) for which in ("reference", "query"))
    return of_traverses(way.config, references, queries, lens.truth(lens.ALL))


def vectors(part: int, rng: Random) -> SeasonDrive:
    """HOG vectors of 500 Nordland places in one map."""
    config = update(BASE, {"encoder": {"kind": "vector"}})
    references, queries = (vector_traverse("hog", Vectors(hogs("nordland", which)[:500])) for which in (0, 1))
    return of_traverses(config, references, queries, near(500))


def garden(views: str) -> Callable[[int, Random], SeasonDrive]:
    """Gardens Point from the other side of the path, in some views, the half that no search saw."""

    def made(part: int, rng: Random) -> SeasonDrive:
        config, section = update(BASE, {"views": VIEWS[views]}), PlacesSection("gardens", 50, 200)
        queries = places(section, 1, config, ViewsConfig())
        return SeasonDrive(places(section, 0, config), queries, near(len(queries[0]), 2), config)

    return made


def second(part: int, rng: Random) -> SeasonDrive:
    """A second winter drive of a section of Nordland, after the first."""
    most, noise = AGAIN
    images = nordland(1, part)
    again = [grainy(seen_as(image, View(rng.uniform(-most, most))), noise, rng) for image in images]
    drives = (encoded(drive, BASE) for drive in (nordland(0, part), again, images))
    references, queries, before = ((drive,) for drive in drives)
    return SeasonDrive(references, queries, near(PLACES), before=before)


def turning(world: int, rng: Random) -> SeasonDrive:
    """A synthetic route asked in winter, and once more at night: the night counts."""
    queries = encoded([*synthetic("winter", world), *synthetic("night", world)], BASE)
    truth = np.tile(near(PLACES), (2, 1))
    return SeasonDrive((encoded(synthetic("summer", world), BASE),), (queries,), truth, counted=slice(PLACES, None))


ONCE = (0,)
CASES: Mapping[str, tuple[Callable[[int, Random], SeasonDrive], Sequence[int]]] = {
    **{title: (of_scenario(title), parts) for title, (_, parts) in list(SCENARIOS.items())[:6]},
    **{title: (of_scenario(title), parts) for title, (_, parts) in list(SCENARIOS.items())[-2:]},
    "LENS's example, three views, within 3 places": (events, ONCE),
    "Gardens Point 50:200, one view, within 2 places": (garden("one"), ONCE),
    "Gardens Point 50:200, five views in three scales": (garden("five in three scales (`[views]`)"), ONCE),
    "HOG vectors of Nordland 0:500": (vectors, ONCE),
    f"a second winter drive (images shifted by up to {100 * AGAIN[0]:.0f} %, pixel noise of {AGAIN[1]:.0f}), beginning "
    "with the season of the first": (second, SECTIONS),
    "synthetic: queried in winter, then at night, within one drive; the night counts": (turning, WORLDS),
}


class Paired(NamedTuple):
    """One drive without gains and with them: figures, queries that became right and wrong, and answers that taught, and
    of these those that were wrong."""

    adapted: Metrics
    learning: Metrics
    counts: tuple[int, int, int, int]


def paired(case: SeasonDrive, rule: str, seed: int) -> Paired:
    """What gains do to a drive on what was learned by a rule."""
    config = dataclasses.replace(update(case.config, RULES[rule]), seed=seed)
    model = train(case.references, config, standard=case.standard, pool=ALL_CORES)
    before = None if case.before is None else answered(model, case.before, LEARNING).season
    plain, under = (
        answered(model, case.queries, dataclasses.replace(how, season=before if how.learn else None))
        for how in (ADAPTING, LEARNING)
    )
    (figures, rights), (learned, after) = (judged(drive, case) for drive in (plain, under))
    won, lost = int((after & ~rights).sum()), int((rights & ~after).sum())
    return Paired(figures, learned, (won, lost, *teachers(under.turns, case.truth)))


def judged(drive: Drive, case: SeasonDrive) -> tuple[Metrics, NDArray[np.bool_]]:
    """The figures of the queries of a drive that count, and which of their answers are right, bool (n,)."""
    scores, truth = drive.scores[case.counted], case.truth[case.counted]
    found = hold(case.config.decoder.default, InBlocks.made(scores), truth, Together()).metrics
    return found, np.asarray(truth[np.arange(len(scores)), scores.argmax(axis=1)])


@program("nordland", "gardens", "lens_example")
@seeds_option
def main(seeds: Sequence[int]) -> Printed:
    """R@1 / R@100P / AUC in percent, adapted, without gains and with them; queries won and lost; teachers."""
    rows = []
    for title, (make, parts) in CASES.items():
        cells = []
        for rule in RULES:
            cases = [(make(part, np.random.default_rng((seed, part))), seed) for part, seed in product(parts, seeds)]
            found = [paired(case, rule, seed) for case, seed in cases]
            won, lost, taught, wrong = np.sum([one.counts for one in found], axis=0).tolist()
            cells += [recall([one.adapted for one in found]), recall([one.learning for one in found])]
            cells += [f"{won} / {lost}", f"{taught} / {wrong}"]
        rows.append([title, *cells])
    heads = [f"{rule}, {what}" for rule in RULES for what in ("adapted", "and gains", "won / lost", "taught / wrong")]
    yield BenchmarkTable(["drive", *heads], rows, record="season-elsewhere")
