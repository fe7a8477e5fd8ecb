"""The spiking front end: its forms and numbers side by side, and the chosen one beside the orientation channels.

    LAVA_VPR_DATA=... python -m benchmarks front_end.table [--record]

Nordland, learned in summer and queried in winter, exact matches. Forms were chosen on places 0:200 in both directions
and on Gardens Point 0:50; the five sections and all 500 places are printed. Templates stand behind every form, with
seed 0, and STDP behind some lengths of the chosen one. What is counted of a presentation: its steps, neurons times
steps, and the spikes of all populations but the clock, a mean of the references.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.places import (
    FOLDERS,
    SECTIONS,
    TEMPLATES,
    answer,
    encoded,
    images_of,
    learn,
    learned,
    places,
    sections_of,
)
from benchmarks.program import BenchmarkTable, Printed, fraction, program, recall, seeds_option
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.presentations import cores
from lava_vpr.inputs.front_end import COLUMNS, FrontEnd
from lava_vpr.inputs.front_end_kernels import NEVER, raced
from lava_vpr.inputs.front_end_settings import FRONT_END, front_end
from lava_vpr.matching.evaluation import Metrics, Recall
from lava_vpr.recognition import DECODERS_ONLY, Comparison, recognise
from lava_vpr.training.loop import train
from lava_vpr.traverse import open_traverse

Shown = tuple[NDArray[np.int32], NDArray[np.int64]]
Form = Callable[[FrontEnd, NDArray[np.uint8]], Shown]
RIVALRY = 1.93
"""What the response of the direction at right angles takes, where directions inhibit each other."""
CONFIG = update(preset("loihi"), {"encoder": {"kind": "frontend"}, "learning": TEMPLATES})


def in_pairs(spec: FrontEnd, image: NDArray[np.uint8]) -> Shown:
    """As the front end is."""
    return spec.spikes(image)


def responses(spec: FrontEnd, image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """What filters integrate, (rows, columns, directions)."""
    level = (spec.levels - 1 - spec.numbers.pixel_steps[spec.seen(image)]).astype(np.float64)
    found = [cv2.filter2D(level, -1, one.astype(float), borderType=cv2.BORDER_REPLICATE) for one in spec.filters]
    return np.stack(found, axis=-1)[:, ::COLUMNS]


def race_of(spec: FrontEnd, drive: NDArray[np.float64]) -> Shown:
    """The race of neurons with such drives, each by itself."""
    steps = (drive[..., None] <= spec.responses).sum(axis=-1)
    times = np.where(steps < spec.race, spec.levels + steps, NEVER).astype(np.int32)
    return raced(np.ascontiguousarray(times), spec.numbers._replace(apart=0))[:2]


def alone(spec: FrontEnd, image: NDArray[np.uint8]) -> Shown:
    """Filters without pairs, in whose place a relay passes each spike on."""
    return race_of(spec, responses(spec, image))


def inhibited(spec: FrontEnd, image: NDArray[np.uint8]) -> Shown:
    """Filters tell their responses by one spike each, in as many steps as pixels have, and take from those at right
    angles; then what is left races."""
    unit = spec.filter_threshold / spec.levels
    told = np.floor(np.maximum(responses(spec, image), 0) / unit)
    across = np.roll(told, spec.directions // 4, axis=-1) + np.roll(told, -spec.directions // 4, axis=-1)
    return race_of(spec, unit * (told - RIVALRY * across))


FORMS: Mapping[str, tuple[Form, FrontEnd, int]] = {
    "as it is": (in_pairs, FRONT_END, 0),
    "race of 8 steps": (in_pairs, dataclasses.replace(FRONT_END, race=8), 0),
    "race of 20 steps": (in_pairs, dataclasses.replace(FRONT_END, race=20), 0),
    "32 levels, a race of 15 steps": (in_pairs, dataclasses.replace(FRONT_END, levels=32, race=15), 0),
    "16 levels of a pixel": (in_pairs, dataclasses.replace(FRONT_END, levels=16), 0),
    "16 levels, a race of 8 steps": (in_pairs, dataclasses.replace(FRONT_END, levels=16, race=8), 0),
    "at most 3 spikes of a cell": (in_pairs, dataclasses.replace(FRONT_END, most=3), 0),
    "a budget of 60": (in_pairs, dataclasses.replace(FRONT_END, budget=60), 0),
    "a budget of 240": (in_pairs, dataclasses.replace(FRONT_END, budget=240), 0),
    "no pools": (in_pairs, dataclasses.replace(FRONT_END, budget=1 << 16), 0),
    "filters without pairs": (alone, FRONT_END, 0),
    "inhibition in a phase of its own": (inhibited, FRONT_END, FRONT_END.levels),
}
"""Forms: what counts spikes, its numbers, and how many steps it takes more."""


@lru_cache(maxsize=2)
def images(season: str) -> list[NDArray[np.uint8]]:
    """All images of a season."""
    return list(open_traverse(images_of("nordland", season)).images())


def seen(form: Form, spec: FrontEnd, season: str) -> tuple[EncodedTraverse, float]:
    """A season as a form sees it, and the mean of an image's spikes."""
    shown = [form(spec, image) for image in images(season)]
    activity = np.array([counts.ravel() for counts, _ in shown], np.float32)
    kept = dataclasses.replace(encoded(season, CONFIG.encoder), activity=activity)
    return kept, float(np.mean([spikes.sum() for _, spikes in shown]))


