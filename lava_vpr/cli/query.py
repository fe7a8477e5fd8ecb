"""``lava-vpr query``."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends import registry as backends
from lava_vpr.backends.answering import Answered, answer_stream
from lava_vpr.backends.asking import Asking, calibration_of
from lava_vpr.backends.interface import Advance
from lava_vpr.cli.choose import WhereOptions, query_positions_options
from lava_vpr.cli.common import (
    PATH,
    motion_option,
    noun,
    off_map_option,
    precision_option,
    progress_bar,
    stage,
    stderr,
)
from lava_vpr.cli.nouns import (
    Learning,
    OneSource,
    answer_options,
    asking_options,
    every_option,
    model_at,
    places_option,
    season_option,
    skip_option,
)
from lava_vpr.cli.show.headings import ACCEPTED, TOGETHER, under
from lava_vpr.cli.show.matches import MatchTable, Notes, Row, sentences
from lava_vpr.cli.show.streams import Asked, Writing, writing_options
from lava_vpr.cluster.tasks import Pool
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import InputError, shown
from lava_vpr.matches import Unfollowed, matches_of
from lava_vpr.matching.answers import Answers, Together, accepted, least_probability, sure
from lava_vpr.matching.forward_filter import NONE
from lava_vpr.matching.probability import ASSUMED, HALF, UNREACHED, Calibration
from lava_vpr.matching.sequences import Pace
from lava_vpr.model import Model
from lava_vpr.traverse import Traverse, open_traverse, readable

SHOWN: dict[str, Callable[[MatchTable, Row, float], str]] = {
    "csv": lambda table, row, least: table.csv(row),
    "jsonl": lambda table, row, least: table.json(row),
    "sentence": sentences,
}
"""The text of a query: by the table, from its row, where a match is accepted from some probability on."""


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

    @property
    def trusting(self) -> bool:
        """Whether more matches than by default are accepted, since fewer of the images are taken to be off the map."""
        return self.confidence is None and self.off_map < HALF

    def least(self, together: Together) -> float:
        """The probability from which on a match is accepted; NaN where none is known, or that is not what decides."""
        return least_probability(together, self.precision) if self.confidence is None else math.nan

    def of(self, answers: Answers, least: float) -> NDArray[np.bool_]:
        """Whether each of ``answers`` is accepted, bool (queries,)."""
        return accepted(answers, least) if self.confidence is None else sure(answers, self.confidence)


@click.command(cls=OneSource)
@click.argument("model_path", metavar="MODEL", type=PATH)
@click.argument("images", type=str)
@writing_options
@places_option("Images A..B-1 only (default: all).")
@every_option
@skip_option
@asking_options
@season_option
@answer_options
@motion_option("none", "since IMAGES may be in any order; eval and watch expect a drive")
@under(
    TOGETHER,
    click.option(
        "--sequence",
        type=click.IntRange(min=1),
        default=1,
        show_default=True,
        help="Match each image together with those before it, at the references' own speed.",
    ),
)
@noun(
    "accepting",
    lambda target_precision, min_confidence, off_map: Accepting(target_precision, min_confidence, off_map),
    precision_option,
    under(
        ACCEPTED,
        click.option(
            "--min-confidence",
            type=float,
            default=None,
            metavar="C",
            help="Accept matches of at least this confidence of the decoder instead.",
        ),
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
    skip_unreadable: bool,
    asking: Asking,
    learning: Learning,
    backend: str,
    motion: str,
    sequence: int,
    accepting: Accepting,
    seed: int | None,
    where: WhereOptions,
) -> None:
    """Report which place each of IMAGES (a folder, list, video or single image) shows.

    Places are given by their index and file name in the reference traverse; -1 is no match. A match is listed even if
    it is not accepted. Where positions and times are known, further columns give those of the matched place (x, y or
    lat, lon), the query's time and the error in metres. On standard output each line is written when its image is done.
    """
    files = (*where.files, *learning.files)
    outputs = writing.outputs(motion, learning.gains, read=files, model=model_path, images=(images,))
    model, asking = _asked(model_at(model_path, images), learning.of(asking), motion, where, backend)
    whole = open_traverse(images, every=every, events=model.config.events)
    outputs.spare(whole.paths)
    traverse = where.of(_chosen(whole, places, skip_unreadable, where), len(whole))
    _check_length(traverse, images, sequence)
    table = MatchTable.of(model, traverse, writing.top, chances=motion != NONE)
    together = Together(sequence, motion, _calibration(model, asking), accepting.off_map)
    asking.check_together(together)
    pace = Pace() if sequence > 1 else None
    answer = partial(answer_stream, model, traverse, backend=backend, together=together, asking=asking, seed=seed)
    with query_progress(traverse.source, backend, len(traverse), silent=writing.silent) as (read, advance):
        how = partial(answer, threads=cores(), pace=pace, keep=writing.keep)
        stream = _noted(how(at_once=writing.lines, read=read, advance=advance), model, learning)
        accepted = _write(model, traverse, stream, table, together, writing, accepting)
    _warn(pace, sequence, accepting.trusting and accepted > 0)
    writing.conclude(len(traverse), accepted)


def _warn(pace: Pace | None, sequence: int, trusting: bool) -> None:
    """Say why sequences do not suit the queries, if they do not; and what is assumed of those that are accepted."""
    if trusting:
        stderr.print(f"note: {ASSUMED}")
    if pace is not None and (contradiction := pace.contradiction(sequence)) is not None:
        stderr.print(f"warning: {contradiction}")


def _chosen(whole: Traverse, places: tuple[int, int] | None, skip: bool, where: WhereOptions) -> Traverse:
    """The images that are asked; without those that cannot be read, if these are to be skipped."""
    traverse = whole.between(*places) if places else whole
    if not skip:
        return traverse
    with stage(f"looking for images of {whole.source} that cannot be read"):
        return readable([traverse], [where.positions])[0]


def _noted(stream: Iterator[Answered], model: Model, learning: Learning) -> Iterator[Answered]:
    """``stream``, and at its end what its queries were presented with is written, if that is wanted."""
    parts = []
    for some in stream:
        if learning.gains is not None and some.used is not None:
            parts.append(some.used)
        yield some
    learning.keep(model, parts)


def _check_length(traverse: Traverse, images: str, sequence: int) -> None:
    """Refuse a ``sequence`` that is longer than a traverse of ``images``."""
    if sequence > len(traverse):
        raise InputError(
            f"{shown(images)}: has {len(traverse)} images, fewer than --sequence {sequence}; use a shorter sequence"
        )


def _asked(model: Model, asking: Asking, motion: str, where: WhereOptions, backend: str) -> tuple[Model, Asking]:
    """``model``, seen to be one that can be asked so, and how it is asked."""
    asking = asking.tracking(model, motion)
    asking.check(model)
    where.check(model)
    backends.require(backend, model)
    return model, asking


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
    """Write the rows of the queries as they are answered; how many are accepted."""
    form, least, accepted = writing.form_of(len(traverse)), accepting.least(together), 0
    unfollowed, notes = Unfollowed(), Notes()
    asked = Asked(model, traverse, together, least, writing.reference_folder)
    with ExitStack() as waiting, writing.rows() as write, writing.takers(asked) as take:
        write(table.csv_header() if form == "csv" else "")
        if writing.silent:
            waiting.enter_context(stage(f"reading {traverse.source}"))
        for some in stream:
            done, answers, good = some.images, some.answers, accepting.of(some.answers, least)
            waiting.close()
            radius, top = together.radius, writing.top
            found = matches_of(
                model, answers, good, some.counts, radius=radius, top=top, stamps=done.stamps, signs=some.signs
            )
            accepted += sum(match.accepted for match in found)
            for index, match in zip(done.indices.tolist(), found, strict=True):
                notes.take(index, match)
            take(some, found)
            unfollowed.add(*found)
            write("".join(SHOWN[form](table, row, least) for row in table.rows(done, answers, found)))
    if math.isinf(least) and form != "sentence":  # which says so itself
        stderr.print(f"note: {UNREACHED}")
    if unfollowed.said is not None:
        stderr.print(f"warning: {unfollowed.said}")
    return accepted


@contextmanager
def query_progress(
    source: str, backend: str, queries: int, *, silent: bool = False
) -> Iterator[tuple[Advance, Advance]]:
    """A bar for the images that are read, or for the queries that a slow backend has run, with how many are read.

    Yields:
        Progress callbacks of images read and of queries run.
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
