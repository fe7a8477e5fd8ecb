"""``lava-vpr query``."""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import click
import numpy as np

from lava_vpr.backends import registry as backends
from lava_vpr.backends.asking import Asking
from lava_vpr.backends.interface import Advance
from lava_vpr.backends.opening import calibration_of, open_model
from lava_vpr.cli.common import (
    PATH,
    OneSource,
    answer_options,
    asking_options,
    console,
    every_option,
    motion_option,
    places_option,
    precision_option,
    progress_bar,
    stage,
    stderr,
)
from lava_vpr.cli.outputs import Outputs, stdout_writer, text_writer
from lava_vpr.cli.show.matches import Row, Table, sentences
from lava_vpr.cli.whereabouts import WhereOptions, query_positions_options
from lava_vpr.engine.threads import cores
from lava_vpr.errors import InputError
from lava_vpr.matches import matches_of
from lava_vpr.matching.answers import Together, accepted, least_probability, sure
from lava_vpr.matching.forward_filter import NONE
from lava_vpr.matching.sequences import Pace
from lava_vpr.recognition import answer_stream
from lava_vpr.storage.text import shown
from lava_vpr.traverse import open_traverse


@click.command(cls=OneSource)
@click.argument("model_path", metavar="MODEL", type=PATH)
@click.argument("images", type=str)
@click.option(
    "-o",
    "--output",
    type=PATH,
    default=None,
    metavar="matches.csv",
    help="File to write, or - for standard output (default: standard output; of one image, a sentence).",
)
@click.option(
    "--format",
    "form",
    type=click.Choice(("csv", "jsonl")),
    default=None,
    help="Lines of CSV or of JSON (default: csv, unless the file's name ends in .jsonl).",
)
@click.option(
    "--top",
    type=click.IntRange(1, 1000),
    default=1,
    show_default=True,
    metavar="K",
    help="Name the K best places of each image, too.",
)
@places_option("Images A..B-1 only (default: all).")
@every_option
@asking_options
@answer_options
@motion_option("none")
@click.option(
    "--sequence",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Match each image together with those before it, at the references' own speed.",
)
@precision_option
@click.option(
    "--min-confidence",
    type=float,
    default=None,
    metavar="C",
    help="Accept by the decoder's confidence instead: matches of at least this.",
)
@query_positions_options
def query(
    model_path: Path,
    images: str,
    output: Path | None,
    form: str | None,
    top: int,
    places: tuple[int, int] | None,
    every: float,
    query_views: int,
    adapt: float | None,
    backend: str,
    motion: str,
    sequence: int,
    target_precision: float,
    min_confidence: float | None,
    seed: int | None,
    where: WhereOptions,
) -> None:
    """Say for each of IMAGES (a folder, list, video or single image) which place it shows.

    Places are given by their index and file name in the reference traverse; -1 is no match. A match stands there even
    if it is not accepted. Where positions and times are known, columns follow with those of the matched place (x, y or
    lat, lon), the query's time and the metres of error. On standard output lines come as images are done.
    """
    if min_confidence is not None and np.isnan(min_confidence):
        raise click.UsageError("--min-confidence is not a number")
    file = None if output == STDOUT else output
    outputs = Outputs((file,), read=where.files, model=model_path, images=(images,))
    model, asking = open_model(model_path), Asking(query_views, adapt)
    asking.check(model)
    where.check(model)
    backends.require(backend, model)
    whole = open_traverse(images, every=every, events=model.config.events)
    outputs.spare(whole.paths)
    traverse = where.of(whole.between(*places) if places else whole, len(whole))
    if sequence > len(traverse):
        raise InputError(
            f"{shown(images)}: has {len(traverse)} images, fewer than --sequence {sequence}; use a shorter sequence"
        )
    table = Table.of(model, traverse, top, chances=motion != NONE)
    calibration = None if query_views > 1 else calibration_of(model, cores())
    together = Together(sequence, motion, calibration)
    least = least_probability(together, target_precision)
    decisive = least if min_confidence is None else math.nan
    pace = Pace() if sequence > 1 else None
    form = _form(form, file, one=output is None and len(traverse) == 1)
    recognised, waiting = 0, ExitStack()
    silent = file is None and sys.stdout.isatty()  # a bar would stand between the lines
    with (
        waiting,
        query_progress(traverse.source, backend, len(traverse), silent=silent) as (read, advance),
        stdout_writer() if file is None else text_writer(file) as write,
    ):
        write(table.csv_header() if form == "csv" else "")
        if silent:
            waiting.enter_context(stage(f"reading {traverse.source}"))
        stream = answer_stream(
            model,
            traverse,
            backend=backend,
            together=together,
            asking=asking,
            seed=seed,
            threads=cores(),
            pace=pace,
            at_once=file is None,
            read=read,
            advance=advance,
        )
        for done, answers, counts in stream:
            good = accepted(answers, least) if min_confidence is None else sure(answers, min_confidence)
            recognised += int(good.sum())
            waiting.close()
            found = matches_of(model, answers, good, counts, radius=together.radius, top=top, stamps=done.stamps)
            write("".join(SHOWN[form](table, row, decisive) for row in table.rows(done, answers, found)))
    contradiction = None if pace is None else pace.contradiction(sequence)
    if contradiction is not None:
        stderr.print(f"warning: {contradiction}")
    if file is not None:
        images_read = "1 image" if len(traverse) == 1 else f"{len(traverse)} images"
        console.print(f"{images_read}, {recognised} recognised: {shown(file)}")


STDOUT = Path("-")
"""The name of standard output; a file of this name is ``./-``."""
SHOWN: dict[str, Callable[[Table, Row, float], str]] = {
    "csv": lambda table, row, least: table.csv(row),
    "jsonl": lambda table, row, least: table.json(row),
    "sentence": sentences,
}
"""The text of a query: by the table, from its row, where a match is accepted from some probability on."""


def _form(asked: str | None, file: Path | None, *, one: bool) -> str:
    """The row of `SHOWN` for what was ``asked``; ``one`` image, and no output named, is shown in words."""
    if asked is not None:
        return asked
    return "sentence" if one else "jsonl" if file is not None and file.suffix.lower() == ".jsonl" else "csv"


@contextmanager
def query_progress(
    source: str, backend: str, queries: int, *, silent: bool = False
) -> Iterator[tuple[Advance, Advance]]:
    """A bar for the images that are read, or for the queries that a slow backend has run, with how many are read.

    Yields:
        What is told of further images read, and of further queries run.
    """
    if silent:
        yield lambda done: None, lambda done: None
        return
    if backend == "host":  # done with an image before the next is read
        with progress_bar(f"reading {source}", queries) as advance:
            yield lambda done: advance(done, ""), lambda done: None
        return
    seen = itertools.count(1)
    with progress_bar(f"running {backend}", queries) as advance:
        yield lambda done: advance(0, f"{next(seen)} read"), lambda done: advance(done, "")
