"""The parts of docs/security.md that the code decides: limits, and what holds for accepted files (`make pages`)."""

from __future__ import annotations

import sys
from pathlib import Path

from lava_vpr.storage.limits import LIMITS, variable


def limits() -> str:
    """The table of all limits."""
    rows = [f"| `{variable(name)}` | {row.default:,} {row.unit} | {row.reason} |" for name, row in LIMITS.items()]
    return "\n".join(["| variable | default | why so much |", "|---|---|---|", *rows])


def rules() -> str:
    """The list of what holds for accepted files."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
    from support.fuzz.soundness.rules import INVARIANTS

    return "\n".join(f"- **{name}** {text}" for name, text in INVARIANTS.items())


PARTS = {"limits": limits, "rules": rules}


def names() -> list[str]:
    """All parts of pages that this module writes."""
    return list(PARTS)


def section(name: str) -> str:
    """A part of a page."""
    return PARTS[name]()
