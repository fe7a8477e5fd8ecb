"""Recall beyond one section and one view: long maps, viewpoint, adaptation, a robot that stands still.

    LAVA_VPR_DATA=... python -m benchmarks.maps [--seeds 0,1,2] [--preset loihi] [--part sections --part long ...]

``sections``: five Nordland sections of 100 places, learned as the preset learns, by templates, and with Poisson trains
in queries. ``long``: one model of 500 and of 1,500 places. ``views``: Gardens Point 50:100, within two places, with one
view a place and with several, and what several cost Nordland. ``adapt``: ten further Nordland sections and the five,
adapted, and each image shown 20 times, as to a robot that stands still. Energy is modelled, nominal, dynamic, of Kapoho
Bay, with injected inputs and clearing; baselines see the same inputs.
"""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import part
from lava_vpr.backends.asking import Asking
from lava_vpr.bench.sweep.points import Case, current, figures, runs_of
from lava_vpr.config import Config, EncoderConfig, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.encoding import EncodedTraverse, Keep, encode_views
from lava_vpr.engine.threads import cores
from lava_vpr.errors import InputError
from lava_vpr.inputs.views import ViewsConfig
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.model import Model
from lava_vpr.recognition import Comparison, Recognition, recognise
from lava_vpr.training.loop import train
from lava_vpr.traverse import open_traverse

FOLDERS = {
    "nordland": ("summer", "winter"),
    "nordland_long": ("summer", "winter"),
    "gardens": ("reference", "query"),
}
"""Folders of references and queries by dataset."""
TEMPLATES = {"rule": "template", "epochs": 1}
STANDING = 20
TAU = 30.0
RIVALS = ("cosine", "hog", "sad")
"""Baselines beside the rows that stand for networks without learning (``templates``)."""
console = Console(highlight=False, width=120)

Views = tuple[EncodedTraverse, ...]


def folder_of(dataset: str) -> Path:
    """The folder of a dataset.

    Raises:
        InputError: LAVA_VPR_DATA does not name it.
    """
    root = Path(os.environ.get("LAVA_VPR_DATA", "")) / "data" / dataset
    if not root.is_dir():
        raise InputError(f"{root}: no images; set LAVA_VPR_DATA to the folder that holds data/{dataset}")
    return root


@lru_cache(maxsize=24)
def images(dataset: str, which: int, encoder: EncoderConfig, views: ViewsConfig = ViewsConfig()) -> Views:  # noqa: B008
    """References (0) or queries (1) of a dataset in each view, all that settings of queries leave as it is.

    Raises:
        InputError: LAVA_VPR_DATA does not name them.
    """
    return encode_views(open_traverse(folder_of(dataset) / FOLDERS[dataset][which]), encoder, views.views, Keep.ALL)


def of_pixels(encoder: EncoderConfig) -> EncoderConfig:
    """The settings that activity depends on, the others at their defaults: images are read once for all of these."""
    default = EncoderConfig()
    return dataclasses.replace(
        encoder,
        query_inputs=default.query_inputs,
        query_spikes=default.query_spikes,
        train_spikes=default.train_spikes,
    )


def places(dataset: str, which: int, config: Config, first: int, end: int, views: ViewsConfig | None = None) -> Views:
    """Some images of a dataset; ``nordland_all`` is one list of both parts of the journey."""
    views, encoder = config.views if views is None else views, of_pixels(config.encoder)
    if dataset != "nordland_all":
        return tuple(part(view, slice(first, end)) for view in images(dataset, which, encoder, views))
    pairs = zip(*(images(name, which, encoder, views) for name in ("nordland", "nordland_long")), strict=True)
    return tuple(part(_joined(*pair), slice(first, end)) for pair in pairs)


def _joined(one: EncodedTraverse, two: EncodedTraverse) -> EncodedTraverse:
    """Two traverses, one behind the other."""
    return EncodedTraverse(
        one.names + tuple(f"long-{name}" for name in two.names),
        np.concatenate([one.indices, two.indices + len(one)]),
        np.concatenate([one.activity, two.activity]),
        np.concatenate([one.patches_for("a list"), two.patches_for("a list")]),
        np.concatenate([one.thumbnails_for("a list"), two.thumbnails_for("a list")]),
        np.concatenate([one.hog_for("a list"), two.hog_for("a list")]),
    )


