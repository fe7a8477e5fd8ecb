"""What commands ask a model: the model itself, the query images, and which places they show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

import click
import numpy as np
from numpy.typing import NDArray

from lava_vpr import model as model_file
from lava_vpr.cli.common import PATH, Number, stderr
from lava_vpr.cli.outputs import Outputs
from lava_vpr.model import Model
from lava_vpr.traverse import Traverse, open_traverse
from lava_vpr.truth.alignment import aligned_truth, by_number, choose_queries, positions_truth
from lava_vpr.truth.groundtruth import read_ground_truth

F = TypeVar("F", bound=Callable[..., Any])


def open_model(path: Path) -> Model:
    """The model in a file, or in the folder of a deployed bundle.

    Raises:
        ModelFileError: it cannot be used.
    """
    if not path.is_dir():
        return model_file.load(path)
    from lava_vpr.deploy.bundle.opening import open_bundle  # only those who have a bundle wait for it

    return open_bundle(path)


def open_queries(
    model: Model,
    source: str,
    places: tuple[int, int] | None,
    every: float,
    *,
    aligned: bool = True,
    outputs: Outputs | None = None,
) -> Traverse:
    """The query images to answer.

    Args:
        model: The model that answers.
        source: Folder, list, video or image.
        places: Range of images that the user asked for.
        every: Seconds between two frames of a video.
        aligned: No ground truth is given: queries must show the model's places in their order.
        outputs: Of the command; none may be one of the images of ``source``.
    Raises:
        InputError: the images cannot be used; see `choose_queries`.
    """
    whole = open_traverse(source, every=every)
    if outputs is not None:
        outputs.spare(whole.paths)
    return choose_queries(model, whole, places, aligned=aligned)


def truth_in_order(model: Model, queries: Traverse, tolerance: int = 0) -> NDArray[np.bool_]:
    """Query i shows place i, bool (queries, places); what is assumed of the numbers is told on stderr."""
    if not by_number(model, queries):
        stderr.print(
            f"note: images {queries.indices[0]}:{queries.indices[-1] + 1} are taken, in order, as the places "
            f"{model.place_indices[0]}:{model.place_indices[-1] + 1}",
        )
    return aligned_truth(model, queries, tolerance)


@dataclass(frozen=True)
class TruthOptions:
    """What the user says of which places are correct.

    Attributes:
        gt: File with the correct places of each query.
        positions: Files with the positions of the reference and of the query images.
        radius: Metres within which a place is correct, by ``positions``.
        tolerance: Places along the route that a match may be off, without ``gt`` and ``positions``.
    """

    gt: Path | None
    positions: tuple[Path, Path] | None
    radius: float | None
    tolerance: int

    def __post_init__(self) -> None:
        if self.positions is not None and (self.radius is None or self.gt is not None):
            raise click.UsageError("--positions needs --radius M, and excludes --gt")
        if self.radius is not None and self.positions is None:
            raise click.UsageError("--radius needs --positions REF.csv QUERY.csv")
        if self.tolerance and not self.aligned:
            raise click.UsageError(
                "--tolerance counts places along the route; --gt and --positions say themselves what is correct"
            )

    @property
    def aligned(self) -> bool:
        """Whether nothing but the order of the queries says which place each shows."""
        return self.gt is None and self.positions is None

    @property
    def files(self) -> tuple[Path, ...]:
        """The files to be read."""
        return (*(() if self.gt is None else (self.gt,)), *(self.positions or ()))

    def of(self, model: Model, queries: Traverse) -> NDArray[np.bool_]:
        """Which places are correct for which query, bool (queries, places); what is assumed is told on stderr.

        Raises:
            InputError: a file cannot be used, or says nothing about a query.
        """
        if self.gt is not None:
            truth = read_ground_truth(self.gt, queries.indices, model.place_indices)
        elif self.positions is not None and self.radius is not None:
            truth = positions_truth(model, queries, self.positions, self.radius)
        else:
            truth = truth_in_order(model, queries, self.tolerance)
        without = int(np.count_nonzero(~truth.any(axis=1)))
        if without:
            stderr.print(f"note: {without} of {len(truth)} queries show none of the places; they count as not recalled")
        return truth


def truth_options(command: F) -> F:
    """The options ``--gt``, ``--positions``, ``--radius`` and ``--tolerance``, given to the command as ``truth``."""

    @wraps(command)
    def collected(*args: Any, gt: Any, positions: Any, radius: Any, tolerance: Any, **others: Any) -> Any:
        return command(*args, truth=TruthOptions(gt, positions, radius, tolerance), **others)

    options = (
        click.option(
            "--gt",
            type=PATH,
            default=None,
            metavar="FILE",
            help="Correct places of each query: txt, csv, json or npy.",
        ),
        click.option(
            "--positions",
            type=(PATH, PATH),
            default=None,
            metavar="REF.csv QUERY.csv",
            help="Positions of all images; with --radius.",
        ),
        click.option(
            "--radius",
            type=Number(min=0),
            default=None,
            metavar="M",
            help="Metres within which a place is correct.",
        ),
        click.option(
            "--tolerance",
            type=click.IntRange(min=0),
            default=0,
            show_default=True,
            help="Places off that still count.",
        ),
    )
    optional: Any = collected
    for option in reversed(options):
        optional = option(optional)
    return optional
