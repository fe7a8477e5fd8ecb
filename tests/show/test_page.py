"""Pages as files; their templates are filled in completely, or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from lava_vpr.errors import InputError
from lava_vpr.show import templates
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


@pytest.fixture
def greeting(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(templates, "text", {"greeting.html": "<p>$word, ${name}s, for 5 $$</p>"}.__getitem__)
    return "greeting.html"


def test_fields_are_filled_in(greeting: str) -> None:
    assert templates.render(greeting, word="Hello", name="$place") == "<p>Hello, $places, for 5 $</p>"


@pytest.mark.parametrize("fields", [{"word": "Hello"}, {"word": "Hello", "name": "place", "names": "places"}, {}])
def test_fields_that_are_not_the_template_s_are_refused(greeting: str, fields: dict[str, Any]) -> None:
    with pytest.raises(TypeError, match=r"greeting\.html: has the fields \['name', 'word'\], but was given"):
        templates.render(greeting, **fields)


def test_the_newline_at_the_end_of_a_file_is_not_part_of_it() -> None:
    assert templates.text("report.js").endswith("})();")
    assert templates.text("page.css").startswith(":root{")