def learn(dataset: str, config: Config, first: int, end: int) -> Model:
    """A model of some places."""
    return train(places(dataset, 0, config, first, end), config, jobs=cores())


def ask(model: Model, dataset: str, first: int, end: int, tolerance: int = 0, **options: Any) -> Recognition:
    """What a model makes of the queries of its places; ``options`` are fields of `Comparison`."""
    comparison = Comparison(keep_scores=False, **{"rivals": RIVALS, **options})
    views = dataclasses.replace(model.config.views, shifts=comparison.asking.views, scales=1)
    queries, *further = places(dataset, 1, model.config, first, end, views)
    numbers = np.arange(end - first)
    truth = np.abs(numbers[:, None] - numbers) <= tolerance
    return recognise(model, queries, truth, comparison, threads=cores(), further=further)


def energy(model: Model, dataset: str, first: int, end: int) -> float:
    """Modelled energy of a query, in uJ."""
    (queries,) = places(dataset, 1, model.config, first, end, ViewsConfig())
    case = Case(model, queries, np.eye(end - first, dtype=bool))
    (run,) = runs_of([case], current(model), KAPOHO_BAY, cores())
    return figures(run, (np.inf,))[0].microjoules


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("", no_wrap=True)
    for name in ("R@1", "R@100P", "AUC", *columns):
        table.add_column(name, justify="right")
    return table


def _row(table: Table, name: str, metrics: Sequence[Metrics], *rest: str) -> None:
    rows = [(m.recall_at_1, m.recall_at_100_precision, m.auc) for m in metrics]
    table.add_row(name, *(f"{100 * value:.1f}" for value in np.mean(rows, axis=0)), *rest)


def sections_of(dataset: str, end: int) -> list[tuple[str, int, int]]:
    """Sections of 100 places."""
    return [(dataset, first, first + 100) for first in range(0, end, 100)]


def print_sections(config: Config, seeds: Sequence[int]) -> None:
    """Print the five sections: as the preset learns, by templates, with Poisson trains, and the baselines."""
    table = _table(f"five sections, preset {config.preset}, seeds {', '.join(map(str, seeds))}", "uJ")
    ways: dict[str, dict[str, Any]] = {
        "as the preset learns": {},
        "templates": {"learning": TEMPLATES},
        "Poisson trains in queries": {"network": {"trains": "poisson", "input_mode": "injected"}},
    }
    for name, changes in ways.items():
        results, joules = [], []
        for where in sections_of("nordland", 500):
            for seed in seeds:
                model = learn(where[0], update(config, changes | {"seed": seed}), *where[1:])
                results.append(ask(model, *where, rivals=() if name != "as the preset learns" else RIVALS))
                joules.append(energy(model, *where) if seed == seeds[0] else np.nan)
        default, half = results[0].default, 2 * len(seeds)
        _row(table, name, [r.metrics[default] for r in results], f"{np.nanmean(joules):.2f}")
        if name == "as the preset learns":
            _row(table, "  0:200, which chose the settings", [r.metrics[default] for r in results[:half]])
            _row(table, "  200:500, which did not", [r.metrics[default] for r in results[half:]])
            for rival in RIVALS:
                _row(table, f"  {rival}", [r.metrics[rival] for r in results])
    console.print(table)


def print_long(config: Config, seeds: Sequence[int]) -> None:
    """Print one model of 500 and of 1,500 places, with the time that it took to learn."""
    table = _table(f"one model, preset {config.preset}, seeds {', '.join(map(str, seeds))}", "s to learn")
    for end in (500, 1500):
        for name, changes in (("as the preset learns", {}), ("templates", {"learning": TEMPLATES})):
            results, seconds = [], []
            for seed in seeds:
                places("nordland_all", 0, config, 0, end)
                started = time.perf_counter()
                model = learn("nordland_all", update(config, changes | {"seed": seed}), 0, end)
                seconds.append(time.perf_counter() - started)
                results.append(ask(model, "nordland_all", 0, end, rivals=RIVALS))
            metrics = [r.metrics[r.default] for r in results]
            _row(table, f"{end:,} places, {name}", metrics, f"{np.mean(seconds):.1f}")
        for rival in RIVALS:
            _row(table, f"{end:,} places, {rival}", [r.metrics[rival] for r in results])
    console.print(table)


