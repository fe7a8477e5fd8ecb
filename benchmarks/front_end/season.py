"""The season with the spiking front end: adaptation and gains where the host makes rates, and in one run.

    LAVA_VPR_DATA=... python -m benchmarks front_end.season [--record]

Nordland, learned in summer by STDP and queried in winter in driving order, exact matches; nothing is known of the
season before. Settings of gains are those of `benchmarks.learning.season`, found with other inputs while looking at all
places. In one run gains are in the weights, which are quantised again in each epoch.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.learning.season import (
    ADAPTING,
    LEARNING,
    NEAR,
    WHOLE,
    SeasonedMap,
    driven,
    figures,
    teachers,
    truth_of,
)
from benchmarks.places import ALL_CORES, places, sections_of
from benchmarks.program import BenchmarkTable, Printed, fraction, program, recall, seeds_option
from lava_vpr.backends.asking import PLAINLY
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.training.loop import train

WAYS = (("loihi", "frontend-direct"), ("fast", "frontend-direct"), ("loihi", "frontend"))
"""Preset and input of each network."""
MAPS: Mapping[str, tuple[SeasonedMap, ...]] = {
    "five sections": tuple(map(SeasonedMap, sections_of("nordland", 500))),
    "500 in one map": (NEAR,),
    "1,500 in one map": (WHOLE,),
}
LAST = "adapted and learning"
ASKED = {"as it is": PLAINLY, "adapted": ADAPTING, LAST: LEARNING}
"""How queries are asked; in the last way answers teach."""


@program("nordland", "nordland_long")
@seeds_option
def main(seeds: Sequence[int]) -> Printed:
    """Recall in another season: as it is, adapted, and learning."""
    rows = [
        row(update(preset(name), {"encoder": {"kind": kind}}), f"`--preset {name} --input {kind}`", title, seeds)
        for (name, kind), title in itertools.product(WAYS, MAPS)
    ]
    heads = ["network", "map", *ASKED, "R@1 learning, range of seeds", "taught / wrong"]
    yield BenchmarkTable(heads, rows, record="front-end-season")


def row(config: Config, name: str, title: str, seeds: Sequence[int]) -> list[str]:
    """What a network recalls of a map, asked in each way; means over sections and seeds."""
    ways, taught = MAPS[title], np.zeros(2, np.int64)
    found: dict[str, list[Metrics]] = {how: [] for how in ASKED}
    for seed, way in itertools.product(seeds, ways):
        own = dataclasses.replace(config, seed=seed)
        model = train(places(way.section, way.season, own), own, pool=ALL_CORES)
        for how, asking in ASKED.items():
            drive = driven(model, way, asking)
            found[how].append(figures(drive.scores, way))
        taught += teachers(drive.turns, truth_of(way))
    each = np.reshape([one.recall_at_1 for one in found[LAST]], (len(seeds), len(ways))).mean(axis=1)
    spread = f"{fraction(each.min())} to {fraction(each.max())}"
    return [name, title, *(recall(one) for one in found.values()), spread, "{} / {}".format(*taught.tolist())]
