"""Options that take traverses, sampling and sections of a benchmark dataset from its row."""

from __future__ import annotations

import click

from lava_vpr.cli.common import RegisteredName, noun, several
from lava_vpr.datasets.layouts import DATASETS
from lava_vpr.datasets.selecting import Benchmark, Selection
from lava_vpr.errors import InputError
from lava_vpr.model import Model


def asked_places(route: Selection, model: Model, places: tuple[int, int] | None) -> tuple[int, int] | None:
    """The range of query images that ``route`` and the user ask ``model`` for, in whole traverses; None: the model's.

    Raises:
        InputError: the model has not learned the section.
    """
    if route.opened is None or route.section is None or route.by_position:
        return places
    first, end = (place * route.opened.layout.step for place in route.opened.dataset.section(route.section))
    if not ((model.place_indices >= first) & (model.place_indices < end)).any():
        raise InputError(
            f"section {route.section} of {route.opened.dataset.title} is images {first}:{end}, of which the model "
            f"has learned none; train it with --dataset {route.opened.dataset.name} --section {route.section}"
        )
    return first, end


dataset_options = several(
    click.option(
        "--dataset",
        type=RegisteredName(DATASETS),
        default=None,
        help="The folder holds this benchmark dataset: take the paper's traverses and sampling.",
    ),
    click.option(
        "--section",
        type=click.IntRange(min=1),
        default=None,
        metavar="K",
        help="One of the dataset's sections, from 1 (default: all its places).",
    ),
)
"""Give a command the options ``--dataset`` and ``--section``."""

benchmark_options = noun("benchmark", lambda dataset, section: Benchmark(dataset, section), dataset_options)
"""The options ``--dataset`` and ``--section``, given to the command as ``benchmark``."""
