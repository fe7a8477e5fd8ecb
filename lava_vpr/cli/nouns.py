"""Nouns that several commands share, each with its options: sources, where images were taken, queries, results."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import Any

import click

from lava_vpr.backends.asking import MODELS, OFF, Asking, open_model
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.cli.common import PATH, Number, Parsed, RegisteredName, noun, seed_type
from lava_vpr.cli.outputs import Outputs, show_results
from lava_vpr.cli.show.headings import IMAGES, OUTPUT, PRESENTED, SEASON, Headed, several, under
from lava_vpr.datasets.layouts import DATASETS
from lava_vpr.datasets.selecting import Benchmark
from lava_vpr.errors import InputError, UnreadableError, brief, shown
from lava_vpr.framing import CROPS, NO_CROP
from lava_vpr.model import Model, integer_model
from lava_vpr.season.file import load as load_season
from lava_vpr.season.table import GainTable, Used, load as load_table, save as save_table
from lava_vpr.show.table import FORMS, Table

MODEL_SUFFIX = ".lvpr"


def place_range(text: str) -> tuple[int, int]:
    """``A:B``, images A..B-1 of a naturally sorted sequence, as its numbers; `ValueError`: the text is none."""
    first, colon, end = text.partition(":")
    if not (colon and all(part.isascii() and part.isdigit() and len(part) <= 18 for part in (first, end))):
        raise ValueError(f"{brief(text)} is not of the form A:B, for instance 0:100")
    if int(first) >= int(end):
        raise ValueError(f"{brief(text)} holds no place; A must be below B")
    return int(first), int(end)


class OneSource(Headed):
    """A command whose last argument is one folder, list, video or image, and which says so if it is given more."""

    allow_extra_args = True

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        rest = super().parse_args(ctx, args)
        if rest and not ctx.resilient_parsing:
            ctx.fail(
                f"unexpected argument {brief(rest[0])} ({len(rest)} too many); give the folder instead of the images "
                "in it, or a list of them"
            )
        return rest


def places_option(help: str) -> Callable[[Any], Any]:
    """Give a command the option ``--places A:B``."""
    kind = Parsed("A:B", place_range, lambda ends: f"{ends[0]}:{ends[1]}")
    return under(IMAGES, click.option("--places", type=kind, default=None, help=help))


tolerance_option = click.option(
    "--tolerance",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Number of places by which a match may be off and still be correct.",
)
"""How many places off the true one an answer may be."""

every_option = under(
    IMAGES,
    click.option(
        "--every",
        type=float,
        default=1.0,
        show_default=True,
        metavar="SECONDS",
        help="Seconds between two images of a video, camera, ROS bag or recording of events.",
    ),
)


def skip_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the option ``--skip-unreadable``, which it names where an image cannot be read."""

    @wraps(command)
    def run(*args: Any, **values: Any) -> Any:
        try:
            return command(*args, **values)
        except UnreadableError as error:
            raise InputError(f"{error}, or leave such images out with --skip-unreadable") from None

    option = click.option(
        "--skip-unreadable",
        is_flag=True,
        help="Skip image files that cannot be read or, with exif, have no position, and report how many and which; "
        "the others keep their numbers.",
    )
    return under(IMAGES, option)(run)


