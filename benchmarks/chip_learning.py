"""Recall of learning as Loihi 2 can do it beside the full learning: Nordland, five sections, exact matches only.

    LAVA_VPR_DATA=... python -m benchmarks.chip_learning [--seeds 0,1,2]

Float and integer learning have rising thresholds, a floor and a step of rest. A chip with Lava's library has neither:
thresholds are folded into the weights between presentations (`engine.learning.lava_order`). That row is trained from
the files that a bundle holds, read back from its bytes.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import SECTIONS, answer, learn, required
from benchmarks.recall import mean
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.bundle.folder import Bundle
from lava_vpr.deploy.bundle.learning import learned_on_chip, learning_files, read_learning
from lava_vpr.engine.threads import cores
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.model import Model

console = Console(highlight=False, width=110)


def on_chip(model: Model) -> Model:
    """The model that the network in a bundle of ``model`` learns."""
    bundle = Bundle(Path("memory"), {}, learning_files(model))
    return learned_on_chip(model, read_learning(bundle), cores())


def figures(places: tuple[int, int], config: Config) -> dict[str, Metrics]:
    """The figures of each way to learn ``places``, by name."""
    whole = learn(places, config)
    models = {
        "float": whole,
        "integers": learn(places, update(config, {"learning": {"arithmetic": "integer"}})),
        "integers, on the chip: no floor, no rest, thresholds folded": on_chip(whole),
    }
    results = {name: answer(model, places, rivals=()) for name, model in models.items()}
    return {name: result.metrics[result.default] for name, result in results.items()}


@click.command()
@click.option("--seeds", default="0,1,2", show_default=True, help="Seeds, separated by commas.")
def main(seeds: str) -> None:
    """Print recall by way of learning."""
    required("nordland")
    chosen = [int(seed) for seed in seeds.split(",")]
    rows = [figures(places, dataclasses.replace(preset("loihi"), seed=seed)) for places in SECTIONS for seed in chosen]
    table = Table(title=f"ways to learn, five sections, seeds {seeds}, percent", title_justify="left")
    table.add_column("", no_wrap=True)
    for name in ("R@1", "R@100P", "AUC"):
        table.add_column(name, justify="right")
    for name in rows[0]:
        table.add_row(name, *(f"{100 * value:.1f}" for value in mean(row[name] for row in rows)))
    console.print(table)


if __name__ == "__main__":
    main()
