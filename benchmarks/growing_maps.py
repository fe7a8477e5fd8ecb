"""A map of 500 Nordland places extended by the 10 that follow: time, what stays, recall beside learning all at once.

    python -m benchmarks.growing_maps [--seed 0 --seed 1 ...]

The references are summer, the queries winter. Times are those of whole commands, their start included, processor time
that of all threads. Places 0:500 are ``nordland``, 500:510 the first of ``nordland_long``; "together" is one training
of all 510 as a user would start it, which cuts the route into six stretches of 85, "parts" one in the stretches of the
extended map.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import images_of, required
from benchmarks.query_memory import Run, measured
from lava_vpr import maps, model
from lava_vpr.encoding import Keep, encode_views
from lava_vpr.engine.threads import cores
from lava_vpr.traverse import open_traverse

FIRST, NEW = 500, 10
ALL = FIRST + NEW
LAVA_VPR = str(Path(sys.executable).with_name("lava-vpr"))
console = Console(highlight=False, width=120)


def listed(place: Path, season: str) -> Path:
    """A list of all images of a season, of both datasets."""
    paths = [path for name in ("nordland", "nordland_long") for path in open_traverse(images_of(name, season)).paths]
    file = place / f"{season}.txt"
    file.write_text("".join(f"{Path(path).absolute()}\n" for path in paths))
    return file


def recall(place: Path, name: str, winter: Path, first: int, end: int) -> float:
    """R@1 of a model on some winter images."""
    words = ["eval", name, winter, "--places", f"{first}:{end}", "--json", "f.json"]
    measured([LAVA_VPR, *map(str, words)], place)
    values = json.loads((place / "f.json").read_text())
    return float(values["decoders"][values["default_decoder"]]["recall_at_1"])


def extending(place: Path) -> float:
    """Seconds of processors that extending takes without the program's start, reading and writing: median of five."""
    before = model.load(place / "first.lvpr")
    images = open_traverse(images_of("nordland_long", "summer"), places=(0, NEW))
    new = encode_views(images, before.config.encoder, before.config.views.views, Keep.ALL)
    taken = []
    for _ in range(6):  # the first loads kernels
        started = time.process_time()
        maps.extend(before, new, jobs=cores())
        taken.append(time.process_time() - started)
    return float(np.median(taken[1:]))


def row(table: Table, what: str, run: Run) -> None:
    """Print what a command took."""
    table.add_row(what, f"{run.seconds:.1f}", f"{run.used:.1f}")


def print_seed(place: Path, seed: int) -> None:
    """Print times, recall and what stayed of one seed."""
    summer, winter = listed(place, "summer"), listed(place, "winter")
    new = str(images_of("nordland_long", "summer").absolute())
    commands = {
        f"train, {FIRST} places": ["train", images_of("nordland", "summer").absolute(), "-o", "first.lvpr"],
        f"train, {NEW} places": ["train", new, "--places", f"0:{NEW}", "-o", "new.lvpr"],
        f"extend by {NEW}": ["extend", "first.lvpr", new, "--places", f"0:{NEW}", "-o", "extended.lvpr"],
        "merge both": ["merge", "first.lvpr", "new.lvpr", "-o", "merged.lvpr"],
        "train both, --parts": [
            "train",
            summer,
            "--places",
            f"0:{ALL}",
            "--parts",
            f"{FIRST},{NEW}",
            "-o",
            "parts.lvpr",
        ],
        "train, together": ["train", summer, "--places", f"0:{ALL}", "-o", "together.lvpr"],
        f"remove {NEW} again": ["remove", "extended.lvpr", f"{FIRST}:{ALL}", "-o", "less.lvpr"],
    }
    table = Table(title=f"Nordland, seed {seed}", title_justify="left")
    for name in ("", "s", "processor s"):
        table.add_column(name, justify="right" if name else "left")
    for what, words in commands.items():
        chosen = [*map(str, words), *(["--seed", str(seed)] if words[0] == "train" else [])]
        row(table, what, measured([LAVA_VPR, *chosen], place))
    console.print(table)
    files = {name: (place / f"{name}.lvpr").read_bytes() for name in ("extended", "merged", "parts", "first", "less")}
    console.print(f"extending alone, without start and files: {extending(place):.2f} processor s")
    equal = files["extended"] == files["merged"] == files["parts"]
    console.print(f"extended, merged and trained in parts: {'byte-equal' if equal else 'DIFFERENT'}")
    before, after = model.load(place / "first.lvpr").learned, model.load(place / "extended.lvpr").learned
    stays = np.array_equal(before, after[:, : before.shape[1]])
    less = np.array_equal(before, model.load(place / "less.lvpr").learned[:, : before.shape[1]])
    console.print(f"learned weights of the old places: {'bit-equal' if stays and less else 'DIFFERENT'}")
    for name in ("extended", "together"):
        old, added = (recall(place, f"{name}.lvpr", winter, *part) for part in ((0, FIRST), (FIRST, ALL)))
        console.print(f"R@1 {name}: places 0:{FIRST} {100 * old:.1f}, {FIRST}:{ALL} {100 * added:.1f}")


@click.command()
@click.option("--seed", "seeds", type=int, multiple=True, default=(0,), show_default=True, help="Seed of the training.")
def main(seeds: Sequence[int]) -> None:
    """A map of 500 places extended by 10."""
    required("nordland", "nordland_long")
    for seed in seeds:
        with tempfile.TemporaryDirectory() as place:
            print_seed(Path(place), seed)


if __name__ == "__main__":
    main()
