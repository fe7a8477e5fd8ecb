"""Maps of many synthetic places: time and memory to learn, to ask and to deploy, each in a process of its own.

    python -m benchmarks commands.large_maps [--places 500 --places 3000 ...] [--deploy 3000] [--eval 3000]

Memory is the most that a run held at any time (ru_maxrss), less what `lava-vpr --version` holds. Times are those of the
whole process, its start included, processor time that of all threads. A map of so many places as ``--deploy`` says is
written as a bundle for Kapoho Bay, whose simulation must give every spike of the host engine on 20 queries
(`lava-vpr verify`), and is benched.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import click

from benchmarks.commands.running import lava_vpr
from benchmarks.program import BenchmarkTable, Printed, program
from lava_vpr.storage.writing import temporary_folder
from lava_vpr.synthetic import write_traverses

QUERIES = 20
COLUMNS = ("", "s", "processor s", "ms a place", "MB", "kB a place")


def asked_of(places: int, many: int) -> Iterator[tuple[str, list[object]]]:
    """What is done with a map, and the command's words."""
    model = f"{places}.lvpr"
    yield "learned", ["train", "world/reference", "--places", f"0:{places}", "-o", model]
    yield f"{QUERIES} queries", ["query", model, "asked", "-o", "answers.csv"]
    if many := min(many, places):
        words = ["eval", model, "world/query", "--places", f"0:{many}", "--baseline", "cosine"]
        yield f"{many:,} queries, eval with cosine", [*words]


def deployed_of(places: int) -> dict[str, list[object]]:
    """The same of what a bundle of a map takes."""
    model, bundle, some = f"{places}.lvpr", f"{places}-kb", ("asked", "--places", f"0:{QUERIES}")
    return {
        "partitioned": ["fit", model, "--target", "kapoho-bay"],
        "bundle written": ["deploy", model, "--target", "kapoho-bay", "-o", bundle],
        f"{QUERIES} queries simulated, all spikes the host's": [
            *("verify", bundle, *some, "--backend", "bundle", "--json", "verified.json")
        ],
        "benched": ["bench", bundle, *some, "--json", "bench.json"],
    }


def row(place: Path, what: str, places: int, words: Sequence[object], base: float) -> list[str]:
    """What a command takes, in all and a place."""
    run = lava_vpr(place, *words)
    held = (run.held - base) / 1e6
    figures = (f"{run.seconds:.1f}", f"{run.used:.1f}", f"{1e3 * run.used / places:.2f}", f"{held:.0f}")
    return [f"{places:,} places: {what}", *figures, f"{1e3 * held / places:.0f}"]


@program()
@click.option("--places", "sizes", type=int, multiple=True, default=(500, 1500, 3000, 10000), show_default=True)
@click.option("--deploy", "deployed", type=int, default=3000, show_default=True, help="Places to deploy; 0: none.")
@click.option("--eval", "many", type=int, default=3000, show_default=True, help="Queries to evaluate; 0: none.")
def main(sizes: Sequence[int], deployed: int, many: int) -> Printed:
    """Time and memory of maps of many places."""
    with temporary_folder() as place:
        write_traverses(place / "world", max(*sizes, deployed), 0)
        (place / "asked").mkdir()
        for k in range(QUERIES):
            name = f"place_{k * min(sizes) // QUERIES:05d}.png"
            shutil.copy(place / "world/query" / name, place / "asked" / name)
        base, rows = lava_vpr(place, "--version").held, []
        for places in sorted({*sizes, deployed} - {0}):
            rows += [row(place, what, places, words, base) for what, words in asked_of(places, many)]
            size = (place / f"{places}.lvpr").stat().st_size
            rows.append([f"{places:,} places: file", "", "", "", f"{size / 1e6:.1f}", f"{size / 1e3 / places:.1f}"])
        yield BenchmarkTable(COLUMNS, rows, title="maps of the synthetic world")
        if deployed:
            rows = [row(place, what, deployed, words, base) for what, words in deployed_of(deployed).items()]
            yield BenchmarkTable(COLUMNS, rows, title="on Kapoho Bay")
            verdict = json.loads((place / "verified.json").read_text())["backends"]["bundle"]
            yield f"bundle against host: {verdict['spikes_compared']:,} spikes compared, equal: {verdict['equal']}"
