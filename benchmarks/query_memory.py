"""Memory and time of `lava-vpr query`, each run in a process of its own, for few and for many images.

    [LAVA_VPR_DATA=...] python -m benchmarks.query_memory [--images 100 --images 2000 ...] [--rounds 3] [--other FILE]

A list names the same images again and again: Nordland's winter with LAVA_VPR_DATA, else the synthetic world. What
``--other`` names is the ``lava-vpr`` of another version, measured in turns; both must write the same bytes. Memory is
the most that a run held of it at any time (ru_maxrss), the largest of all rounds. Times are those of the whole process,
its start included, medians of the rounds; processor time is that of all threads.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import folder as nordland
from benchmarks.nordland import required
from lava_vpr import model as model_file
from lava_vpr.config import preset
from lava_vpr.encoding import Keep, encode_traverse
from lava_vpr.engine.threads import cores
from lava_vpr.synthetic import write_traverses
from lava_vpr.training.loop import train
from lava_vpr.traverse import open_traverse

PLACES = 100
STARTER = """
import resource, subprocess, sys, time
began = time.perf_counter()
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
used, unit = resource.getrusage(resource.RUSAGE_CHILDREN), 1 if sys.platform == "darwin" else 1024
print(code, time.perf_counter() - began, used.ru_utime + used.ru_stime, used.ru_maxrss * unit)
"""
"""Starts a command from a process that holds little: Linux counts what the starter held as the command's own."""


class Run(NamedTuple):
    """Seconds that a command took, seconds of processors that it used, and bytes that it held at most."""

    seconds: float
    used: float
    held: float


def measured(words: list[str], place: Path) -> Run:
    """What a command takes that runs in ``place``, which must succeed."""
    command = [sys.executable, "-c", STARTER, *words]
    run = subprocess.run(command, cwd=place, stdout=subprocess.PIPE, text=True, check=True)
    code, *figures = map(float, run.stdout.split())
    if code:
        raise SystemExit(f"{' '.join(words)}: failed, see above")
    return Run(*figures)


def prepare(place: Path, sizes: tuple[int, ...]) -> str:
    """Write a model, and a list of images for each size; what the images are."""
    if os.environ.get("LAVA_VPR_DATA"):
        required("nordland")
        what, reference, query = f"Nordland, {PLACES} places", nordland("summer"), nordland("winter")
    else:
        write_traverses(place / "world", PLACES, 0)
        what, reference, query = f"synthetic world, {PLACES} places", place / "world/reference", place / "world/query"
    config = preset("loihi")
    seen = encode_traverse(open_traverse(reference, places=(0, PLACES)), config.encoder, Keep.ALL)
    model_file.save(train([seen], config, jobs=cores()), place / "model.lvpr")
    paths = open_traverse(query).paths
    for size in (1, *sizes):
        lines = (f"{os.path.abspath(paths[k % len(paths)])}\n" for k in range(size))
        (place / f"{size}.txt").write_text("".join(lines))
    return what


@click.command()
@click.option("--images", "sizes", type=click.IntRange(min=1), multiple=True, default=(100, 2000, 10000))
@click.option("--rounds", default=3, show_default=True)
@click.option("--sequence", default=1, show_default=True)
@click.option("--backend", default="host", show_default=True)
@click.option("--other", type=click.Path(exists=True, dir_okay=False, resolve_path=True), help="Another lava-vpr.")
def main(sizes: tuple[int, ...], rounds: int, sequence: int, backend: str, other: str | None) -> None:
    """Print memory and time of a query for lists of so many images."""
    programs = {"this": [sys.executable, "-m", "lava_vpr"]} | ({"other": [other]} if other else {})
    runs: dict[tuple[int, str], list[Run]] = {(size, name): [] for size in sizes for name in programs}
    with tempfile.TemporaryDirectory(prefix="lava-vpr-") as name:
        place = Path(name)
        what = prepare(place, sizes)
        for program in programs.values():  # kernels are compiled now
            measured([*program, "query", "model.lvpr", "1.txt", "-o", "first.csv"], place)
        for _ in range(rounds):
            for size in sizes:
                for version, program in programs.items():
                    files = ["model.lvpr", f"{size}.txt", "-o", f"{version}.csv"]
                    words = [*program, "query", *files, "--sequence", str(sequence), "--backend", backend]
                    runs[size, version].append(measured(words, place))
                if len({(place / f"{version}.csv").read_bytes() for version in programs}) > 1:
                    raise SystemExit(f"{size} images: the two versions answer differently")
    table = Table(title=f"{what}; backend {backend}, {rounds} rounds, {cores()} cores", title_justify="left")
    for column in ("images", "version", "MB at most", "seconds", "images/s", "processor s"):
        table.add_column(column, justify="right")
    for (size, version), taken in runs.items():
        seconds, used, _ = np.median(np.array(taken), axis=0)
        held = f"{max(run.held for run in taken) / 1e6:.1f}"
        table.add_row(f"{size:,}", version, held, f"{seconds:.2f}", f"{size / seconds:,.0f}", f"{used:.2f}")
    Console(highlight=False, width=120).print(table)


if __name__ == "__main__":
    main()
