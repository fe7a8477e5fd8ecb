"""Write the tables of docs/security.md that the code decides: limits, and what holds for accepted files.

python scripts/security_reference.py            write them
python scripts/security_reference.py --check    say whether they are up to date, as an exit code
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from support.fuzz.soundness.rules import INVARIANTS  # noqa: E402

from lava_vpr.storage.limits import LIMITS, variable  # noqa: E402

TARGET = ROOT / "docs" / "security.md"


def limits() -> str:
    """The table of all limits."""
    rows = [f"| `{variable(name)}` | {row.default:,} {row.unit} | {row.reason} |" for name, row in LIMITS.items()]
    return "\n".join(["| variable | default | why so much |", "|---|---|---|", *rows])


def rules() -> str:
    """The list of what holds for accepted files."""
    return "\n".join(f"- **{name}** {text}" for name, text in INVARIANTS.items())


def filled(page: str) -> str:
    """The page with its tables as the code decides them."""
    for name, table in (("limits", limits()), ("rules", rules())):
        begin, end = f"<!-- {name}: written by scripts/security_reference.py -->\n", f"<!-- end of {name} -->"
        head, found, rest = page.partition(begin)
        _, ended, tail = rest.partition(end)
        if not found or not ended:
            raise SystemExit(f"{TARGET}: lacks the marks of its {name}; put them back")
        page = f"{head}{begin}\n{table}\n\n{end}{tail}"
    return page


def main() -> None:
    """Write or check."""
    page = TARGET.read_text(encoding="utf-8")
    if "--check" in sys.argv[1:]:
        sys.exit(page != filled(page))
    TARGET.write_text(filled(page), encoding="utf-8")


if __name__ == "__main__":
    main()
