"""Templates are filled in completely, or not at all."""

from __future__ import annotations

from typing import Any

import pytest

from lava_vpr.show import templates


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
