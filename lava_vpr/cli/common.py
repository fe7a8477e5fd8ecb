"""What all commands share: options, progress, tables."""

from __future__ import annotations

import inspect
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import click
from rich.console import Console, ConsoleOptions, RenderableType
from rich.measure import Measurement
from rich.segment import Segment
from rich.text import Text

from lava_vpr.backends.asking import PLAINLY, Asking
from lava_vpr.cli.show.headings import ACCEPTED, TOGETHER, several, under
from lava_vpr.config import Config, EncoderConfig
from lava_vpr.encoding import EncodedTraverse, Framing, Keep, encode_views
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import InputError, brief, harmless, shown
from lava_vpr.inputs.vectors import Standard
from lava_vpr.inputs.views import View
from lava_vpr.kernelcache import COMPILING, COMPILING_TEXT
from lava_vpr.matching.forward_filter import MOTIONS, NONE
from lava_vpr.matching.probability import HALF, PRECISION
from lava_vpr.model import Model
from lava_vpr.rows.registry import Registry
from lava_vpr.settings.ranges import declared
from lava_vpr.traverse import Traverse

if TYPE_CHECKING:
    from rich.progress import Progress
    from rich.status import Status

    from lava_vpr.show.table import Table


class Parsed(click.ParamType):
    """The value of an option that is more than a number or a name.

    Args:
        name: How usage shows it.
        parse: Makes the value of its text; its `ValueError` is the message.
        written: The text of a value.
    """

    def __init__(self, name: str, parse: Callable[[str], Any], written: Callable[[Any], str] = str) -> None:
        self.name, self.parse, self.written = name, parse, written

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            return self.parse(value) if isinstance(value, str) else value
        except ValueError as error:
            self.fail(str(error), param, ctx)


def _with_commas(numbers: Iterable[float]) -> str:
    return ",".join(repr(float(number)).removesuffix(".0") for number in numbers)


def whole_numbers(least: int = 1) -> Parsed:
    """Whole numbers of at least ``least``, with commas between."""

    def parse(text: str) -> tuple[int, ...]:
        words = text.split(",")
        if not all(word.isascii() and word.isdigit() and len(word) <= 9 and int(word) >= least for word in words):
            example = f"{500 if least else 0},{10 if least else 1}"
            raise ValueError(
                f"{brief(text)} are no numbers of at least {least} with commas between, for instance {example}"
            )
        return tuple(map(int, words))

    return Parsed("N,N,...", parse, _with_commas)


def different_numbers(text: str) -> tuple[float, ...]:
    """Numbers above 0, each once, with commas between; `ValueError`: the text holds none such."""
    numbers: tuple[float, ...] = ()
    with suppress(ValueError):
        numbers = tuple(map(float, text.split(",")))
    if not numbers or not all(math.isfinite(number) and number > 0 for number in numbers):
        raise ValueError(f"{brief(text)} are no numbers above 0 with commas between, for instance 1,2,4")
    if len(set(numbers)) < len(numbers):
        raise ValueError(f"{brief(text)} names a number twice; give each once")
    return numbers


VALUES = Parsed("X,X,...", different_numbers, _with_commas)


class Number(click.FloatRange):
    """A number in a range. What is no number, or is infinite, is refused, too: it would pass every comparison."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        try:
            number = float(super().convert(value, param, ctx))
        except click.BadParameter as error:
            number = float(click.FLOAT.convert(value, param, ctx))
            if self.max is not None and self.max <= 1 < number <= 100:
                self.fail(f"{error.message} (as a share, {number:g} % is {number / 100:g})", param, ctx)
            raise
        if not math.isfinite(number):
            name = param.opts[0] if param is not None else "the value"
            self.fail(f"{name} is {'not a number' if math.isnan(number) else 'infinite'}", param, ctx)
        return number


class RegisteredName(click.Choice):
    """The name of a row in a registry, which is asked whenever a name is to be checked or the names are to be shown."""

    def __init__(self, registry: Registry[Any]) -> None:
        self.registry = registry
        self.case_sensitive = True

    @property
    def choices(self) -> tuple[str, ...]:  # type: ignore[override]
        """The names of all rows in the registry, as they are now; plug-ins are not loaded for it."""
        return self.registry.names()

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """``value`` if a row has that name, which takes no look at plug-ins for one that is built in."""
        return value if value in self.registry else super().convert(value, param, ctx)


def noun(name: str, make: Callable[..., Any], *options: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Give a command ``options``, the first of them first in its help, whose values it gets together.

    Args:
        name: The command's argument.
        make: Makes it of the options' values, by their names.
        options: As click makes them, or this function.
    """

    def given(command: Any) -> Any:
        @wraps(command)
        def collected(*args: Any, **values: Any) -> Any:
            parts = {key: values.pop(key) for key in inspect.signature(make).parameters if key in values}
            return command(*args, **{name: make(**parts)}, **values)

        return several(*options)(collected)

    return given


