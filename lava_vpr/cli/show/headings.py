"""Headings of the options of long commands, in their help and in docs/cli.md."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any

import click

LEARNED = "Learning"
CHANGED = "Weights and inputs"
OUTPUT = "Output"
IMAGES = "Images"
POSITIONS = "Positions and times"
TRUTH = "Ground truth"
MEASURED = "Measurements"
COMPARED = "Comparisons"
PRESENTED = "Presentation of queries"
TOGETHER = "Motion and sequences"
ACCEPTED = "Acceptance of matches"
SEASON = "Season"
RUNNING = "Execution"

OPTIONS = "Options"
"""The single heading of a command with few options; click uses the same."""

MANY = 15
"""Minimum number of options that a command's help groups below headings."""


def several(*options: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Give a command ``options``, the first of them first in its help."""
    return lambda command: reduce(lambda optional, option: option(optional), reversed(options), command)


def under(heading: str, *options: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Give a command ``options``, below ``heading`` in its help, unless they have one."""

    def given(command: Any) -> Any:
        before = len(getattr(command, "__click_params__", ()))
        optional = several(*options)(command)
        for param in optional.__click_params__[before:]:
            vars(param).setdefault("heading", heading)
        return optional

    return given


def help_records(command: click.Command, ctx: click.Context) -> dict[str, list[tuple[str, str]]]:
    """The options of ``command`` by heading, each as it is written and what it does; what has none runs it."""
    options = [param for param in command.get_params(ctx) if isinstance(param, click.Option)]
    long = isinstance(command, Headed) and len(options) >= MANY
    headed: dict[str, list[tuple[str, str]]] = {}
    for param in options:
        heading = vars(param).get("heading", RUNNING) if long else OPTIONS
        if (record := param.get_help_record(ctx)) is not None:
            headed.setdefault(heading, []).append(record)
    return {**{name: rows for name, rows in headed.items() if name != RUNNING}, **headed}


class Headed(click.Command):
    """A command whose options stand below headings in its help, if they are many."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for heading, records in help_records(self, ctx).items():
            with formatter.section(heading):
                formatter.write_dl(records)
