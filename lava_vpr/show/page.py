"""The frame of every page, and its sections: one HTML file that asks the network for nothing, and may not.

A live page asks its server.
"""

from __future__ import annotations

import base64
import hashlib
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from lava_vpr import __version__
from lava_vpr.errors import InputError, shown
from lava_vpr.show.table import Table, in_html
from lava_vpr.show.templates import render, safe, text
from lava_vpr.storage.writing import write_atomically

ALONE = "One file, no network needed."


class Section(NamedTuple):
    """A section of a page.

    Attributes:
        name: Its anchor.
        link: What links to it are called.
        parts: Its tables, and all else as HTML, in order; without any, the page has no such section.
        heading: Its heading, as plain text; without one, the parts are a whole section.
        note: The text below the heading.
    """

    name: str
    link: str
    parts: Sequence[str | Table]
    heading: str = ""
    note: str = ""

    def html(self) -> str:
        """The section as HTML; empty without content."""
        content = "".join(part if isinstance(part, str) else part.html() for part in self.parts)
        if not content or not self.heading:
            return content
        note = f'<p class="note">{in_html(self.note)}</p>' if self.note else ""
        return render("section.html", name=self.name, heading=in_html(self.heading), note=note, content=content)


def sheet(
    title: str, header: str, sections: Iterable[Section], *, style: str = "", payload: str = "", script: str = ""
) -> str:
    """A whole page that is made of sections, as HTML text.

    Args:
        title, payload, script: As in `document`.
        header: The head of the page, as HTML.
        sections: Its sections in order; those without content are left out, and links lead to the others.
        style: What the page adds to the common style sheet; empty: the style of tables and drawings (`sheet.css`).
    """
    made = [(section, section.html()) for section in sections]
    links = "".join(f'<li><a href="#{section.name}">{section.link}</a></li>' for section, html in made if html)
    body = render("body.html", header=header, links=links, sections="".join(html for _, html in made))
    style = style or f"\n{text('sheet.css')}\n"
    return document(title, body, style=style, payload=payload, script=script)


def drawn(heading: str, drawing: str) -> str:
    """A drawing below its heading, in a panel."""
    return render("figure.html", heading=in_html(heading), drawing=drawing)


def terms(pairs: Iterable[tuple[str, str]]) -> str:
    """Terms, as plain text, and what is said of each, as HTML."""
    return "".join(f"<div><dt>{in_html(term)}</dt><dd>{said}</dd></div>" for term, said in pairs)


def reproduction(command: str, note: str = "") -> Section:
    """The section with the command that repeats a page."""
    panel = f'<div class="panel"><h3>Command</h3><pre class="command"><code>{safe(command)}</code></pre></div>'
    return Section("setup", "Reproduction", [panel], "Reproduction", note)


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
    missing = [folder for folder in target.parents if not os.path.exists(folder)]
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(target, lambda file: file.write(content))
    except BaseException as error:  # an interruption, too, leaves no empty folder
        for folder in missing:
            with suppress(OSError):
                folder.rmdir()
        if not isinstance(error, OSError):
            raise
        raise InputError(
            f"{shown(target)}: the report cannot be written ({error.strerror or error}); "
            "give a folder that can be written and has space left"
        ) from None
    return target
