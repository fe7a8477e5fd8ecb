"""The `paper` preset, VPRSNN's conductance model, on real images, next to SAD, HOG and the default preset.

    LAVA_VPR_DATA=... python -m benchmarks.paper [--sections 0:100,300:400] [--epochs 60]

About two minutes a section. Spikes are those of the last three epochs, plasticity still on, as the released code counts
them; recall is of winter queries, exact matches. The model is as coded but for three things: every presentation starts
from rest, delays of training are kept for testing, and spikes of the rest are not carried over to the next image.
Beside it stand SAD on the same 28x28 patch-normalised images and HOG of 64x64 pixels. The paper's own R@100P on
Nordland, 47.5 %, is of another task: spring and fall as references, summer as queries, a place every 8 s, 15 sections.
"""

from __future__ import annotations

import time

import click
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import answer, learn, required
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.model import Model

console = Console(highlight=False, width=110)


def figures(metrics: Metrics) -> list[str]:
    """R@1, R@100P and AUC in percent."""
    values = (metrics.recall_at_1, metrics.recall_at_100_precision, metrics.auc)
    return [f"{100 * value:.0f}" for value in values]


def describe(model: Model, repeats: int) -> str:
    """How the network spikes, over the ``repeats`` presentations of each place that S^R sums."""
    each = model.responses.sum(axis=0) / repeats
    return (
        f"{each.mean():.1f} spikes per presentation (places: {each.min():.1f} to {each.max():.1f}), "
        f"at most {model.responses.max() / repeats:.1f} by one neuron, "
        f"{model.training['places_covered']:.0f} of {model.places} places covered"
    )


@click.command()
@click.option("--sections", default="0:100,300:400", show_default=True, help="Ranges of places, by commas.")
@click.option("--epochs", default=60, show_default=True, help="Epochs of the paper preset.")
def main(sections: str, epochs: int) -> None:
    """Train both presets on each section and print spikes and recall."""
    required("nordland")
    paper = update(preset("paper"), {"learning": {"epochs": epochs}})
    table = Table(title="winter queries, percent", title_justify="left")
    for column in ("section", "preset", "decoder", "R@1", "R@100P", "AUC"):
        table.add_column(column, justify="right" if column[0] in "RA" else "left")
    for section in sections.split(","):
        first, end = (int(number) for number in section.split(":"))
        started = time.perf_counter()
        model = learn((first, end), paper)
        repeats = min(paper.learning.label_epochs, epochs)  # type: ignore[union-attr]
        console.print(f"{section}, paper, {epochs} epochs in {time.perf_counter() - started:.0f} s:")
        console.print(f"    {describe(model, repeats)}")
        result = answer(model, (first, end))
        console.print(
            f"    query spikes: {result.counts.sum(axis=1).mean():.1f}, at most {result.counts.max()} a neuron"
        )
        for name in ("standard", "weighted", "probability", "weighted_probability", "contrast"):
            table.add_row(section, "paper", name, *figures(result.metrics[name]))
        for name in ("sad", "hog"):
            table.add_row(section, "", name, *figures(result.metrics[name]))
        default = answer(learn((first, end), preset("loihi")), (first, end))
        table.add_row(section, "loihi", default.default, *figures(default.metrics[default.default]))
        for name in ("cosine", "template"):
            table.add_row(section, "", name, *figures(default.metrics[name]))
    console.print(table)


if __name__ == "__main__":
    main()
