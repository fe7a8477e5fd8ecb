"""The evaluation report: one HTML file that needs nothing else, from plain arrays.

`write_report` turns `ReportData` into ``report.html``. Everything is drawn here and nothing is computed that
`matching.evaluation` has not computed already, so that the report and the JSON never disagree.
"""

from __future__ import annotations

from pathlib import Path

from lava_vpr.errors import InputError
from lava_vpr.report.data import Figures, MapData, Raster, ReportData
from lava_vpr.report.html import page
from lava_vpr.storage.text import shown
from lava_vpr.storage.writing import write_atomically


def write_report(data: ReportData, folder: Path) -> Path:
    """Write ``folder/report.html``, complete or not at all; equal data give equal bytes.

    Args:
        data: What to show.
        folder: Created if it is missing; an older report in it is replaced when the new one is complete.
    Returns:
        The file.
    Raises:
        InputError: the folder cannot be made or written.
    """
    return write_page(page(data), folder / "report.html")


def write_page(text: str, target: Path) -> Path:
    """Write a page, complete or not at all, and its folder if it is missing.

    Raises:
        InputError: the folder cannot be made or written.
    """
    content = text.encode("utf-8", "replace")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(target, lambda file: file.write(content))
    except OSError as error:
        raise InputError(
            f"{shown(target)}: the report cannot be written ({error.strerror or error}); "
            "give a folder that can be written and has space left"
        ) from None
    return target


__all__ = ["Figures", "MapData", "Raster", "ReportData", "write_page", "write_report"]
