"""What a command computed, as files, a page and tables; and how to repeat it."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import click

from lava_vpr.cli.common import Parsed, console, print_whole, stage
from lava_vpr.cli.outputs import write_json, write_text
from lava_vpr.errors import shown
from lava_vpr.show.page import write_page
from lava_vpr.show.table import Table

Files = Mapping[Path | None, str | dict[str, Any]]
"""Text, or JSON values, by the file to write; those of None are not wanted."""


def show_results(
    said: Iterable[Table | str], files: Files, page: Path | None = None, page_of: Callable[[], str] = str
) -> list[Table]:
    """Write the files, then print what is said, since whoever reads it may go away; the tables of it.

    Args:
        said: Tables and lines, for the terminal.
        files: What is written beside.
        page: Where the page goes; None: nowhere.
        page_of: The HTML of the page.
    """
    for path, content in files.items():
        if path is not None:
            write_text(path, content) if isinstance(content, str) else write_json(path, content)
    if page is not None:
        with stage("writing the report"):
            write_page(page_of(), page)
    items = list(said)
    for item in items:
        print_whole(item)
    if page is not None:
        console.print(f"report: {shown(page)}")
    return [item for item in items if isinstance(item, Table)]


SILENT = ("json_path", "csv_path", "report_folder", "jobs", "address", "keep")
"""Parameters that a report does not repeat: they change nothing of what it says."""


def command_line(ctx: click.Context) -> str:
    """How to repeat this command, file names without their folders (reports carry no paths)."""
    words = ["lava-vpr", ctx.info_name or ""]
    for param in ctx.command.params:
        value = ctx.params.get(param.name or "")
        if value is None or value == () or value == param.default or param.name in SILENT:
            continue
        if isinstance(param.type, Parsed):
            value = tuple(map(param.type.written, value)) if param.multiple else param.type.written(value)
        values = value if isinstance(value, tuple) else (value,)
        sources = ("query", "references", "stamps")
        shown = [Path(v).name if isinstance(v, Path) or param.name in sources else str(v) for v in values]
        if isinstance(param, click.Argument):
            words += shown
        elif isinstance(param, click.Option) and param.is_flag:
            words += [param.opts[-1]] if value else []
        elif param.multiple:
            words += [word for text in shown for word in (param.opts[-1], text)]
        else:
            words += [param.opts[-1], *shown]
    return shlex.join(words)
