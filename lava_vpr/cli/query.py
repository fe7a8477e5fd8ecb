"""``lava-vpr query``."""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends import registry as backends
from lava_vpr.backends.asking import Asking, calibration_of, open_model
from lava_vpr.backends.interface import Advance
from lava_vpr.cli.common import (
    PATH,
    console,
    counted,
    motion_option,
    noun,
    off_map_option,
    precision_option,
    progress_bar,
    stage,
    stderr,
)
from lava_vpr.cli.nouns import (
    OneSource,
    WhereOptions,
    answer_options,
    asking_options,
    every_option,
    places_option,
    query_positions_options,
)
from lava_vpr.cli.outputs import Outputs, text_writer, write_stdout
from lava_vpr.cli.show.matches import MatchTable, Row, sentences
from lava_vpr.cluster.tasks import Pool
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import InputError, shown
from lava_vpr.matches import Unfollowed, matches_of
from lava_vpr.matching.answers import Answers, Together, accepted, least_probability, sure
from lava_vpr.matching.forward_filter import NONE
from lava_vpr.matching.probability import Calibration
from lava_vpr.matching.sequences import Pace
from lava_vpr.model import Model
from lava_vpr.recognition import Answered, answer_stream
from lava_vpr.traverse import Traverse, open_traverse

STDOUT = Path("-")
"""The name of standard output; a file of this name is ``./-``."""
SHOWN: dict[str, Callable[[MatchTable, Row, float], str]] = {
    "csv": lambda table, row, least: table.csv(row),
    "jsonl": lambda table, row, least: table.json(row),
    "sentence": sentences,
}
"""The text of a query: by the table, from its row, where a match is accepted from some probability on."""


@dataclass(frozen=True)
class Writing:
    """What is to be written, and where.

    Attributes:
        output: The file, or `STDOUT`; None: none is named.
        form: A row of `SHOWN`; None: by the file's name.
        top: How many of the best places of each image are named.
        bag: Folder of a ROS 2 bag; None: none is wanted.
    """

    output: Path | None
    form: str | None
    top: int
    bag: Path | None

    @property
    def file(self) -> Path | None:
        """The file; None: standard output."""
        return None if self.output == STDOUT else self.output

    @property
    def silent(self) -> bool:
        """Whether lines go to a terminal, where a bar would stand between them."""
        return self.file is None and sys.stdout.isatty()

    def outputs(self, motion: str, **inputs: Any) -> Outputs:
        """The outputs beside their ``inputs``; a bag needs a ``motion``."""
        if self.bag is None:
            return Outputs((self.file,), **inputs)
        if motion == NONE:
            raise click.UsageError("--bag has the covariance of what is believed; give --motion any or forward, too")
        return Outputs((self.file,), folders=(self.bag,), **inputs)

    def form_of(self, images: int) -> str:
        """The row of `SHOWN`: one of the ``images``, and no output named, is shown in words."""
        if self.form is not None:
            return self.form
        if self.output is None and images == 1:
            return "sentence"
        return "jsonl" if self.file is not None and self.file.suffix.lower() == ".jsonl" else "csv"


@dataclass(frozen=True)
class Accepting:
    """Which matches are accepted.

    Attributes:
        precision: What share of them is right; None: `PRECISION`.
        confidence: The least confidence of the decoder; None: ``precision`` decides.
        off_map: Share of the images that is taken to be off the map.
    """

    precision: float | None
    confidence: float | None
    off_map: float

    def __post_init__(self) -> None:
        if self.confidence is not None and math.isnan(self.confidence):
            raise click.UsageError("--min-confidence is not a number")

    def least(self, together: Together) -> float:
        """The probability from which on a match is accepted; NaN where none is known, or that is not what decides."""
        return least_probability(together, self.precision) if self.confidence is None else math.nan

    def of(self, answers: Answers, least: float) -> NDArray[np.bool_]:
        """Whether each of ``answers`` is accepted, bool (queries,)."""
        return accepted(answers, least) if self.confidence is None else sure(answers, self.confidence)