def print_views(config: Config, seeds: Sequence[int]) -> None:
    """Print Gardens Point with one view and with several, as neurons and as queries, and what they cost Nordland."""
    table = _table(f"views, preset {config.preset}, seeds {', '.join(map(str, seeds))}")
    ways: list[tuple[str, dict[str, Any], int]] = [
        ("one view", {}, 1),
        ("3 views of the references", {"shifts": 3}, 1),
        ("5 views of the references", {"shifts": 5, "shift": 0.071}, 1),
        ("5 views in 3 scales", {"shifts": 5, "shift": 0.071, "scales": 3}, 1),
        ("3 views of the query", {}, 3),
    ]
    for name, views, query_views in ways:
        for dataset, wanted, tolerance in (
            ("gardens", [("gardens", 50, 100)], 2),
            ("nordland", sections_of("nordland", 500), 0),
        ):
            results = []
            for where in wanted:
                for seed in seeds:
                    model = learn(where[0], update(config, {"views": views, "seed": seed}), *where[1:])
                    results.append(ask(model, *where, tolerance, asking=Asking(query_views)))
            for matcher in (results[0].default, *RIVALS):
                _row(table, f"{dataset}, {name}, {matcher}", [r.metrics[matcher] for r in results])
    console.print(table)


def print_adapted(config: Config, seeds: Sequence[int]) -> None:
    """Print adaptation on the further ten sections and on the five, and for a robot that stands still."""
    table = _table(f"--adapt {TAU:g}, preset {config.preset}, seeds {', '.join(map(str, seeds))}")
    for title, where in (
        ("ten further sections", sections_of("nordland_long", 1000)),
        ("five sections", sections_of("nordland", 500)),
    ):
        results = []
        standing: dict[str, list[Metrics]] = {"single frame": [], "adapted": []}
        for section in where:
            for seed in seeds:
                model = learn(section[0], dataclasses.replace(config, seed=seed), *section[1:])
                results.append(ask(model, *section, asking=Asking(adapt=TAU)))
                for name, metrics in _standing(model, *section).items():
                    standing[name].append(metrics)
        default = results[0].default
        for matcher in (default, *RIVALS):
            _row(table, f"{title}, {matcher}", [r.metrics[matcher] for r in results])
            _row(table, f"{title}, {matcher}, adapted", [r.adapted[matcher] for r in results])
        for name, every in standing.items():
            _row(table, f"{title}, each image {STANDING} times with noise, {name}", every)
    console.print(table)


def _standing(model: Model, dataset: str, first: int, end: int) -> dict[str, Metrics]:
    """Recall where a robot stands still for `STANDING` frames at each place, with a camera's noise on activity."""
    (queries,) = places(dataset, 1, model.config, first, end, ViewsConfig())
    rng = np.random.default_rng(first)
    activity = np.repeat(queries.activity, STANDING, axis=0)
    noisy = activity * rng.normal(1.0, 0.1, activity.shape).clip(0.5, 1.5)
    order = np.repeat(np.arange(len(queries)), STANDING)
    held = dataclasses.replace(
        queries,
        names=tuple(queries.names[k] for k in order),
        indices=np.arange(len(order)),
        activity=noisy.astype(np.float32),
        patches=None,
        thumbnails=None,
        hog=None,
    )
    truth: NDArray[np.bool_] = order[:, None] == np.arange(len(queries))
    comparison = Comparison(rivals=(), keep_scores=False, asking=Asking(adapt=TAU))
    result = recognise(model, held, truth, comparison, threads=cores())
    return {"single frame": result.metrics[result.default], "adapted": result.adapted[result.default]}


PARTS: dict[str, Callable[[Config, Sequence[int]], None]] = {
    "sections": print_sections,
    "long": print_long,
    "views": print_views,
    "adapt": print_adapted,
}


@click.command()
@click.option("--seeds", default="0,1,2", show_default=True, help="Seeds, separated by commas.")
@click.option("--preset", "names", multiple=True, default=("loihi",), show_default=True)
@click.option("--part", "parts", type=click.Choice(list(PARTS)), multiple=True, help="What to print (default: all).")
def main(seeds: str, names: Sequence[str], parts: Sequence[str]) -> None:
    """Print recall on real images beyond one section and one view."""
    chosen = [int(seed) for seed in seeds.split(",")]
    for name in names:
        for title in parts or PARTS:
            PARTS[title](preset(name), chosen)


if __name__ == "__main__":
    main()
