"""Write the parts of README and docs that records and code decide, and wrap long lines of prose (`scripts.wrapping`); a
test sees that they are up to date.

    python -m scripts.pages [--check]       --check says as an exit code whether they are, and names the pages

A part, one of `scripts.parts.PARTS`, stands between `<!-- KIND/NAME: written by make pages -->` and
`<!-- end of KIND/NAME -->`.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from lava_vpr.errors import InputError
from lava_vpr.storage.writing import write_atomically
from scripts.parts import PARTS
from scripts.wrapping import wrapped

ROOT = Path(__file__).resolve().parents[1]
PART = re.compile(r"(<!-- (\w+)/([\w-]+): written by make pages -->\n)(.*?)(<!-- end of (\w+/[\w-]+) -->)", re.DOTALL)


def pages() -> list[Path]:
    """README, the pages of docs, and other pages for people."""
    others = [ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "examples/README.md")]
    return [*others, *sorted((ROOT / "docs").glob("*.md"))]


def filled(page: str, path: Path) -> str:
    """The text ``page`` of the file ``path`` with every part as records and code have it.

    Raises:
        InputError: a part has no such kind or name, or ends with the mark of another.
    """

    def part(found: re.Match[str]) -> str:
        begin, kind, name, _, end, ended = found.groups()
        if ended != f"{kind}/{name}":
            raise InputError(f"{path}: {kind}/{name} ends with the mark of {ended}; put back its own")
        made = PARTS.get(f"{kind}/{name}")
        if made is None:
            raise InputError(f"{path}: there is no part {kind}/{name}; there are {', '.join(PARTS)}")
        return f"{begin}\n{made()}\n\n{end}"

    return PART.sub(part, page)


def absent(texts: dict[Path, str]) -> list[str]:
    """Parts that stand on no page."""
    there = {f"{kind}/{name}" for text in texts.values() for _, kind, name, *_ in PART.findall(text)}
    return sorted(PARTS.keys() - there)


def bring_up_to_date(check: bool = False) -> list[Path]:
    """Write all pages that are out of date, or only find them.

    Raises:
        InputError: see `filled`; or a part stands on no page.
    """
    texts = {path: path.read_text(encoding="utf-8") for path in pages()}
    if lost := absent(texts):
        raise InputError(f"no page has the marks of {', '.join(lost)}; put them back, or remove what is not shown")
    changed = {path: new for path, text in texts.items() if (new := wrapped(filled(text, path))) != text}
    for path, new in () if check else changed.items():
        write_atomically(path, lambda out, new=new: out.write(new.encode()))  # type: ignore[misc]
    return sorted(changed)


def main() -> None:
    """Write or check."""
    check = "--check" in sys.argv[1:]
    try:
        changed = bring_up_to_date(check)
    except InputError as error:
        raise SystemExit(str(error)) from None
    for path in changed:
        print(f"{path.relative_to(ROOT)}: {'out of date; run make pages' if check else 'written'}")
    sys.exit(check and bool(changed))


if __name__ == "__main__":
    main()
