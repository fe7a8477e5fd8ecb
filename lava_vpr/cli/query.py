"""``lava-vpr query``."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends import registry as backends
from lava_vpr.cli.choose import open_model
from lava_vpr.cli.common import (
    PATH,
    OneSource,
    answer_options,
    backend_progress,
    console,
    encode,
    every_option,
    places_option,
)
from lava_vpr.cli.outputs import Outputs, write_text
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.threads import cores
from lava_vpr.errors import InputError
from lava_vpr.matching.answers import Answers, answers_looking_back
from lava_vpr.model import Model, decode
from lava_vpr.recognition import count_query_spikes
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
    model = open_model(model_path)
    backends.require(backend, model)
    whole = open_traverse(images, every=every)
    outputs.spare(whole.paths)
    traverse = whole.between(*places) if places else whole
    if sequence > len(traverse):
        raise InputError(
            f"{images}: has {len(traverse)} images, fewer than --sequence {sequence}; use a shorter sequence"
        )
    queries = encode(traverse, model.config.encoder)
    with backend_progress(backend, len(queries)) as advance:
        counts, _ = count_query_spikes(model, queries, backend=backend, seed=seed, threads=cores(), advance=advance)
    decoder = model.config.decoder.default
    answers = answers_looking_back(decoder, decode(model, counts, decoder), sequence)
    accepted = (answers.matches >= 0) & (answers.confidence >= (-np.inf if min_confidence is None else min_confidence))
    write_text(output, table(model, queries, answers, accepted))
    images_read = "1 image" if len(queries) == 1 else f"{len(queries)} images"
    console.print(f"{images_read}, {int(accepted.sum())} recognised: {shown(output)}")


def table(model: Model, queries: EncodedTraverse, answers: Answers, accepted: NDArray[np.bool_]) -> str:
    """The answers as CSV text; a query without match has place -1, no name and no confidence."""
    lines = [csv_line(COLUMNS)]
    rows = zip(queries.names, queries.indices, *answers, accepted, strict=True)
    for name, index, match, confidence, good in rows:
        place = (int(model.place_indices[match]), model.place_names[match]) if match >= 0 else (-1, "")
        certainty = repr(float(confidence)) if match >= 0 else ""
        lines.append(csv_line((int(index), name, *place, certainty, str(bool(good)).lower())))
    return "".join(lines)
