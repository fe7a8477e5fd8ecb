"""Encoding, the localizer and whole commands of this checkout beside those of another, in turns.

    LAVA_VPR_DATA=... python -m benchmarks versions.whole CHECKOUT [--rounds 5]

Each checkout learns 100, 500 and 1,000 summer images by its own preset, and 2,500, of which the last 1,500 are the
first ones mirrored, then upside down. It is asked by winter images. Figures are processor time of all threads, the
least of all rounds, because other programs share the machine: of each image, of which the median one stands here, and
of commands with their start.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import click
import cv2

from benchmarks.commands.running import command_run
from benchmarks.places import images_of
from benchmarks.program import ROOT, BenchmarkTable, Printed, program, turns
from lava_vpr.errors import InputError
from lava_vpr.images.imagefiles import read_image
from lava_vpr.storage.writing import temporary_folder

PLACES = (100, 500, 2500)
"""Places of the maps that are asked for an image at a time."""
TIMES = """
import json, sys, time
import cv2
from lava_vpr.config import preset
from lava_vpr.encoding import activity_of
from lava_vpr.localizer import Localizer
images, encoder = [cv2.imread(name) for name in sys.argv[3:]], preset("loihi").encoder
def usual(ask, over, rounds):
    best = [9e9] * len(over)
    for _ in range(rounds):
        for k, image in enumerate(over):
            began = time.process_time()
            ask(image)
            best[k] = min(best[k], time.process_time() - began)
    return sorted(best)[len(best) // 2]
found = {"an image of 64 x 32 encoded": usual(lambda image: activity_of(image, encoder), images, 50)}
large = [cv2.resize(image, (1920, 1080)) for image in images[:2]]
found["one of 1920 x 1080"] = usual(lambda image: activity_of(image, encoder), large, 20)
for places in json.loads(sys.argv[1]):
    update = Localizer(sys.argv[2] % places).update
    found[f"`Localizer.update`, {places:,} places"] = usual(update, images, 20)
print(json.dumps(found), file=open("times.json", "w"))
"""


def python_of(checkout: Path) -> Path:
    """The Python of a checkout.

    Raises:
        InputError: it has none of its own.
    """
    python = checkout / ".venv" / "bin" / "python"
    if not python.exists():
        raise InputError(f"{checkout}: has no .venv; run make lint there, or name another checkout")
    return python


def measured(checkout: Path, place: Path) -> dict[str, float]:
    """Seconds of processor time of everything, by its name, once; models of the checkout are in ``place``."""
    python, winter = python_of(checkout), images_of("nordland", "winter").absolute()
    names = sorted(winter.iterdir())[:40]
    command_run(place, python, "-c", TIMES, json.dumps(PLACES), "%d.lvpr", *names)
    found: dict[str, float] = json.loads((place / "times.json").read_text())
    run = partial(command_run, place, python, "-m", "lava_vpr")
    found["`query` of one image, 500 places"] = run("query", "500.lvpr", names[0], "-o", "one.csv").used
    asked = images_of("nordland_long", "winter").absolute()
    found["`query` of 1,000 images, 500 places"] = run("query", "500.lvpr", asked, "-o", "all.csv").used
    found["`eval` of 500 images, 500 places"] = run("eval", "500.lvpr", winter).used
    found["`eval` of 1,000 images, 1,000 places"] = run("eval", "1000.lvpr", asked).used
    return found


def long_route(images: Path, folder: Path) -> Path:
    """``folder`` with 2,500 images: 1,000, the same mirrored, and half of them upside down."""
    folder.mkdir()
    seen = [read_image(path) for path in sorted(images.iterdir())]
    turned = [*seen, *(image[:, ::-1] for image in seen), *(image[::-1] for image in seen[:500])]
    for number, image in enumerate(turned):
        cv2.imwrite(str(folder / f"{number:04d}.png"), image)
    return folder


@program("nordland", "nordland_long")
@click.argument("other", type=click.Path(exists=True, file_okay=False, resolve_path=True, path_type=Path))
@click.option("--rounds", default=5, show_default=True, help="Turns with the other checkout.")
def main(other: Path, rounds: int) -> Printed:
    """Processor time of encoding, updates and commands, here and in the checkout OTHER."""
    with temporary_folder() as place:
        usual, more = (images_of(name, "summer").absolute() for name in ("nordland", "nordland_long"))
        routes = {100: usual, 500: usual, 1000: more, 2500: long_route(more, place / "long")}
        sides = {checkout: place / str(number) for number, checkout in enumerate((ROOT, other))}
        for python, folder in zip(map(python_of, sides), sides.values(), strict=True):
            folder.mkdir()
            for places, route in routes.items():
                words = ("train", route, "--places", f"0:{places}", "-o", f"{places}.lvpr")
                command_run(folder, python, "-m", "lava_vpr", *words)
        taken = turns({checkout: partial(measured, checkout, folder) for checkout, folder in sides.items()}, rounds)
    rows = []
    for name in taken[ROOT][0]:
        here, there = (1e3 * min(found[name] for found in taken[checkout]) for checkout in (ROOT, other))
        cells = (f"{value:,.0f}" if value >= 100 else f"{value:.3g}" for value in (here, there))
        rows.append([name, *cells, f"{there / here:.2f}"])
    columns = ["", "here, ms", "other, ms", "ratio"]
    yield BenchmarkTable(columns, rows, title=f"processor time, least of {rounds} turns", record="versions")
