"""What all commands share: options, progress, output files."""

from __future__ import annotations

import fcntl
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import click
from rich.console import Console
from rich.measure import Measurement
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from lava_vpr.backends.registry import BACKENDS
from lava_vpr.config import EncoderConfig
from lava_vpr.encoding import EncodedTraverse, Keep, encode_traverse
from lava_vpr.errors import InputError, ModelFileError
from lava_vpr.storage.writing import write_atomically
from lava_vpr.traverse import Traverse

F = TypeVar("F", bound=Callable[..., Any])


class Places(click.ParamType):
    """The option value ``A:B``: images A..B-1 of a naturally sorted sequence."""

    name = "A:B"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        first, colon, end = str(value).partition(":")
        if not (colon and first.isascii() and end.isascii() and first.isdigit() and end.isdigit()):
            self.fail(f"{value!r} is not of the form A:B, for instance 0:100", param, ctx)
        if int(first) >= int(end):
            self.fail(f"{value!r} holds no place; A must be below B", param, ctx)
        return int(first), int(end)


class RegisteredName(click.Choice):
    """The name of a row in a registry, which is asked whenever a name is to be checked or the names are to be shown."""

    def __init__(self, registry: Mapping[str, Any]) -> None:
        self.registry = registry
        self.case_sensitive = True

    @property
    def choices(self) -> tuple[str, ...]:  # type: ignore[override]
        """The names of all rows in the registry, as they are now."""
        return tuple(self.registry)


class OneSource(click.Command):
    """A command whose last argument is one folder, list, video or image, and which says so if it is given more."""

    allow_extra_args = True

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        rest = super().parse_args(ctx, args)
        if rest and not ctx.resilient_parsing:
            ctx.fail(
                f"{rest[0]!r} is one argument too many ({len(rest)} are); give the folder instead of the images in it, "
                "or a list of them"
            )
        return rest


def places_option(help: str) -> Callable[[F], F]:
    """Give a command the option ``--places A:B``."""
    return click.option("--places", type=Places(), default=None, help=help)


def every_option(command: F) -> F:
    """Give a command the option ``--every SECONDS``."""
    text = "From a video, one frame every so often."
    return click.option("--every", type=float, default=1.0, show_default=True, metavar="SECONDS", help=text)(command)


def answer_options(command: F) -> F:
    """Give a command that runs a model the options ``--backend`` and ``--seed``."""
    text = "Seed of the queries' spikes (default: the model's)."
    seeded = click.option("--seed", type=seed_type, default=None, help=text)(command)
    text = "Where the network runs."
    backend = RegisteredName(BACKENDS)
    return click.option("--backend", type=backend, default="host", show_default=True, help=text)(seeded)


seed_type = click.IntRange(0, 2**63 - 1)
PATH = click.Path(path_type=Path, readable=False)  # what cannot be read is told with exit code 1, as all data


class _Console(Console):
    """rich's console, but a reader who has gone away is left to `OneLineGroup`."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


console = _Console(highlight=False, soft_wrap=True)
stderr = _Console(stderr=True, highlight=False, soft_wrap=True)


@contextmanager
def progress_bar(text: str, total: int) -> Iterator[Callable[[int, str], None]]:
    """A bar on a terminal, nothing in a pipe; yields ``advance(by, note)``."""
    if not sys.stderr.isatty():  # rich takes FORCE_COLOR, which Jupyter sets, for a terminal
        yield lambda by, note: None
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=stderr, transient=True) as bar:
        task = bar.add_task(text, total=total, note="")

        def advance(by: int, note: str) -> None:
            if note:
                bar.update(task, advance=by, note=note)
            else:
                bar.advance(task, by)

        yield advance


@contextmanager
def backend_progress(backend: str, queries: int) -> Iterator[Callable[[int], None]]:
    """A bar for the queries that a slow backend answers; the host is done before it would show."""
    if backend == "host":
        yield lambda done: None
        return
    with progress_bar(f"running {backend}", queries) as advance:
        yield lambda done: advance(done, "")


def encode(traverse: Traverse, encoder: EncoderConfig, keep: Keep = Keep.NOTHING) -> EncodedTraverse:
    """Read and encode a traverse, with a progress bar; ``keep`` is what is kept beside the activity."""
    with progress_bar(f"reading {traverse.source}", len(traverse)) as advance:
        return encode_traverse(traverse, encoder, keep, lambda n: advance(n, ""))


def check_writable(path: Path, *inputs: Path | str | None) -> None:
    """Refuse an output that cannot be written, or that would replace an input, before any work is done.

    Args:
        path: The output.
        inputs: Files and folders that are read.
    Raises:
        InputError: its folder is missing or closed to us, it is no file, or it is one of the inputs.
    """
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name a file")
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is a device or pipe, which would be replaced; name a file")
    target = Path(os.path.realpath(path))
    if any(source is not None and target == Path(os.path.realpath(source)) for source in inputs):
        raise InputError(f"{path}: is also an input, which would be replaced; name another file")
    if not target.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist; create it first")
    if not os.access(target.parent, os.W_OK):
        raise InputError(f"{path}: no permission to write in {path.parent}; choose another place")


@contextmanager
def only_one(path: Path) -> Iterator[None]:
    """Hold ``path`` for this process: two that write the same model would lose each other's work.

    Raises:
        ModelFileError: another process holds it.
    """
    lock = path.with_name(f".{path.name}.lock")
    with lock.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ModelFileError(f"{path}: another training is writing it; wait, or choose another name") from None
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)


def check_folder(path: Path) -> None:
    """Refuse a folder for results that cannot be made, before any work is done.

    Raises:
        InputError: there is a file of that name, or no permission to write.
    """
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: is a file; name a folder")
    existing = next(folder for folder in (path, *path.absolute().parents) if folder.is_dir())
    if not os.access(existing, os.W_OK):
        raise InputError(f"{path}: no permission to write in {existing}; choose another place")


def print_whole(table: Table) -> None:
    """Print a table at its own width: on a narrow terminal lines wrap, but no figure is cut."""
    width = Measurement.get(console, console.options.update(width=200), table).maximum
    _Console(highlight=False, soft_wrap=True, width=max(console.width, width)).print(table, crop=False)


def write_text(path: Path, text: str) -> None:
    """Write a text file in one step.

    Raises:
        InputError: it cannot be written; what was there still is.
    """
    try:
        write_atomically(path, lambda file: file.write(text.encode()))
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); free space or choose another place") from None


def write_json(path: Path, values: dict[str, Any]) -> None:
    """Write JSON so that equal values give equal bytes."""
    write_text(path, json.dumps(values, indent=2, allow_nan=False) + "\n")
