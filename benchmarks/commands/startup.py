"""How long one query takes from its command to its answer, most of which is starting.

    LAVA_VPR_DATA=... python -m benchmarks commands.startup [--rounds 7]

Each command is a process of its own, and they take turns; kernels are in their cache and files in memory, because every
command runs once before. Processor seconds are those of all threads; medians. Elapsed seconds hold what other programs
on the machine took, too. A query of one image may take 1.5 s.
"""

from __future__ import annotations

import os
import sys
from functools import partial
from pathlib import Path

import click
import numpy as np

from benchmarks.commands.running import PROGRAM, command_run, lava_vpr
from benchmarks.places import images_of
from benchmarks.program import BenchmarkTable, Printed, program, turns
from lava_vpr.storage.writing import temporary_folder

PYTHON = (sys.executable, "-c")


def commands(place: Path) -> dict[str, tuple[object, ...]]:
    """What is measured, by its name: what a query imports of others, then whole commands; models are made first."""
    summer, image = (
        images_of("nordland", "summer").absolute(),
        min(images_of("nordland", "winter").absolute().iterdir()),
    )
    every: dict[str, tuple[object, ...]] = {
        "python, nothing else": (*PYTHON, "pass"),
        "import numpy": (*PYTHON, "import numpy"),
        "import numba, cv2": (*PYTHON, "import numba, cv2"),
        "import lava_vpr.localizer": (*PYTHON, "import lava_vpr.localizer"),
        "import numba, compile x -> x": (*PYTHON, "import numba as n; n.njit(n.int64(n.int64))(lambda x: x)"),
        "lava-vpr --version": (*PROGRAM, "--version"),
    }
    for places in (100, 500):
        lava_vpr(place, "train", summer, "--places", f"0:{places}", "-o", f"{places}.lvpr")
        query = (*PROGRAM, "query", f"{places}.lvpr", image, "-o", f"{places}.csv")
        every[f"lava-vpr query, 1 image, {places} places"] = query
    return every


@program("nordland")
@click.option("--rounds", default=7, show_default=True, help="Turns of each command.")
def main(rounds: int) -> Printed:
    """Measure all commands in turns."""
    with temporary_folder() as place:
        taken = turns({what: partial(command_run, place, *words) for what, words in commands(place).items()}, rounds)
    medians = {what: np.median(np.array(runs), axis=0) for what, runs in taken.items()}
    rows = [[what, f"{used:.2f}", f"{seconds:.2f}"] for what, (seconds, used, _) in medians.items()]
    title = f"seconds, median of {rounds} turns; load of the machine {os.getloadavg()[0]:.1f}"
    yield BenchmarkTable(["command", "processor", "elapsed"], rows, title=title)