def motion_option(default: str, why: str) -> Callable[[Any], Any]:
    """Give a command the option ``--motion``; its help says ``why`` it has this default."""
    option = click.option(
        "--motion",
        type=click.Choice((*MOTIONS, NONE)),
        default=default,
        help="How the robot may move between images: 'any' allows every speed, stops and turns, 'forward' excludes "
        f"driving back, 'none' matches each image by itself (default: {default}, {why}).",
    )
    return under(TOGETHER, option)


precision_option = under(
    ACCEPTED,
    click.option(
        "--target-precision",
        type=Number(min=0.01, max=0.9999),
        default=None,
        metavar="P",
        help="Accept matches above the probability at which this share of the accepted is correct "
        f"(default: {PRECISION}).",
    ),
)
off_map_option = under(
    ACCEPTED,
    click.option(
        "--off-map",
        type=Number(min=0, max=1, max_open=True),
        default=HALF,
        show_default=True,
        metavar="P",
        help="Share of the images that is assumed to be off the map, at no place that MODEL knows.",
    ),
)


def setting_type(section: type, name: str, least: int | None = None) -> click.IntRange:
    """The type of an option for the setting ``name`` of ``section``: its range, from ``least`` on if that is given."""
    of = declared(section)[name].range
    if of is None:
        raise TypeError(f"{name} declares no range")
    return click.IntRange(int(of.least) if least is None else least, int(of.most))


seed_type = setting_type(Config, "seed")


