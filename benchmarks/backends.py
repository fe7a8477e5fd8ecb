"""Recall on real images, backend by backend: Nordland, summer learned, winter recognised, five sections.

    LAVA_VPR_DATA=... python -m benchmarks.backends [--backend lava-float] [--seed 0]

The fixed-point backends give the host's very counts; the floating-point one runs the same network without truncation.
Five hundred presentations take some minutes in Lava.
"""

from __future__ import annotations

import dataclasses
import time

import click
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import SECTIONS, answer, learn, required
from benchmarks.recall import mean
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.config import preset
from lava_vpr.matching.evaluation import Metrics

console = Console(highlight=False, width=110)


def figures(names: tuple[str, ...], seed: int) -> dict[str, list[Metrics]]:
    """The default decoder's figures of each section on each backend, and a note of the time on the console."""
    config = dataclasses.replace(preset("loihi"), seed=seed)
    results: dict[str, list[Metrics]] = {name: [] for name in names}
    for section in SECTIONS:
        model = learn(section, config)
        for name in names:
            started = time.perf_counter()
            result = answer(model, section, backend=name, rivals=())
            results[name].append(result.metrics[result.default])
            seconds = time.perf_counter() - started
            console.print(f"section {section[0]}:{section[1]} on {name}: {seconds:.0f} s", style="dim")
    return results


@click.command()
@click.option("--backend", "names", type=click.Choice(list(BACKENDS)), multiple=True, default=["lava-float"])
@click.option("--seed", default=0, show_default=True)
def main(names: tuple[str, ...], seed: int) -> None:
    """Print recall on the host and on other backends."""
    required("nordland")
    results = figures(("host", *(name for name in names if name != "host")), seed)
    table = Table(title=f"five sections of 100 places, seed {seed}, percent", title_justify="left")
    for column in ("backend", "R@1", "R@100P", "AUC"):
        table.add_column(column, justify="left" if column == "backend" else "right")
    for name, metrics in results.items():
        table.add_row(name, *(f"{100 * value:.1f}" for value in mean(metrics)))
    console.print(table)


if __name__ == "__main__":
    main()
