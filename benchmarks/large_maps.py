"""Maps of many synthetic places: time and memory to learn, to ask and to deploy, each in a process of its own.

    python -m benchmarks.large_maps [--places 500 --places 3000 ...] [--deploy 3000] [--eval 3000]

Memory is the most that a run held at any time (ru_maxrss), less what `lava-vpr --version` holds. Times are those of the
whole process, its start included, processor time that of all threads. A map of so many places as ``--deploy`` says is
written as a bundle for Kapoho Bay, whose simulation must give every spike of the host engine on 20 queries
(`lava-vpr verify`), and is benched.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from benchmarks.query_memory import Run, measured
from lava_vpr.synthetic import write_traverses

QUERIES = 20
LAVA_VPR = str(Path(sys.executable).with_name("lava-vpr"))
console = Console(highlight=False, width=120)


def _row(table: Table, what: str, places: int, run: Run, base: float, *rest: str) -> None:
    held = (run.held - base) / 1e6
    figures = (f"{run.seconds:.1f}", f"{run.used:.1f}", f"{1e3 * run.used / places:.2f}", f"{held:.0f}")
    table.add_row(f"{places:,} places: {what}", *figures, f"{1e3 * held / places:.0f}", *rest)


def print_sizes(place: Path, sizes: Sequence[int], base: float, many: int) -> None:
    """Print what learning maps of ``sizes`` takes, asking them, and evaluating ``many`` queries."""
    table = Table(title="maps of the synthetic world", title_justify="left")
    for name in ("", "s", "processor s", "ms a place", "MB", "kB a place"):
        table.add_column(name, justify="right" if name else "left")
    for places in sizes:
        model = f"{places}.lvpr"
        words = ["train", "world/reference", "--places", f"0:{places}", "-o", model]
        _row(table, "learned", places, measured([LAVA_VPR, *words], place), base)
        asked = measured([LAVA_VPR, "query", model, "asked", "-o", "answers.csv"], place)
        _row(table, f"{QUERIES} queries", places, asked, base)
        if many:
            words = ["eval", model, "world/query", "--places", f"0:{min(many, places)}", "--baseline", "cosine"]
            all_held = measured([LAVA_VPR, *words], place)
            _row(table, f"{min(many, places):,} queries, eval with cosine", places, all_held, base)
        size = (place / model).stat().st_size
        table.add_row(f"{places:,} places: file", "", "", "", f"{size / 1e6:.1f}", f"{size / 1e3 / places:.1f}")
    console.print(table)


def print_deployed(place: Path, places: int, base: float) -> None:
    """Print what a bundle of a map takes, and that its simulation gives the host's spikes."""
    table = Table(title="on Kapoho Bay", title_justify="left")
    for name in ("", "s", "processor s", "ms a place", "MB", "kB a place"):
        table.add_column(name, justify="right" if name else "left")
    bundle = f"{places}-kb"
    steps = {
        "partitioned": ["fit", f"{places}.lvpr", "--target", "kapoho-bay"],
        "bundle written": ["deploy", f"{places}.lvpr", "--target", "kapoho-bay", "-o", bundle],
        f"{QUERIES} queries simulated, all spikes the host's": [
            *("verify", bundle, "asked", "--backend", "bundle", "--places", f"0:{QUERIES}", "--json", "verified.json")
        ],
        "benched": ["bench", bundle, "asked", "--places", f"0:{QUERIES}", "--json", "bench.json"],
    }
    for what, words in steps.items():
        _row(table, what, places, measured([LAVA_VPR, *words], place), base)
    console.print(table)
    verdict = json.loads((place / "verified.json").read_text())["backends"]["bundle"]
    console.print(f"bundle against host: {verdict['spikes_compared']:,} spikes compared, equal: {verdict['equal']}")


@click.command()
@click.option("--places", "sizes", type=int, multiple=True, default=(500, 1500, 3000, 10000), show_default=True)
@click.option("--deploy", "deployed", type=int, default=3000, show_default=True, help="Places to deploy; 0: none.")
@click.option("--eval", "many", type=int, default=3000, show_default=True, help="Queries to evaluate; 0: none.")
def main(sizes: Sequence[int], deployed: int, many: int) -> None:
    """Print time and memory of maps of many places."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        write_traverses(place / "world", max(*sizes, deployed), 0)
        (place / "asked").mkdir()
        for k in range(QUERIES):
            name = f"place_{k * min(sizes) // QUERIES:05d}.png"
            shutil.copy(place / "world/query" / name, place / "asked" / name)
        base = measured([LAVA_VPR, "--version"], place).held
        print_sizes(place, sorted({*sizes, deployed} - {0}), base, many)
        if deployed:
            print_deployed(place, deployed, base)


if __name__ == "__main__":
    main()
