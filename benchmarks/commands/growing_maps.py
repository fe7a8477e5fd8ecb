"""A map of 500 Nordland places extended by the 10 that follow: time, what stays, recall beside learning all at once.

    LAVA_VPR_DATA=... python -m benchmarks commands.growing_maps [--seeds 0,1,2]

The references are summer, the queries winter. Times are those of whole commands, their start included, processor time
that of all threads. Places 0:500 are ``nordland``, 500:510 the first of ``nordland_long``; "together" is one training
of all 510 as a user would start it, which cuts the route into six stretches of 85, "parts" one in the stretches of the
extended map.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.commands.running import lava_vpr
from benchmarks.places import ALL_CORES, images_of
from benchmarks.program import BenchmarkTable, Printed, program, seeds_option
from lava_vpr import maps, model
from lava_vpr.encoding import Keep, encode_views
from lava_vpr.storage.writing import temporary_folder
from lava_vpr.traverse import open_traverse

FIRST, NEW = 500, 10
ALL = FIRST + NEW


def listed(place: Path, season: str) -> Path:
    """A list of all images of a season, of both datasets."""
    paths = [path for name in ("nordland", "nordland_long") for path in open_traverse(images_of(name, season)).paths]
    file = place / f"{season}.txt"
    file.write_text("".join(f"{Path(path).absolute()}\n" for path in paths))
    return file


def recall(place: Path, name: str, winter: Path, first: int, end: int) -> str:
    """R@1 of a model on some winter images, in percent."""
    lava_vpr(place, "eval", f"{name}.lvpr", winter, "--places", f"{first}:{end}", "--json", "f.json")
    values = json.loads((place / "f.json").read_text())
    return f"{first}:{end} {100 * values['decoders'][values['default_decoder']]['recall_at_1']:.1f}"


def extending(place: Path) -> float:
    """Seconds of processors that extending takes without the program's start, reading and writing: median of five."""
    before = model.load(place / "first.lvpr")
    images = open_traverse(images_of("nordland_long", "summer"), places=(0, NEW))
    new = encode_views(images, before.config.encoder, before.config.views.views, Keep.ALL)
    taken = []
    for _ in range(6):  # the first loads kernels
        started = time.process_time()
        maps.extend(before, new, pool=ALL_CORES)
        taken.append(time.process_time() - started)
    return float(np.median(taken[1:]))


def commands(place: Path, seed: int) -> dict[str, list[object]]:
    """The commands of one seed."""
    first, new = (images_of(name, "summer").absolute() for name in ("nordland", "nordland_long"))
    both, some, seeded = (
        [listed(place, "summer"), "--places", f"0:{ALL}"],
        [new, "--places", f"0:{NEW}"],
        ["--seed", seed],
    )
    return {
        f"train, {FIRST} places": ["train", first, "-o", "first.lvpr", *seeded],
        f"train, {NEW} places": ["train", *some, "-o", "new.lvpr", *seeded],
        f"extend by {NEW}": ["extend", "first.lvpr", *some, "-o", "extended.lvpr"],
        "merge both": ["merge", "first.lvpr", "new.lvpr", "-o", "merged.lvpr"],
        "train both, --parts": ["train", *both, "--parts", f"{FIRST},{NEW}", "-o", "parts.lvpr", *seeded],
        "train, together": ["train", *both, "-o", "together.lvpr", *seeded],
        f"remove {NEW} again": ["remove", "extended.lvpr", f"{FIRST}:{ALL}", "-o", "less.lvpr"],
    }


def stayed(place: Path) -> Printed:
    """Whether what should be equal is."""
    files = {(place / f"{name}.lvpr").read_bytes() for name in ("extended", "merged", "parts")}
    yield f"extended, merged and trained in parts: {'byte-equal' if len(files) == 1 else 'DIFFERENT'}"
    before, *after = (model.load(place / f"{name}.lvpr").learned for name in ("first", "extended", "less"))
    stays = all(np.array_equal(before, learned[:, : before.shape[1]]) for learned in after)
    yield f"learned weights of the old places: {'bit-equal' if stays else 'DIFFERENT'}"


@program("nordland", "nordland_long")
@seeds_option
def main(seeds: Sequence[int]) -> Printed:
    """A map of 500 places extended by 10."""
    for seed in seeds:
        with temporary_folder() as place:
            runs = {what: lava_vpr(place, *words) for what, words in commands(place, seed).items()}
            rows = [[what, f"{run.seconds:.1f}", f"{run.used:.1f}"] for what, run in runs.items()]
            yield BenchmarkTable(["", "s", "processor s"], rows, title=f"Nordland, seed {seed}")
            yield f"extending alone, without start and files: {extending(place):.2f} processor s"
            yield from stayed(place)
            winter = listed(place, "winter")
            for trained in ("extended", "together"):
                parts = (recall(place, trained, winter, *part) for part in ((0, FIRST), (FIRST, ALL)))
                yield f"R@1 {trained}: places {', '.join(parts)}"
