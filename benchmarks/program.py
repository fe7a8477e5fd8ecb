"""What benchmarks share as programs: images that must be there, errors of one line, tables printed and recorded; of
searches for settings how recall counts, and a log with a line for every setting that was tried; and programs in
environments of their own, which hold what this project is compared with: files go there and back."""

from __future__ import annotations

import re
import subprocess
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

import click
import numpy as np
from rich.console import Console

from benchmarks import figures
from benchmarks.places import required
from lava_vpr.errors import InputError, LavaVprError
from lava_vpr.experiments.search import Settings, Trial
from lava_vpr.isolated.child import Ended, environment_without_python, run_child
from lava_vpr.matching.evaluation import Metrics, Recall
from lava_vpr.show.table import Table

console = Console(highlight=False, emoji=False, markup=False, width=220)
seeds_option = click.option(
    "--seeds",
    default="0,1,2",
    show_default=True,
    callback=lambda context, option, value: tuple(int(seed) for seed in value.split(",")),
    help="Seeds, separated by commas.",
)


@dataclass(frozen=True)
class BenchmarkTable(Table):
    """A table that a benchmark makes; its cells are Markdown.

    Attributes:
        record: The record in docs/results that ``--record`` takes it into; none if empty.
    """

    record: str = ""


Printed = Iterator[Table | str]
"""What a benchmark makes, one after the other: tables, and lines of text."""


def program(*datasets: str) -> Callable[[Callable[..., Printed]], click.Command]:
    """A command that prints what a function makes, once all images of ``datasets`` are found to be there."""

    def made(function: Callable[..., Printed]) -> click.Command:
        @click.option("--record", is_flag=True, help="Take the tables into docs/results; `make pages` then shows them.")
        @wraps(function)
        def run(record: bool, **options: Any) -> None:
            required(*datasets)
            try:
                for one in function(**options):
                    show(one)
                    if record and isinstance(one, BenchmarkTable) and one.record:
                        figures.write(one.record, taken(one, figures.read(one.record)))
            except LavaVprError as error:
                raise SystemExit(f"error: {error}") from None

        return click.command()(run)

    return made


def show(made: Table | str) -> None:
    """Print a table, without its marks of Markdown, or a line."""
    if isinstance(made, Table):
        rows = [[plain(cell) for cell in row] for row in made.rows]
        made = replace(made, columns=[plain(name) for name in made.columns], rows=rows)
    console.print(made if isinstance(made, str) else made.terminal())


def verdict(failed: Sequence[str], well: str) -> Printed:
    """What must not be, which ends the program with 1; or that all is ``well``."""
    yield from failed
    if failed:
        raise SystemExit(1)
    yield well


def taken(made: BenchmarkTable, before: figures.PageTable) -> figures.PageTable:
    """A record with the cells of today, of the columns that it has; what has not changed keeps its emphasis.

    Raises:
        InputError: the table lacks a column of the record.
    """
    if lost := set(before.columns) - set(made.columns):
        raise InputError(f"{made.record}.json: the table has no column {min(lost)!r}; correct the record's columns")
    old = {(k, c, plain(cell)): cell for k, row in enumerate(before.rows) for c, cell in enumerate(row)}
    chosen = [c for c, name in enumerate(made.columns) if name in before.columns]
    cells = ([row[c] for c in chosen] for row in made.rows)
    rows = [[old.get((k, c, cell), cell) for c, cell in enumerate(row)] for k, row in enumerate(cells)]
    return replace(before, columns=[made.columns[c] for c in chosen], rows=rows)


def plain(cell: str) -> str:
    """A cell without marks of Markdown."""
    return re.sub(r"[`*]", "", cell)


def recall(metrics: Sequence[Metrics]) -> str:
    """The means of R@1, R@100P and AUC in percent, as one cell."""
    means = np.mean([Recall.of(one) for one in metrics], axis=0)
    return " / ".join(f"{100 * value:.1f}" for value in means)


def fraction(value: float) -> str:
    """A fraction with three decimals, as one cell."""
    return "1" if value == 1 else f"{value:.3f}".removeprefix("0")


K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


def turns(measures: Mapping[K, Callable[[], V]], rounds: int) -> dict[K, list[V]]:
    """What each measures in so many rounds, after one that compiles and does not count; every other goes backwards."""
    found: dict[K, list[V]] = {name: [] for name in measures}
    for turn in range(rounds + 1):
        for name in list(measures)[:: 1 if turn % 2 else -1]:
            value = measures[name]()
            if turn:
                found[name].append(value)
    return found


def elapsed(run: Callable[[], object], clock: Callable[[], float] = time.perf_counter) -> Callable[[], float]:
    """A measure of the seconds that a call takes, by a clock."""

    def seconds() -> float:
        started = clock()
        run()
        return clock() - started

    return seconds


RECALL = np.array((0.6, 0.15, 0.25))
"""What R@1, R@100P and AUC count in a score."""
MARGIN = 0.5
"""Points of score below which a difference is noise: a query in 200, twice the standard error over eight seeds."""


class Log:
    """Writes lines to the terminal and to a file, which it empties first."""

    def __init__(self, path: Path) -> None:
        self._path = path
        path.write_text("")

    def write(self, line: str) -> None:
        """Write a line."""
        click.echo(line)
        with self._path.open("a") as file:
            file.write(line + "\n")

    def chosen(self, trials: Iterable[Trial[Any]], told: Callable[[Any], str]) -> Settings:
        """The settings that a search ends at; ``told`` is what their result is in the log."""
        best: Settings = {}
        for trial in trials:
            self.write(f"  {trial.name:44s} {trial.error or told(trial.result)}{' *' if trial.kept else ''}")
            best = trial.settings if trial.kept else best
        return best


def recalls(values: Iterable[Iterable[float]]) -> str:
    """R@1/R@100P/AUC in percent of some places."""
    return "  ".join("/".join(f"{value:5.1f}" for value in row) for row in values)


ROOT = Path(__file__).resolve().parents[1]


def python_of(name: str) -> Path:
    """The Python of an environment that `make` sets up; it need not exist."""
    return ROOT / f".venv-{name}" / "bin" / "python"


def run_elsewhere(
    what: str, python: Path, goal: str, *words: str | Path, seconds: float = 1800, folder: Path | None = None
) -> Ended:
    """Run a script in another environment, which sees nothing of this one.

    Args:
        what: What is compared with, for messages.
        python: The Python of its environment.
        goal: The goal of `make` that sets it up.
        words: The script and its arguments.
        seconds: What it may take.
        folder: Where it runs.
    Raises:
        InputError: the environment is missing, or the script fails or takes too long.
    """
    environment = python.parent.parent.name
    if not python.exists():
        raise InputError(f"{what}: not installed in {environment}; run make {goal}")
    try:
        ended = run_child([python, *words], seconds=seconds, folder=folder, environment=environment_without_python())
    except subprocess.TimeoutExpired:
        raise InputError(f"{what}: not done after {seconds:g} s; ask for less") from None
    if ended.code:
        said = ended.last or f"exit status {ended.code}"
        raise InputError(f"{what}: {said}; delete {environment} and run make {goal}")
    return ended
