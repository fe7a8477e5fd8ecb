"""The pages' templates: HTML with fields to be filled in, style sheets and scripts, one file each in this folder.

A field stands in a template as ``$name``; a ``$`` that is none is written ``$$``. Whoever fills a template makes the
values safe for HTML (`safe`). The newline at the end of a file is not part of the template.
"""

from __future__ import annotations

from functools import cache
from html import escape as escape_html
from importlib.resources import files
from string import Template


def render(name: str, /, **fields: str) -> str:
    """The template in the file ``name`` with ``fields`` filled in.

    Raises:
        TypeError: the fields are not exactly those of the template.
    """
    template = Template(text(name))
    matches = template.pattern.finditer(template.template)
    names = {match["named"] or match["braced"] for match in matches if match["escaped"] is None}
    if names != fields.keys():
        raise TypeError(f"{name}: has the fields {sorted(names)}, but was given {sorted(fields)}")
    return template.substitute(fields)


@cache
def text(name: str) -> str:
    """The file ``name`` as it is, without the newline at its end: a style sheet, a script, a template."""
    content = files(__name__).joinpath(name).read_text(encoding="utf-8")
    return content.removesuffix("\n")


def plain(text: str) -> str:
    """``text`` without what UTF-8 cannot hold (bytes of file names that are no text)."""
    return text.encode("utf-8", "replace").decode("utf-8")


def safe(text: str) -> str:
    """``text`` for use in HTML, in elements and in attributes."""
    return escape_html(plain(text))
