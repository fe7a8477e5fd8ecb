"""The tables of docs/hardware.md, from the rows in deploy/hardware; `make pages` writes them."""

from __future__ import annotations

from lava_vpr.deploy.hardware.belief import HardwareBelief
from lava_vpr.deploy.hardware.table import BELIEFS, SECTIONS


def cell(text: str) -> str:
    """A text as a cell of a table has it."""
    return text.replace("|", "\\|").replace("*", "\\*").replace("\\*\\*", "**").replace("<", "&lt;")


def line(row: HardwareBelief) -> str:
    """The line of one row."""
    cells = (row.name, row.on, row.shown, row.unit or "", row.evidence, row.breaks)
    return f"| {' | '.join(map(cell, cells))} |"


def beliefs() -> str:
    """How many rows there are, and the tables of all sections."""
    proven = sum(row.proven for row in BELIEFS.values())
    text = [f"{len(BELIEFS)} rows: {proven} with a public source, {len(BELIEFS) - proven} unproven."]
    for title, rows in SECTIONS.items():
        head = "| register, limit or call | of | value | unit | source | what breaks if it is wrong |"
        text.append("\n".join([f"## {title}\n", head, "|---|---|---|---|---|---|", *map(line, rows)]))
    return "\n\n".join(text)


PARTS = {"beliefs": beliefs}
