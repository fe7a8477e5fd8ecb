"""The evaluation report: one HTML file that needs nothing else, from plain arrays.

`write_report` turns `ReportData` into ``report.html``. Everything is drawn here and nothing is computed that
`matching.evaluation` has not computed already, so that the report and the JSON never disagree.
"""

from __future__ import annotations

from pathlib import Path

from lava_vpr.report.data import MapData, MatcherFigures, Raster, ReportData
from lava_vpr.report.html import page
from lava_vpr.show.page import write_page


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


__all__ = ["MapData", "MatcherFigures", "Raster", "ReportData", "write_page", "write_report"]
