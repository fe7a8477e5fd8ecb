"""``lava-vpr query``."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends import registry as backends
from lava_vpr.backends.asking import Asking
from lava_vpr.backends.interface import Advance
from lava_vpr.cli.choose import open_model
from lava_vpr.cli.common import (
    PATH,
    OneSource,
    answer_options,
    asking_options,
    console,
    every_option,
    places_option,
    progress_bar,
)
from lava_vpr.cli.outputs import Outputs, text_writer
from lava_vpr.engine.threads import cores
from lava_vpr.errors import InputError
from lava_vpr.matching.answers import Answers
from lava_vpr.model import Model
from lava_vpr.recognition import Answered, answer_stream
from lava_vpr.storage.tables import csv_line
from lava_vpr.storage.text import shown
from lava_vpr.traverse import open_traverse

COLUMNS = ("query", "query_name", "place", "place_name", "confidence", "accepted")


@click.command(cls=OneSource)
@click.argument("model_path", metavar="MODEL", type=PATH)
@click.argument("images", type=str)
@click.option("-o", "--output", type=PATH, required=True, metavar="matches.csv", help="CSV file to write.")
@places_option("Images A..B-1 only (default: all).")
@every_option
@asking_options
@answer_options
@click.option(
    "--sequence",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Match each image together with those before it.",
)
@click.option(
    "--min-confidence",
    type=float,
    default=None,
    metavar="C",
    help="Accept matches of at least this confidence (default: all).",
)
def query(
    model_path: Path,
    images: str,
    output: Path,
    places: tuple[int, int] | None,
    every: float,
    query_views: int,
    adapt: float | None,
    backend: str,
    sequence: int,
    min_confidence: float | None,
    seed: int | None,
) -> None:
    """Say for each of IMAGES (a folder, list, video or single image) which place it shows.

    Places are given by their index and file name in the reference traverse; -1 is no match.
    """
    if min_confidence is not None and np.isnan(min_confidence):
        raise click.UsageError("--min-confidence is not a number")
    outputs = Outputs((output,), model=model_path, images=(images,))
    model, asking = open_model(model_path), Asking(query_views, adapt)
    asking.check(model)
    backends.require(backend, model)
    whole = open_traverse(images, every=every)
    outputs.spare(whole.paths)
    traverse = whole.between(*places) if places else whole
    if sequence > len(traverse):
        raise InputError(
            f"{shown(images)}: has {len(traverse)} images, fewer than --sequence {sequence}; use a shorter sequence"
        )
    recognised = 0
    with query_progress(traverse.source, backend, len(traverse)) as (read, advance), text_writer(output) as write:
        write(csv_line(COLUMNS))
        stream = answer_stream(
            model,
            traverse,
            backend=backend,
            sequence=sequence,
            asking=asking,
            seed=seed,
            threads=cores(),
            read=read,
            advance=advance,
        )
        for answered in stream:
            accepted = accepted_of(answered.answers, min_confidence)
            recognised += int(accepted.sum())
            write(rows(model, answered, accepted))
    images_read = "1 image" if len(traverse) == 1 else f"{len(traverse)} images"
    console.print(f"{images_read}, {recognised} recognised: {shown(output)}")


@contextmanager
def query_progress(source: str, backend: str, queries: int) -> Iterator[tuple[Advance, Advance]]:
    """A bar for the images that are read, or for the queries that a slow backend has run, with how many are read.

    Yields:
        What is told of further images read, and of further queries run.
    """
    if backend == "host":  # done with an image before the next is read
        with progress_bar(f"reading {source}", queries) as advance:
            yield lambda done: advance(done, ""), lambda done: None
        return
    seen = itertools.count(1)
    with progress_bar(f"running {backend}", queries) as advance:
        yield lambda done: advance(0, f"{next(seen)} read"), lambda done: advance(done, "")


def accepted_of(answers: Answers, least: float | None) -> NDArray[np.bool_]:
    """Which answers are a match of at least the confidence ``least``, bool (n,); None: of any."""
    return (answers.matches >= 0) & (answers.confidence >= (-np.inf if least is None else least))


def rows(model: Model, answered: Answered, accepted: NDArray[np.bool_]) -> str:
    """The answers as rows of CSV; a query without match has place -1, no name and no confidence."""
    lines = []
    for name, index, match, confidence, good in zip(
        answered.names, answered.indices, *answered.answers, accepted, strict=True
    ):
        place = (int(model.place_indices[match]), model.place_names[match]) if match >= 0 else (-1, "")
        certainty = repr(float(confidence)) if match >= 0 else ""
        lines.append(csv_line((int(index), name, *place, certainty, str(bool(good)).lower())))
    return "".join(lines)
