"""The parts of docs/cli.md that the commands themselves decide; `make pages` writes them."""

from __future__ import annotations

import inspect
import re

import click

from lava_vpr.backends.rivals import BASELINES
from lava_vpr.cli import main
from lava_vpr.cli.show.matches import ALWAYS
from lava_vpr.config import DecoderConfig
from lava_vpr.matching.decoders import DECODERS

WIDTH = 100_000  # click breaks lines at the width of a terminal; here nothing is to be broken
CONTEXT = click.Context(main, info_name="lava-vpr", terminal_width=WIDTH, max_content_width=WIDTH)
EVAL_KEYS = """```
{{"places": n, "queries": n,
 "network": {{"neurons": n, "weight_bits": n or null, "steps": n}},
 "default_decoder": NAME,
 "decoders": {{{decoders}}},
 "baselines": {{{baselines}}},
 "adapted": {{NAME: M}},
 "position_error": {{"median_m": x, "p90_m": x, "within": x, "radius_m": x, "matched": n}} or null,
 "followed": {{"filtered": M, "forward_backward": M}},
 "probability": {{"single": P, "filtered": P}},
 "curves": {{"decoders": {{NAME: C}}, "baselines": {{NAME: C}}, "adapted": {{NAME: C}}, "followed": {{NAME: C}}}}}}

M = {{"recall_at_1": x, "recall_at_n": {{"5": x, "10": x}}, "recall_at_100_precision": x,
     "precision_at_100_recall": x, "auc": x}}
P = {{"expected_calibration_error": x, "off_map": x,
     "reliability": [{{"answers": n, "probability": x, "right": x}}, ...],
     "thresholds": [{{"target": x, "probability": x, "accepted": x, "precision": x, "kept": x,
                     "false_accepts": x}}, ...]}}
C = {{"recall": [x, ...], "precision": [x, ...], "threshold": [x or null, ...]}}
```"""


def cell(text: str) -> str:
    """Text for one cell of a table: on one line, its bars no separators, a range in brackets no link."""
    return re.sub(r"\[(?=[^\[\]]*(?:x[<>]|[<>]=?x))", r"\\[", " ".join(text.split()).replace("|", r"\|"))


def paragraphs(text: str) -> str:
    """A docstring as Markdown paragraphs."""
    return "\n\n".join(" ".join(part.split()) for part in inspect.cleandoc(text).split("\n\n"))


def described(name: str, command: click.Command, parent: click.Context) -> str:
    """The reference of one command."""
    # Commands are shown as in a window so wide that nothing is broken.
    ctx = click.Context(command, info_name=name, parent=parent, terminal_width=WIDTH, max_content_width=WIDTH)
    usage = " ".join(command.get_usage(ctx).removeprefix("Usage:").split())
    rows = []
    for param in command.params:  # without --help, which all have
        record = param.get_help_record(ctx)
        if record is not None and isinstance(param, click.Option):
            rows.append(f"| `{cell(record[0])}` | {cell(record[1])} |")
    table = "\n\n" + "\n".join(["| option | |", "|---|---|", *rows]) if rows else ""
    return f"## {name}\n\n```\n{usage}\n```\n\n{paragraphs(command.help or '')}{table}"


def commands() -> dict[str, click.Command]:
    """All commands by name."""
    return {name: command for name in main.list_commands(CONTEXT) if (command := main.get_command(CONTEXT, name))}


def usage() -> str:
    """What each command is for, in a line."""
    every = commands()
    width = max(map(len, every))
    lines = (f"lava-vpr {name:<{width}}  {command.get_short_help_str(WIDTH)}" for name, command in every.items())
    return "\n".join(["```", *lines, "```"])


def eval_keys() -> str:
    """The keys of `eval --json`."""
    decoders = sorted(DECODERS, key=lambda name: name == DecoderConfig().default)  # the paper's first, as in the file
    matchers = {"decoders": decoders, "baselines": (*BASELINES, "descriptors")}
    return EVAL_KEYS.format(**{kind: ", ".join(f'"{name}": M' for name in known) for kind, known in matchers.items()})


PARTS = {
    "usage": usage,
    "commands": lambda: "\n\n".join(described(*row, CONTEXT) for row in commands().items()),
    "eval-keys": eval_keys,
    "columns": lambda: f"```\n{','.join(column.name for column in ALWAYS)}\n```",
}
