"""The frame of every page: one HTML file that asks the network for nothing, and may not; a live one asks its server."""

from __future__ import annotations

import base64
import hashlib
from pathlib import Path

from lava_vpr import __version__
from lava_vpr.errors import InputError
from lava_vpr.show.templates import render, safe, text
from lava_vpr.storage.text import shown
from lava_vpr.storage.writing import write_atomically

ALONE = "One file, no network needed."


def document(
    title: str,
    body: str,
    *,
    style: str = "",
    payload: str = "",
    script: str = "",
    asks: bool = False,
    footer: str = ALONE,
) -> str:
    """A whole page as HTML text.

    Args:
        title: The title of the window, as plain text.
        body: Header, navigation and main part, as HTML.
        style: What the page adds to the common style sheet.
        payload: JSON for the script, that cannot end its own element; without a script, none.
        script: The only one that the page's policy lets run; "" for none at all.
        asks: Let the script ask whoever serves the page.
        footer: The last words, as plain text.
    """
    allowed, scripts = "", ""
    if script:
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        allowed = f"; script-src 'sha256-{digest}'"
        scripts = f'<script type="application/json" id="report-data">{payload}</script>\n<script>{script}</script>'
    if asks:
        allowed += "; connect-src 'self'"
    page = render(
        "page.html",
        policy=f"default-src 'none'; img-src data:; style-src 'unsafe-inline'{allowed}",
        title=safe(title),
        style=text("page.css"),
        more_style=style,
        body=body,
        version=__version__,
        footer=safe(footer),
        scripts=scripts,
    )
    return page + "\n"


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
