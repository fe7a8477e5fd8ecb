"""What takes the answers of ``query`` as they come: a ROS bag, predictions, a matrix of scores, a page to look at."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.answering import Answered
from lava_vpr.cli.common import PATH, console, noun, stage
from lava_vpr.cli.outputs import Outputs, command_line, file_writer, text_writer, write_stdout
from lava_vpr.cli.show.headings import OUTPUT, under
from lava_vpr.encoding import Keep
from lava_vpr.engine.gains import Season
from lava_vpr.errors import shown
from lava_vpr.exchange.predictions import prediction_writer
from lava_vpr.matches import Match
from lava_vpr.matching.answers import UNRANKED, Answers, Together
from lava_vpr.matching.forward_filter import NONE
from lava_vpr.model import Model
from lava_vpr.show.numbers import counted
from lava_vpr.show.page import write_page
from lava_vpr.storage.arrays import npy_begin
from lava_vpr.traverse import Traverse

Take = Callable[[Answered, list[Match]], None]
"""Takes the next answers, and the same for people."""


@dataclass(frozen=True, eq=False)
class Asked:
    """What is asked.

    Attributes:
        model: The model that answers.
        queries: Whose answers come.
        together: How queries are matched with those before them.
        least: The probability from which on a match is accepted; NaN where that is not what decides.
        references: Folder of the reference images; None where nobody says.
    """

    model: Model
    queries: Traverse
    together: Together
    least: float
    references: Path | None


@contextmanager
def bag(path: Path, asked: Asked) -> Iterator[Take]:
    """What writes the bag at ``path``."""
    from lava_vpr.exchange.bags import bag_writer  # only who wants a bag waits for it

    with bag_writer(path, asked.model, asked.queries) as write:
        yield lambda some, found: write(some.images, some.answers, found)


@contextmanager
def predictions(path: Path, asked: Asked) -> Iterator[Take]:
    """What writes the folder of predictions at ``path``."""
    with prediction_writer(path, asked.references) as write:
        yield lambda some, found: write(some.images, found)


@contextmanager
def scores(path: Path, asked: Asked) -> Iterator[Take]:
    """What writes a row of scores for every query, one for each place, as `numpy.load` reads them from ``path``."""
    places = asked.model.places
    with file_writer(path) as write:
        write(npy_begin((len(asked.queries), places), np.float64))

        def take(some: Answered, found: list[Match]) -> None:
            ranking, rows = some.answers.ranking, np.full((len(found), places), np.nan)
            last, columns = ranking.scores.shape
            rows[len(rows) - last :, ranking.first : ranking.first + columns] = ranking.scores
            write(rows.tobytes())

        yield take


@contextmanager
def page(path: Path, asked: Asked) -> Iterator[Take]:
    """What gathers the answers for the page at ``path``, which is written once all are there."""
    from lava_vpr.report.answers import page as text_of  # matplotlib takes a second to import
    from lava_vpr.report.build import answers_data

    command, parts = (
        command_line(click.get_current_context()),
        list[tuple[Answers, NDArray[Any], NDArray[Any] | None]](),
    )
    accepted, causes, seasons = list[bool](), dict[str, None](), list[Season | None]()

    def take(some: Answered, found: list[Match]) -> None:
        if some.thumbnails is not None:
            parts.append((some.answers._replace(ranking=UNRANKED), some.thumbnails, some.grey))
        seasons[:] = [some.season]
        accepted.extend(match.accepted for match in found)
        causes.update(dict.fromkeys(match.cause for match in found if match.cause is not None))

    yield take
    answers = Answers(*(_whole([one[field] for one, *_ in parts]) for field in range(5)))
    thumbnails = np.concatenate([images for _, images, _ in parts])
    with stage("writing the report"):
        data = answers_data(
            asked.model,
            asked.queries,
            answers,
            np.array(accepted),
            thumbnails,
            asked.least,
            command,
            {**_facts(asked), **({"camera": ", ".join(causes)} if causes else {})},
            seasons[-1],
            _whole([grey for *_, grey in parts]),
        )
        write_page(text_of(data), path)


def _whole(parts: list[Any]) -> Any:
    """Arrays in one; None if they are not known."""
    return None if parts[0] is None else np.concatenate(parts)


def _facts(asked: Asked) -> dict[str, str]:
    """How the images were asked, in short."""
    together = asked.together
    facts = {"map": counted(asked.model.places, "place"), "images": str(len(asked.queries))}
    if together.sequence <= 1:
        facts["assumed off the map"] = f"{100 * together.off_map:g} % (--off-map)"
    if together.sequence > 1:
        return {**facts, "sequences of": str(together.sequence)}
    return {**facts, "motion": "each image alone" if together.motion == NONE else together.motion}


STDOUT = Path("-")
"""The name of standard output; a file of this name is ``./-``."""


@dataclass(frozen=True)
class Writing:
    """What is to be written, and where.

    Attributes:
        output: The file, or `STDOUT`; None: none is named.
        form: ``csv``, ``jsonl`` or ``sentence``; None: by the file's name.
        top: How many of the best places of each image are named.
        bag: Folder of a ROS 2 bag; None: none is wanted.
        predictions: Folder of predictions; None: none are wanted.
        reference_folder: Where the reference images lie, for predictions.
        scores: File of all scores; None: none is wanted.
        report_folder: Folder of the page; None: no page.
    """

    output: Path | None
    form: str | None
    top: int
    bag: Path | None
    predictions: Path | None
    reference_folder: Path | None
    scores: Path | None
    report_folder: Path | None

    @property
    def file(self) -> Path | None:
        """The file; None: standard output."""
        return None if self.output == STDOUT else self.output

    @property
    def page(self) -> Path | None:
        """The page's file; None: no page."""
        return None if self.report_folder is None else self.report_folder / "query.html"

    @property
    def keep(self) -> Keep:
        """What is kept of the images."""
        return Keep.NOTHING if self.page is None else Keep.THUMBNAILS | Keep.GREY

    @property
    def lines(self) -> bool:
        """Whether rows go to standard output: not where a page is wanted, and no output is named."""
        return self.file is None and not (self.output is None and self.page is not None)

    @property
    def silent(self) -> bool:
        """Whether lines go to a terminal, where a bar would stand between them."""
        return self.lines and sys.stdout.isatty()

    def outputs(self, motion: str, further: Path | None, **inputs: Any) -> Outputs:
        """The outputs, a ``further`` file among them, beside their ``inputs``; a bag needs a ``motion``."""
        if self.bag is not None and motion == NONE:
            raise click.UsageError("--bag has the covariance of what is believed; give --motion any or forward, too")
        if self.reference_folder is not None and self.predictions is None:
            raise click.UsageError("--references names the folder in the paths of --predictions; give that, too")
        folders = [path for path in (self.bag, self.predictions) if path is not None]
        return Outputs((self.file, self.scores, further), made=(self.page,), folders=folders, **inputs)

    def rows(self) -> AbstractContextManager[Callable[[str], object]]:
        """What writes the rows."""
        if self.file is not None:
            return text_writer(self.file)
        return nullcontext(write_stdout if self.lines else len)

    @contextmanager
    def takers(self, asked: Asked) -> Iterator[Take]:
        """What takes the answers beside."""
        wanted = ((bag, self.bag), (predictions, self.predictions), (scores, self.scores), (page, self.page))
        with ExitStack() as open_ones:
            takers = [open_ones.enter_context(opened(path, asked)) for opened, path in wanted if path is not None]

            def take(some: Answered, found: list[Match]) -> None:
                for one in takers:
                    one(some, found)

            yield take

    def form_of(self, images: int) -> str:
        """How matches are shown: one of the ``images``, and no output named, is shown in words."""
        if self.form is not None:
            return self.form
        if self.output is None and images == 1:
            return "sentence"
        return "jsonl" if self.file is not None and self.file.suffix.lower() == ".jsonl" else "csv"

    def conclude(self, images: int, accepted: int) -> None:
        """Say what was written, unless lines stand where that would be said."""
        if self.lines:
            return
        where_to = "" if self.file is None else f": {shown(self.file)}"
        console.print(f"{counted(images, 'image')}, {accepted} accepted{where_to}")
        if self.page is not None:
            console.print(f"report: {shown(self.page)}")


writing_options = noun(
    "writing",
    Writing,
    under(
        OUTPUT,
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
            help="Report the K best places of each image.",
        ),
        click.option(
            "--bag",
            type=PATH,
            default=None,
            metavar="FOLDER",
            help="Write a ROS 2 bag, too: /initialpose, and rtabmap's posterior and links; with --motion.",
        ),
        click.option(
            "--predictions",
            type=PATH,
            default=None,
            metavar="FOLDER",
            help="Write a text file for each image, too, with the paths of the --top K places, as VPR-methods-"
            "evaluation does.",
        ),
        click.option(
            "--references",
            "reference_folder",
            type=PATH,
            default=None,
            metavar="FOLDER",
            help="Folder of the reference images, for --predictions (default: their names alone).",
        ),
        click.option(
            "--scores",
            type=PATH,
            default=None,
            metavar="FILE.npy",
            help="Write the score of every image at every place, too: float64 (images, places), for numpy.load.",
        ),
        click.option(
            "--report",
            "report_folder",
            type=PATH,
            default=None,
            metavar="DIR",
            help="Write DIR/query.html: each image beside its match, with probabilities and a map.",
        ),
    ),
)
"""What `query` writes, given to the command as ``writing``."""
