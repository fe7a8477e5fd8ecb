"""What a neuron loses in quantising: what all places share, or what its place shares with its surroundings.

    LAVA_VPR_DATA=... python -m benchmarks learning.surroundings [--chosen] [--seeds 0,1,2] [--record]

Each map is learned by templates and by STDP, and asked in the other season (Gardens Point: on the other side of the
path), each image alone and by a network that adapts to the 30 before. Cells are the means over the seeds of R@1 and
R@100P, in percent, and, of all seeds, how many answers are right that were not with ``0``, and the other way round.
``--chosen`` prints the maps on which numbers may be chosen, learned in either season; without it, others, which were in
sight while the rule was designed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.learning_pays import encoded
from benchmarks.places import ALL_CORES, TEMPLATES, PlacesSection, places, sections_of
from benchmarks.program import BenchmarkTable, Printed, program, seeds_option
from benchmarks.results.rows import TAU
from lava_vpr.backends.asking import Asking
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.matching.evaluation import Metrics, truth_from_indices
from lava_vpr.recognition import DECODERS_ONLY, recognise
from lava_vpr.synthetic.world import World, render
from lava_vpr.training.loop import train

REACHES = (0, 8, 16, 32)
"""Values of ``network.surroundings``; 0: what all places share."""
LEARNERS = {"templates": TEMPLATES, "STDP": {}}
ADAPTED = "adapted"
Asked = tuple[EncodedTraverse, EncodedTraverse]
"""References and queries."""


def sections(chosen: bool) -> dict[str, tuple[PlacesSection, ...]]:
    """Maps by name; of several sections, each is a map by itself."""
    if chosen:
        return {
            "Nordland 0:200": (PlacesSection("nordland", 0, 200),),
            "Nordland 0:100, 100:200": sections_of("nordland", 200),
            "Gardens Point 0:50": (PlacesSection("gardens", 0, 50),),
        }
    return {
        "Nordland, 5 sections of 100": sections_of("nordland", 500),
        "further 1,000, 10 sections of 100": sections_of("nordland_long", 1000),
        "500 in one map": (PlacesSection("nordland", 0, 500),),
        "1,500 in one map": (PlacesSection("nordland_all", 0, 1500),),
        "Gardens Point 50:200": (PlacesSection("gardens", 50, 200),),
    }


def asked(chosen: bool, config: Config) -> Iterator[tuple[str, int, list[Asked]]]:
    """Maps by name, with the tolerance of a match: in both directions of season, and of the built-in world."""
    for name, parts in sections(chosen).items():
        tolerance = 2 if parts[0].dataset == "gardens" else 0
        for way, (learned, queries) in {"": (0, 1), ", back": (1, 0)}.items():
            pairs = [(places(part, learned, config)[0], places(part, queries, config)[0]) for part in parts]
            yield name + way, tolerance, pairs
    if not chosen:
        world = World(seed=0, places=200)
        summer, winter = (
            encoded([render(world, place, season) for place in range(200)], config) for season in ("summer", "winter")
        )
        yield "synthetic world, 200 places", 0, [(summer, winter)]


def found(pair: Asked, config: Config, tolerance: int) -> dict[str, tuple[Metrics, NDArray[np.bool_]]]:
    """Figures and which answers are right, each alone (under no name) and adapted."""
    learned, queries = pair
    model = train([learned], config, pool=ALL_CORES)
    order = np.arange(len(queries))
    truth = truth_from_indices(order, order, tolerance)
    how = {
        name: dataclasses.replace(DECODERS_ONLY, asking=Asking(adapt=tau)) for name, tau in (("", None), (ADAPTED, TAU))
    }
    made = {name: recognise(model, queries, truth, one, pool=ALL_CORES) for name, one in how.items()}
    return {
        name: (
            (result.adapted if name else result.metrics)[result.default],
            truth[order, np.maximum(result.matches, 0)] & (result.matches >= 0),
        )
        for name, result in made.items()
    }


def cells(pairs: Sequence[Asked], config: Config, tolerance: int, seeds: Sequence[int]) -> dict[str, list[str]]:
    """Cells of each of `REACHES`, each alone and adapted."""
    made: dict[str, list[str]] = {"": [], ADAPTED: []}
    plain: dict[str, NDArray[np.bool_]] = {}
    for reach in REACHES:
        configs = [
            dataclasses.replace(update(config, {"network": {"surroundings": reach}}), seed=seed) for seed in seeds
        ]
        results = [found(pair, one, tolerance) for one in configs for pair in pairs]
        for name, row in made.items():
            recalls = np.mean(
                [(m.recall_at_1, m.recall_at_100_precision) for m, _ in (r[name] for r in results)], axis=0
            )
            right = np.concatenate([result[name][1] for result in results])
            before = plain.setdefault(name, right)
            beside = f" (+{int((right & ~before).sum())} -{int((before & ~right).sum())})" if reach else ""
            row.append(" / ".join(f"{100 * value:.1f}" for value in recalls) + beside)
    return made


@program("nordland", "nordland_long", "gardens")
@click.option("--chosen", is_flag=True, help="The maps on which numbers were chosen.")
@seeds_option
def main(seeds: Sequence[int], chosen: bool) -> Printed:
    """Recall by how many neighbours a place's surroundings are."""
    rows = []
    for name, tolerance, pairs in asked(chosen, preset("loihi")):
        for learner, how in LEARNERS.items():
            config = update(preset("loihi"), {"learning": how})
            for asking, row in cells(pairs, config, tolerance, seeds).items():
                rows.append([name, f"{learner}{', ' * bool(asking)}{asking}", *row])
                click.echo(" | ".join(rows[-1]), err=True)
    columns = ["map", "learned by", *(f"surroundings {reach}" for reach in REACHES)]
    title = "R@1 / R@100P, percent (queries won and lost)"
    yield BenchmarkTable(
        columns, rows, title=title, words=2, record="surroundings-chosen" if chosen else "surroundings"
    )
