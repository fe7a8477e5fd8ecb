"""Pages as files."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lava_vpr.errors import InputError
from lava_vpr.show.page import write_page


def test_an_interrupted_report_leaves_no_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", stopped)
    with pytest.raises(KeyboardInterrupt):
        write_page("new", tmp_path / "deep" / "deeper" / "report.html")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_looked_for_is_an_error_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"report.html: the report cannot be written \(File name too long\); give a"):
        write_page("new", tmp_path / ("a" * 300) / "report.html")
