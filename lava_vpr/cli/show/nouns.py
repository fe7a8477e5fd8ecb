"""Nouns that several commands share: queries, how they are asked, files of results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from lava_vpr.backends.asking import Asking
from lava_vpr.backends.opening import open_model
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.cli.common import PATH, Number, RegisteredName, every_option, noun, places_option, seed_type, several
from lava_vpr.cli.outputs import Outputs
from lava_vpr.model import Model


@dataclass(frozen=True)
class Queries:
    """Which model is asked, and which query images.

    Attributes:
        model_path: File of the model, or folder of a bundle.
        query: Folder, list, video or image.
        places: Images A..B-1; None: the model's range.
        every: Seconds between two frames of a video, or two windows of events.
    """

    model_path: Path
    query: str
    places: tuple[int, int] | None
    every: float

    def model(self, asking: Asking) -> Model:
        """The model, found fit to be asked as ``asking`` says.

        Raises:
            LavaVprError: it cannot be read, or cannot be asked so.
        """
        model = open_model(self.model_path)
        asking.check(model)
        return model


queries_options = noun(
    "asked",
    Queries,
    click.argument("model_path", metavar="MODEL", type=PATH),
    click.argument("query", type=str),
    places_option("Query images A..B-1 (default: the model's own range)."),
    every_option,
)
"""MODEL, QUERY, ``--places`` and ``--every``, given to the command as ``asked``."""

asking_options = noun(
    "asking",
    Asking,
    click.option(
        "--adapt",
        type=Number(min=1),
        default=None,
        metavar="N",
        help="Let biases follow the queries before, with a time constant of N queries.",
    ),
    click.option(
        "--query-views",
        "views",
        type=click.IntRange(1, 99),
        default=1,
        show_default=True,
        help="Sideways views in which each query is presented, an odd number.",
    ),
)
"""``--adapt`` and ``--query-views``, given to the command as ``asking``."""

seed_option = click.option(
    "--seed", type=seed_type, default=None, help="Seed of the queries' spikes (default: the model's)."
)
answer_options = several(
    click.option(
        "--backend", type=RegisteredName(BACKENDS), default="host", show_default=True, help="Where the network runs."
    ),
    seed_option,
)
"""``--backend`` and ``--seed`` of a command that runs a model."""


def json_option(what: str) -> Callable[[Any], Any]:
    """Give a command the option ``--json``, which writes ``what``."""
    return click.option("--json", "json_path", type=PATH, default=None, metavar="FILE", help=f"Write {what} as JSON.")


@dataclass(frozen=True)
class WrittenFiles:
    """Files that a command writes of what it found.

    Attributes:
        json_path: JSON file; None: none.
        report_folder: Folder of the page; None: no page.
    """

    json_path: Path | None
    report_folder: Path | None

    def outputs(self, page: str, **inputs: Any) -> tuple[Outputs, Path | None]:
        """The checked outputs, beside the ``inputs`` of `Outputs`, and the page's file."""
        target = None if self.report_folder is None else self.report_folder / page
        return Outputs((self.json_path,), made=(target,), **inputs), target


def results_options(page: str) -> Callable[[Any], Any]:
    """Give a command the options ``--json`` and ``--report``, as ``results``; the page in the folder is ``page``."""
    report = click.option(
        "--report", "report_folder", type=PATH, default=None, metavar="DIR", help=f"Write DIR/{page}."
    )
    return noun("results", WrittenFiles, json_option("the figures"), report)
