"""How long one query takes from its command to its answer, most of which is starting.

    LAVA_VPR_DATA=... python -m benchmarks.commands.startup [--rounds 7]

Each command is a process of its own, and they take turns; kernels are in their cache and files in memory, because every
command runs once before. Processor seconds are those of the process, its user's and its system's; medians. Elapsed
seconds hold what other programs on the machine took, too.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import folder, required
from lava_vpr.errors import LavaVprError

MOST = 1.5
"""Seconds that a query of one image may take."""

PYTHON = (sys.executable, "-c")
PROGRAM = (sys.executable, "-m", "lava_vpr")
PLACES = (100, 500)

console = Console(highlight=False, width=118)


def taken(command: tuple[str, ...]) -> tuple[float, float]:
    """Processor and elapsed seconds of ``command``, which must succeed."""
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    elapsed, after = time.monotonic() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        raise click.ClickException(f"{' '.join(command)}: exit code {done.returncode}: {done.stderr.strip()}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, elapsed


def commands(place: Path) -> dict[str, tuple[str, ...]]:
    """What is measured, by its name: what a query imports of others, then whole commands; models are made first."""
    summer, winter = folder("summer"), folder("winter")
    image = str(min(winter.iterdir()))
    every = {
        "python, nothing else": (*PYTHON, "pass"),
        "import numpy": (*PYTHON, "import numpy"),
        "import numba, cv2": (*PYTHON, "import numba, cv2"),
        "import numba, compile x -> x": (*PYTHON, "import numba as n; n.njit(n.int64(n.int64))(lambda x: x)"),
        "lava-vpr --version": (*PROGRAM, "--version"),
    }
    for places in PLACES:
        model = str(place / f"{places}.lvpr")
        taken((*PROGRAM, "train", str(summer), "--places", f"0:{places}", "-o", model))
        query = ("query", model, image, "-o", str(place / f"{places}.csv"))
        every[f"lava-vpr query, 1 image, {places} places"] = (*PROGRAM, *query)
    return every


@click.command()
@click.option("--rounds", default=7, show_default=True, help="Turns of each command.")
def main(rounds: int) -> None:
    """Measure all commands in turns and print a table."""
    required("nordland")
    with tempfile.TemporaryDirectory() as name:
        try:
            every = commands(Path(name))
        except LavaVprError as error:
            raise click.ClickException(str(error)) from None
        for command in every.values():
            taken(command)
        turns = [{what: taken(command) for what, command in every.items()} for _ in range(rounds)]
    load = os.getloadavg()[0]
    table = Table(title=f"Seconds, median of {rounds} turns; load of the machine {load:.1f}", title_justify="left")
    table.add_column("command")
    for column in ("processor", "elapsed"):
        table.add_column(column, justify="right")
    for what in every:
        table.add_row(what, *(f"{statistics.median(turn[what][k] for turn in turns):.2f}" for k in range(2)))
    console.print(table)
    console.print(f"A query of one image may take {MOST} s.")


if __name__ == "__main__":
    main()
