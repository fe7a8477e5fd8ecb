"""Text from files and file names, made fit for one line of a message or a terminal."""

from __future__ import annotations

import os
from pathlib import Path

_LONGEST = 400


def shown(path: str | Path) -> str:
    """``path`` for a one-line message: characters that would break the line or the terminal are escaped.

    Of a path of more than `_LONGEST` characters the middle is left out.
    """
    text = str(path)
    if len(text) > _LONGEST:
        text = f"{text[: _LONGEST // 3]}...{text[-_LONGEST // 2 :]}"
    return text if text.isprintable() else repr(text)


def harmless(text: str) -> str:
    """``text`` with every character that no terminal should be sent (controls, escapes, surrogates) as its escape.

    Line ends and tabs stay.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in text)


def printable(path: str) -> str:
    """The name of a file without its folder; bytes that are no text are replaced, since no JSON, CSV or terminal takes
    the surrogates that stand for them."""
    return os.fsencode(os.path.basename(path)).decode("utf-8", "replace")