def metrics(references: EncodedTraverse, queries: EncodedTraverse, config: Config, part: slice) -> Recall:
    """Figures of some places."""
    model, asked = train([references.take(part)], config, pool=Pool(cores())), queries.take(part)
    found = recognise(model, asked, np.eye(len(asked), dtype=bool), DECODERS_ONLY, pool=Pool(cores()))
    return Recall.of(found.metrics[config.decoder.default])


def recalled(references: EncodedTraverse, queries: EncodedTraverse, config: Config) -> list[str]:
    """R@1 and R@100P of the sections, their means, and R@1 of all places in one map."""
    found = [metrics(references, queries, config, slice(*part)) for part in SECTIONS]
    means = [float(np.mean([getattr(one, name) for one in found])) for name in Recall._fields[:2]]
    whole = metrics(references, queries, config, slice(0, 500))
    return [fraction(value) for value in (*means, whole.recall_at_1)]


HEADS = [
    "form",
    "steps",
    "accesses, millions",
    "spikes",
    "R@1 of five sections",
    "R@100P",
    "R@1 of 500 in one map",
]


@program("nordland", "nordland_long")
@click.option("--chosen", is_flag=True, help="Only lengths of the chosen form, with STDP and each seed.")
@seeds_option
def main(seeds: Sequence[int], chosen: bool) -> Printed:
    """Recall, steps, accesses and spikes of forms of the front end."""
    if not chosen:
        yield forms()
    yield learned_by_spikes(seeds)


def forms() -> BenchmarkTable:
    """Every form, with templates."""
    rows: list[list[Any]] = []
    for name, (form, spec, more) in FORMS.items():
        (references, spikes), (queries, _) = (seen(form, spec, season) for season in FOLDERS["nordland"])
        steps = spec.steps + more
        accesses = sum(spec.populations.values()) * steps / 1e6
        costs = [str(steps), f"{accesses:.2f}", f"{spikes:,.0f}"]
        rows.append([name, *costs, *recalled(references, queries, CONFIG)])
    plain = update(preset("loihi"), {"learning": TEMPLATES})
    host = [encoded(season, plain.encoder) for season in FOLDERS["nordland"]]
    rows.append(["`orientation`, on the host", "", "", "", *recalled(host[0], host[1], plain)])
    return BenchmarkTable(HEADS, rows, record="front-end")


VARIANTS: tuple[tuple[str, int, int], ...] = (
    ("loihi", 26, 14),
    ("loihi", 32, 15),
    ("loihi", 16, 8),
    ("fast", 16, 8),
    ("fast", 32, 15),
)
"""Presets, and levels and race of their front end."""
SPELT = {("loihi", 26): " (the default)", ("fast", 16): " (its own)"}


def learned_by_spikes(seeds: Sequence[int]) -> BenchmarkTable:
    """Front ends of two presets with STDP and several seeds, beside HOG of the same images."""
    rows, hog = [], None
    for name, levels, race in VARIANTS:
        sizes = {"pixel_levels": levels, "race_steps": race}
        config = update(preset(name), {"encoder": {"kind": "frontend"} | sizes})
        found = [_of_seed(dataclasses.replace(config, seed=seed), () if hog else ("hog",)) for seed in seeds]
        title = f"`--preset {name}`, {front_end(levels, race).steps} steps{SPELT.get((name, levels), '')}"
        rows.append([title, *_columns(found, config.decoder.default)])
        hog = hog or ["HOG", *_columns(found, "hog")]
    heads = ["matcher", "five sections", "500 in one map", "ten sections of `nordland_long`"]
    return BenchmarkTable(heads, [*rows, hog or []], record="front-end-seeds")


def _of_seed(config: Config, rivals: tuple[str, ...]) -> list[list[Mapping[str, Metrics]]]:
    """Figures by matcher of the five sections, of 500 places in one map, and of ten other sections."""
    found = [answer(learn(part, config), part, rivals=rivals).metrics for part in (*SECTIONS, (0, 500))]
    others = []
    for section in sections_of("nordland_long", 1000):
        queries = places(section, 1, config)[0]
        model, truth = learned(section, config), np.eye(len(queries), dtype=bool)
        others.append(recognise(model, queries, truth, Comparison(rivals=rivals), pool=Pool(cores())).metrics)
    return [found[:-1], found[-1:], others]


def _columns(found: Sequence[list[list[Mapping[str, Metrics]]]], matcher: str) -> list[str]:
    """The mean of each column over its sections and seeds."""
    return [recall([one[matcher] for part in parts for one in part]) for parts in zip(*found, strict=True)]