class FilePath(click.Path):
    """A path; an address of the web is none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, str) and re.match("[A-Za-z][A-Za-z0-9+.-]+://", value) and not os.path.lexists(value):
            raise InputError(f"{shown(value)}: nothing is fetched from a network; download it first")
        return super().convert(value, param, ctx)


PATH = FilePath(path_type=Path, readable=False)  # unreadable input is reported with exit code 1, as all data


class PlainConsole(Console):
    """rich's console for texts that others wrote: names of files, words in models and manifests.

    Nothing in a text is taken for markup, for the name of an emoji or for an order to the terminal, be it printed, in a
    table or in a progress bar. A reader who has gone away is left to `OneLineGroup`.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, soft_wrap=True, markup=False, emoji=False, **options)

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError

    def render_str(self, text: str, **options: Any) -> Text:
        """``text`` as rich lays it out: escaped here, so that its width is that of what is shown."""
        return super().render_str(harmless(text), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """What is sent to the terminal: escaped here, too, whatever it was made of."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=harmless(segment.text))


console = PlainConsole()
stderr = PlainConsole(stderr=True)


class Moved(Protocol):
    """What moves a bar."""

    def __call__(self, by: int, note: str = "") -> None: ...


@contextmanager
def progress_bar(text: str, total: int) -> Iterator[Moved]:
    """A bar on a terminal, nothing in a pipe; yields what moves it."""
    if not sys.stderr.isatty():  # rich takes FORCE_COLOR, which Jupyter sets, for a terminal
        yield lambda by, note="": None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}", markup=False),
    )
    bar = Progress(*columns, console=stderr, transient=True)
    task = bar.add_task(_one_line(text), total=total, note="")

    def advance(by: int, note: str = "") -> None:
        if note:
            bar.update(task, advance=by, note=_one_line(note))
        else:
            bar.advance(task, by)

    with _alone(bar, lambda note: bar.update(task, note=_one_line(note), refresh=True)):
        yield advance


@contextmanager
def one_bar() -> Iterator[Callable[[str, int], Moved]]:
    """One bar after another; yields a function of the next one's text and parts, which returns what moves it."""
    with ExitStack() as bars:

        def begin(text: str, parts: int) -> Moved:
            bars.close()
            return bars.enter_context(progress_bar(text, parts))

        yield begin


_SHOWN: list[tuple[Progress | Status, Callable[[str], None]]] = []
"""What is shown on the terminal, or waits until what is shown within it is gone, and what says something beside it: the
innermost last."""


@contextmanager
def _alone(display: Progress | Status, note: Callable[[str], None]) -> Iterator[None]:
    """Show ``display``, and nothing else meanwhile: a terminal has room for one.

    ``note`` says what is added while it is shown: that kernels are compiled, or a stage in it.
    """
    outer, shown = _SHOWN[-1:], (display, note)

    def compiling(begun: bool) -> None:
        note(COMPILING_TEXT if begun else "")

    for waiting, _ in outer:
        waiting.stop()
    _SHOWN.append(shown)
    COMPILING.append(compiling)
    try:
        display.start()
        yield
    finally:
        COMPILING.remove(compiling)
        display.stop()
        _SHOWN.remove(shown)
        if outer and outer[0] in _SHOWN:
            outer[0][0].start()


@contextmanager
def stage(text: str) -> Iterator[None]:
    """Say on a terminal what is being done, from its beginning to its end; nothing in a pipe.

    Within a bar, or another stage, it is said beside.
    """
    if not sys.stderr.isatty():
        yield
        return
    if _SHOWN:
        note = _SHOWN[-1][1]
        note(text)
        try:
            yield
        finally:
            note("")
        return
    from rich.status import Status

    status = Status(Text(harmless(text)), console=stderr, spinner_style="", refresh_per_second=10)

    def say(more: str) -> None:
        status.update(Text(harmless(f"{text}: {more}" if more else text)), spinner="dots")  # which shows it at once

    with _alone(status, say):
        say("")
        yield


def _one_line(text: str) -> str:
    """``text`` as shown beside a bar, which has one line; rich drops some characters that are better shown."""
    return harmless(text).replace("\n", "\\n").replace("\t", " ")


@contextmanager
def backend_progress(backend: str, queries: int) -> Iterator[Callable[[int], None]]:
    """A bar for the queries that a slow backend answers; of the host, which does not count them, a line."""
    if backend == "host":
        with stage(f"recognising {queries:,} images"):
            yield lambda done: None
        return
    with progress_bar(f"running {backend}", queries) as advance:
        yield advance


def encode_queries(
    traverse: Traverse, model: Model, asking: Asking = PLAINLY, keep: Keep = Keep.NOTHING
) -> tuple[EncodedTraverse, ...]:
    """Read a traverse and encode it as ``model`` does, in all views in which it is asked, with a progress bar."""
    views, framing = asking.of(model), asking.framing(model)
    keep |= Keep.NOTHING if model.config.encoder.direct is None else Keep.GREY  # what other backends are shown
    return encode_in_views(traverse, model.config.encoder, views, keep, model.standard, framing)


def encode_in_views(
    traverse: Traverse,
    encoder: EncoderConfig,
    views: Sequence[View],
    keep: Keep,
    standard: Standard | None,
    framing: Framing | None = None,
) -> tuple[EncodedTraverse, ...]:
    """Read and encode a traverse, with a progress bar; ``keep`` is what is kept beside the activity."""
    with progress_bar(f"reading {traverse.source}", len(traverse)) as advance:
        return encode_views(traverse, encoder, views, keep, advance, standard, cores(), framing)


def print_whole(table: Table | str) -> None:
    """Print a line, or a table, in parts where the terminal is narrower: lines may wrap, but no figure is cut."""
    if isinstance(table, str):
        return console.print(table)
    for made in table.parts(console.width):
        width = Measurement.get(console, console.options.update(width=200), made).maximum
        PlainConsole(width=max(console.width, width)).print(made, crop=False)


def print_reasons(reasons: Mapping[str, str | None]) -> None:
    """Print why backends cannot run: each reason once, after the names of all that it holds for.

    Args:
        reasons: The reason by the backend's name; None for one that can run.
    """
    for reason in dict.fromkeys(reason for reason in reasons.values() if reason is not None):
        console.print(f"{', '.join(name for name, why in reasons.items() if why == reason)}: {reason}")
