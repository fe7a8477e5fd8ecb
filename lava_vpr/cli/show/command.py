"""How to repeat a command."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from lava_vpr.cli.common import Numbers, Values

SILENT = ("json_path", "csv_path", "report_folder", "jobs", "address", "keep")
"""Parameters that a report does not repeat: they change nothing of what it says."""


def command_line(ctx: click.Context) -> str:
    """How to repeat this command, file names without their folders (reports carry no paths)."""
    words = ["lava-vpr", ctx.info_name or ""]
    for param in ctx.command.params:
        value = ctx.params.get(param.name or "")
        if value is None or value == () or value == param.default or param.name in SILENT:
            continue
        values = value if isinstance(value, tuple) else (value,)
        if param.name == "places":
            values = (f"{values[0]}:{values[1]}",)
        if isinstance(param.type, (Numbers, Values)):
            values = (",".join(f"{number:g}" for number in values),)
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
