"""Words that are safe to put in a page."""

from __future__ import annotations

from html import escape as escape_html


def plain(text: str) -> str:
    """``text`` without what UTF-8 cannot hold (bytes of file names that are no text)."""
    return text.encode("utf-8", "replace").decode("utf-8")


def safe(text: str) -> str:
    """``text`` for use in HTML, in elements and in attributes."""
    return escape_html(plain(text))
