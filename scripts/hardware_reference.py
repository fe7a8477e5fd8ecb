"""Write the tables of docs/hardware.md from the rows in deploy/hardware.

python scripts/hardware_reference.py            write them
python scripts/hardware_reference.py --check    say whether they are up to date, as an exit code
"""

from __future__ import annotations

import sys
from pathlib import Path

from lava_vpr.deploy.hardware.belief import Belief
from lava_vpr.deploy.hardware.table import BELIEFS, SECTIONS

TARGET = Path(__file__).resolve().parent.parent / "docs" / "hardware.md"
BEGIN = "<!-- tables: written by scripts/hardware_reference.py -->\n"
END = "<!-- end of tables -->"


def cell(text: str) -> str:
    """A text as a cell of a table has it."""
    return text.replace("|", "\\|").replace("*", "\\*").replace("\\*\\*", "**").replace("<", "&lt;")


def line(row: Belief) -> str:
    """The line of one row."""
    cells = (row.name, row.on, row.shown, row.unit or "", row.evidence, row.breaks)
    return f"| {' | '.join(map(cell, cells))} |"


def tables() -> str:
    """How many rows there are, and the tables of all sections."""
    proven = sum(row.proven for row in BELIEFS.values())
    text = [f"{len(BELIEFS)} rows: {proven} with a public source, {len(BELIEFS) - proven} unproven.\n"]
    for title, rows in SECTIONS.items():
        text += [
            f"## {title}\n",
            "| register, limit or call | of | value | unit | source | what breaks if it is wrong |",
        ]
        text += ["|---|---|---|---|---|---|", *map(line, rows), ""]
    return "\n".join(text)


def filled(page: str) -> str:
    """The page with the tables as the code has them."""
    head, found, rest = page.partition(BEGIN)
    _, ended, tail = rest.partition(END)
    if not found or not ended:
        raise SystemExit(f"{TARGET}: lacks the marks of its tables; put them back")
    return f"{head}{BEGIN}\n{tables()}\n{END}{tail}"


def main() -> None:
    """Write or check."""
    page = TARGET.read_text(encoding="utf-8")
    if "--check" in sys.argv[1:]:
        sys.exit(page != filled(page))
    TARGET.write_text(filled(page), encoding="utf-8")


if __name__ == "__main__":
    main()
