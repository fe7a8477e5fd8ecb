"""What the searches for settings share: how recall counts, and a log with a line for every setting that was tried."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import click
import numpy as np

from lava_vpr.experiments.search import Settings, Trial

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