@click.command(cls=OneSource)
@click.argument("model_path", metavar="MODEL", type=PATH)
@click.argument("images", type=str)
@noun(
    "writing",
    Writing,
    click.option(
        "-o",
        "--output",
        type=PATH,
        default=None,
        metavar="matches.csv",
        help="File to write, or - for standard output (default: standard output; of one image, a sentence).",
    ),
    click.option(
        "--format",
        "form",
        type=click.Choice(("csv", "jsonl")),
        default=None,
        help="Lines of CSV or of JSON (default: csv, unless the file's name ends in .jsonl).",
    ),
    click.option(
        "--top",
        type=click.IntRange(1, 1000),
        default=1,
        show_default=True,
        metavar="K",
        help="Name the K best places of each image, too.",
    ),
    click.option(
        "--bag",
        type=PATH,
        default=None,
        metavar="FOLDER",
        help="Write a ROS 2 bag, too: /initialpose, and rtabmap's posterior and links; with --motion.",
    ),
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
@noun(
    "accepting",
    lambda target_precision, min_confidence, off_map: Accepting(target_precision, min_confidence, off_map),
    precision_option,
    click.option(
        "--min-confidence",
        type=float,
        default=None,
        metavar="C",
        help="Accept by the decoder's confidence instead: matches of at least this.",
    ),
    off_map_option,
)
@query_positions_options
def query(
    model_path: Path,
    images: str,
    writing: Writing,
    places: tuple[int, int] | None,
    every: float,
    asking: Asking,
    backend: str,
    motion: str,
    sequence: int,
    accepting: Accepting,
    seed: int | None,
    where: WhereOptions,
) -> None:
    """Say for each of IMAGES (a folder, list, video or single image) which place it shows.

    Places are given by their index and file name in the reference traverse; -1 is no match. A match stands there even
    if it is not accepted. Where positions and times are known, columns follow with those of the matched place (x, y or
    lat, lon), the query's time and the metres of error. On standard output lines come as images are done.
    """
    outputs = writing.outputs(motion, read=where.files, model=model_path, images=(images,))
    model = _checked(open_model(model_path), asking, where, backend)
    whole = open_traverse(images, every=every, events=model.config.events)
    outputs.spare(whole.paths)
    traverse = where.of(whole.between(*places) if places else whole, len(whole))
    if sequence > len(traverse):
        raise InputError(
            f"{shown(images)}: has {len(traverse)} images, fewer than --sequence {sequence}; use a shorter sequence"
        )
    table = MatchTable.of(model, traverse, writing.top, chances=motion != NONE)
    together = Together(sequence, motion, _calibration(model, asking), accepting.off_map)
    pace = Pace() if sequence > 1 else None
    answer = partial(answer_stream, model, traverse, backend=backend, together=together, asking=asking, seed=seed)
    with query_progress(traverse.source, backend, len(traverse), silent=writing.silent) as (read, advance):
        stream = answer(threads=cores(), pace=pace, at_once=writing.file is None, read=read, advance=advance)
        recognised = _write(model, traverse, stream, table, together, writing, accepting)
    if pace is not None and (contradiction := pace.contradiction(sequence)) is not None:
        stderr.print(f"warning: {contradiction}")
    if writing.file is not None:
        console.print(f"{counted(len(traverse))}, {recognised} recognised: {shown(writing.file)}")


def _checked(model: Model, asking: Asking, where: WhereOptions, backend: str) -> Model:
    """``model``, seen to be one that can be asked so."""
    asking.check(model)
    where.check(model)
    backends.require(backend, model)
    return model


def _calibration(model: Model, asking: Asking) -> Calibration | None:
    """What is known of single queries: nothing in several views."""
    return None if asking.views > 1 else calibration_of(model, Pool(cores()))


def _write(
    model: Model,
    traverse: Traverse,
    stream: Iterator[Answered],
    table: MatchTable,
    together: Together,
    writing: Writing,
    accepting: Accepting,
) -> int:
    """Write the rows of the queries as they are answered; how many were recognised."""
    form, least, recognised = writing.form_of(len(traverse)), accepting.least(together), 0
    unfollowed = Unfollowed()
    to = nullcontext(write_stdout) if writing.file is None else text_writer(writing.file)
    with ExitStack() as waiting, to as write, _bag(writing.bag, model, traverse) as write_bag:
        write(table.csv_header() if form == "csv" else "")
        if writing.silent:
            waiting.enter_context(stage(f"reading {traverse.source}"))
        for done, answers, counts in stream:
            good = accepting.of(answers, least)
            recognised += int(good.sum())
            waiting.close()
            found = matches_of(
                model, answers, good, counts, radius=together.radius, top=writing.top, stamps=done.stamps
            )
            write_bag(done, answers, found)
            unfollowed.add(*found)
            write("".join(SHOWN[form](table, row, least) for row in table.rows(done, answers, found)))
    if unfollowed.said is not None:
        stderr.print(f"warning: {unfollowed.said}")
    return recognised


def _bag(path: Path | None, model: Model, traverse: Traverse) -> AbstractContextManager[Any]:
    """What writes the bag at ``path``; None: nothing is written."""
    if path is None:
        return nullcontext(lambda *answered: None)
    from lava_vpr.exchange.bags import bag_writer  # only who wants a bag waits for it

    return bag_writer(path, model, traverse)


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
            yield advance, lambda done: None
        return
    seen = itertools.count(1)
    with progress_bar(f"running {backend}", queries) as advance:
        yield lambda done: advance(0, f"{next(seen)} read"), advance