dataset_options = under(
    IMAGES,
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


def model_at(path: Path, source: str) -> Model:
    """The model in ``path``, which is to answer the images of ``source``.

    Raises:
        InputError: they are swapped.
        ModelFileError: it cannot be used.
    """
    refuse_swapped(path, source)
    return open_model(path)


def refuse_swapped(path: Path, source: str) -> None:
    """Refuse a ``source`` of images that is a file of a model, where ``path``, that of the model, is none.

    Raises:
        InputError: it is so.
    """
    other = Path(source)
    if other.suffix.lower() == MODEL_SUFFIX and path.suffix.lower() != MODEL_SUFFIX and other.is_file():
        raise InputError(f"{shown(source)} is a model, and {shown(path)} is not; give the model first, then the images")


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
        model = model_at(self.model_path, self.query)
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


class TimeConstant(Number):
    """A number of queries, or one of the words that stand for one."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value in (MODELS, OFF):
            return value
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            self.fail(f"{error.message.rstrip('.')}; give a number of queries, at least 1, or {OFF}", param, ctx)


crop_option = under(
    IMAGES,
    click.option(
        "--crop",
        type=click.Choice(CROPS),
        default=NO_CROP,
        show_default=True,
        help="auto: bars at the edges of images are cropped, or masked where they cover a part of it.",
    ),
)

asking_options = noun(
    "asking",
    Asking.wanted,
    under(
        PRESENTED,
        click.option(
            "--adapt",
            type=TimeConstant(min=1),
            default=MODELS,
            metavar="N|off",
            help="Adapt biases to the previous queries, with a time constant of N queries (default: with a motion the "
            "model's own, else off).",
        ),
        click.option(
            "--query-views",
            "views",
            type=click.IntRange(1, 99),
            default=1,
            show_default=True,
            help="Sideways views in which each query is presented, an odd number.",
        ),
    ),
    crop_option,
)
"""``--adapt``, ``--query-views`` and ``--crop``, given to the command as ``asking``."""


@dataclass(frozen=True)
class Learning:
    """What is learned of the season, and was; or what queries were presented with before.

    Attributes:
        learn: Whether sure answers teach.
        season: File of what was learned before; None: nothing.
        gains: File to be written of what queries are presented with; None: none is wanted.
        replay: Such a file, which is replayed; None: none is.
    """

    learn: bool
    season: Path | None
    gains: Path | None = None
    replay: Path | None = None

    def __post_init__(self) -> None:
        gained = self.learn or self.season is not None
        if self.gains is not None and not gained:
            raise click.UsageError("--gains writes what --learn or --season present queries with; give one of them")
        if self.replay is not None and gained:
            raise click.UsageError("--replay takes all gains from its file; give it without --learn and --season")

    @property
    def files(self) -> tuple[Path, ...]:
        """The files to be read."""
        return tuple(path for path in (self.season, self.replay) if path is not None)

    def of(self, asking: Asking) -> Asking:
        """``asking`` under what was learned, and learning.

        Raises:
            ModelFileError: a file cannot be used.
        """
        asking = replace(self.replayed(asking), learn=self.learn, written=self.gains is not None)
        return replace(asking, season=None if self.season is None else load_season(self.season))

    def replayed(self, asking: Asking) -> Asking:
        """``asking`` as it was presented before, if that is replayed.

        Raises:
            ModelFileError: the file cannot be used.
        """
        if self.replay is None:
            return asking
        if asking.adapt is not None:
            raise click.UsageError("--replay takes all biases from its file; give it without --adapt")
        return replace(asking, replay=load_table(self.replay))

    def keep(self, model: Model, parts: Iterable[Used]) -> None:
        """Write the ``parts`` of what the queries of ``model`` were presented with, if that is wanted."""
        if self.gains is not None:
            save_table(GainTable.of(integer_model(model, "--gains"), parts), self.gains)


_REPLAY = "Present queries with the gains and biases in FILE, written by --gains of the same queries."
replay_option = under(SEASON, click.option("--replay", type=PATH, default=None, metavar="FILE", help=_REPLAY))


def learning_options(file: str, *further: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Give a command ``--learn``, ``--season`` and ``further`` options, as ``learning``; ``file`` says what that is."""
    taught = "Let sure answers teach which inputs survive the season; adapts by default."
    return noun(
        "learning",
        Learning,
        under(
            SEASON,
            click.option("--learn", is_flag=True, help=taught),
            click.option("--season", type=PATH, default=None, metavar="FILE", help=file),
            *further,
        ),
    )


season_option = learning_options(
    "File with the season learned so far; it is not changed.",
    click.option(
        "--gains",
        type=PATH,
        default=None,
        metavar="FILE",
        help="Write the gains and biases that queries are presented with, for --replay on any backend.",
    ),
    replay_option,
)
"""``--learn``, ``--season``, ``--gains`` and ``--replay`` of a command that reads what was learned."""

jobs_option = click.option(
    "--jobs", type=click.IntRange(1, 1024), default=None, help="Threads (default: all processors)."
)
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
        table_path: File of the first table, in the form that its name ends in; None: none.
        report_folder: Folder of the page; None: no page.
        figures_folder: Folder of the page's drawings; None: they are not wanted.
    """

    json_path: Path | None
    table_path: Path | None
    report_folder: Path | None
    figures_folder: Path | None

    def __post_init__(self) -> None:
        if self.table_path is not None and self.table_path.suffix.lower() not in FORMS:
            raise click.UsageError(f"--table FILE must end in one of {', '.join(FORMS)}, not {shown(self.table_path)}")

    def outputs(self, page: str, further: Path | None = None, **inputs: Any) -> tuple[Outputs, Path | None]:
        """The checked outputs, a ``further`` file among them, beside the ``inputs`` of `Outputs`; the page's file."""
        target = None if self.report_folder is None else self.report_folder / page
        folders = () if self.figures_folder is None else (self.figures_folder,)
        return Outputs((self.json_path, self.table_path, further), made=(target,), folders=folders, **inputs), target

    @property
    def drawn(self) -> bool:
        """Whether anything is drawn."""
        return self.report_folder is not None or self.figures_folder is not None

    def show(
        self, said: Iterable[Table | str], values: dict[str, Any], page: Path | None, page_of: Callable[[], str]
    ) -> list[Table]:
        """`show_results` of what is ``said``, with ``values`` as JSON, the first table, the page and its drawings."""
        return show_results(said, {self.json_path: values}, page, page_of, self.table_path, self.figures_folder)


def results_options(page: str) -> Callable[[Any], Any]:
    """Give a command the options ``--json`` and ``--report``, as ``results``; the page in the folder is ``page``."""
    report = click.option(
        "--report", "report_folder", type=PATH, default=None, metavar="DIR", help=f"Write DIR/{page}."
    )
    table = click.option(
        "--table",
        "table_path",
        type=PATH,
        default=None,
        metavar="FILE",
        help="Write the first table, as CSV, Markdown or LaTeX by its name: .csv, .md or .tex.",
    )
    figures = click.option(
        "--figures",
        "figures_folder",
        type=PATH,
        default=None,
        metavar="DIR",
        help=f"Write the drawings of {page} to the new folder DIR, as SVG and PDF.",
    )
    return noun("results", WrittenFiles, under(OUTPUT, json_option("the figures"), table, report, figures))
