"""What mkdocs does beyond its settings: pages whose text stands outside docs/, and links that lead there.

`make site` calls it. CHANGELOG.md, CONTRIBUTING.md and examples/README.md become pages as they are; a link to another
file of the project becomes its path as code, for the site holds no sources.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
TAKEN = {"changelog.md": "CHANGELOG.md", "contributing.md": "CONTRIBUTING.md", "examples.md": "examples/README.md"}
"""Pages of the site, and the files of the project that they are."""
STANDS_FOR = {"README.md": "index.md", **{file: page for page, file in TAKEN.items()}}
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\((?!https?:|#|mailto:)([^)#\s]*)(#[^)\s]*)?\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the pages whose text stands outside docs/."""
    for page, source in TAKEN.items():
        files.append(File.generated(config, page, content=(ROOT / source).read_text(encoding="utf-8")))
    return files


def resolved(text: str, source: str) -> str:
    """The Markdown ``text`` of the project's file ``source`` with links as the site has them."""
    folder = posixpath.dirname(source)
    page_folder = posixpath.dirname(STANDS_FOR.get(source, posixpath.relpath(source, "docs")))

    def one(match: re.Match[str]) -> str:
        bang, words, target, anchor = match.group(1), match.group(2), match.group(3), match.group(4) or ""
        file = posixpath.normpath(posixpath.join(folder, target))
        if file in STANDS_FOR:
            place = STANDS_FOR[file]
        elif file.startswith("docs/"):
            place = posixpath.relpath(file, "docs")
        else:
            return f"{words} (`{file}`)" if words.strip("`") != file else f"`{file}`"
        return f"{bang}[{words}]({posixpath.relpath(place, page_folder or '.')}{anchor})"

    return _LINK.sub(one, text)


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """A page's text with its links as the site has them; what stands in code blocks stays."""
    source = TAKEN.get(page.file.src_uri, f"docs/{page.file.src_uri}")
    parts = re.split(r"(^```.*?^```$)", markdown, flags=re.DOTALL | re.MULTILINE)
    return "".join(part if part.startswith("```") else resolved(part, source) for part in parts)


def on_post_page(output: str, page: Any, config: Any) -> str:
    """A notebook's page, whose links to pages and notebooks lead to those of the site."""
    if not page.file.src_uri.endswith(".ipynb"):
        return output
    return re.sub(r'(<a href="[^":]*)\.(?:md|ipynb)((?:#[^"]*)?")', r"\1.html\2", output)
