"""What a command computed, as files, a page and tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from lava_vpr.cli.common import console, print_whole, stage
from lava_vpr.cli.outputs import write_json, write_text
from lava_vpr.show.page import write_page
from lava_vpr.show.table import Table
from lava_vpr.storage.text import shown

Files = Mapping[Path | None, str | dict[str, Any]]
"""Text, or JSON values, by the file to write; those of None are not wanted."""


def show_results(
    tables: Iterable[Table],
    files: Files,
    page: Path | None,
    page_of: Callable[[], str],
    notes: Iterable[str] = (),
) -> None:
    """Write the files, then print the tables: whoever reads them may go away.

    Args:
        tables: The tables, for the terminal.
        files: What is written beside.
        page: Where the page goes; None: nowhere.
        page_of: The HTML of the page.
        notes: Lines below the tables.
    """
    for path, content in files.items():
        if path is not None:
            write_text(path, content) if isinstance(content, str) else write_json(path, content)
    if page is not None:
        with stage("writing the report"):
            write_page(page_of(), page)
    for table in tables:
        print_whole(table)
    for note in notes:
        console.print(note)
    if page is not None:
        console.print(f"report: {shown(page)}")
