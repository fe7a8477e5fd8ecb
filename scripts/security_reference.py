"""The parts of docs/security.md that the code decides: limits, and what holds for accepted files (`make pages`)."""

from __future__ import annotations

import sys
from pathlib import Path

from lava_vpr.configfile import sections
from lava_vpr.settings.ranges import declared
from lava_vpr.storage.limits import LIMITS, variable


def limits() -> str:
    """The table of all limits."""
    rows = [f"| `{variable(name)}` | {row.default:,} {row.unit} | {row.reason} |" for name, row in LIMITS.items()]
    return "\n".join(["| variable | default | why so much |", "|---|---|---|", *rows])


def settings() -> str:
    """The table of the ranges of all settings."""
    rows = ["| section | settings and their ranges |", "|---|---|"]
    for section, name in sections().items():
        ranges = [f"`{key}` {setting}".replace(" in ", " ") for key, setting in declared(section).items()]
        rows.append(f"| {f'`[{name}]`' if name else ''} `{section.__name__}` | {', '.join(ranges)} |")
    return "\n".join(rows)


def rules() -> str:
    """The list of what holds for accepted files."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
    from support.fuzz.soundness.rules import INVARIANTS

    return "\n".join(f"- **{name}** {text}" for name, text in INVARIANTS.items())


PARTS = {"limits": limits, "settings": settings, "rules": rules}


def names() -> list[str]:
    """All parts of pages that this module writes."""
    return list(PARTS)


def section(name: str) -> str:
    """A part of a page."""
    return PARTS[name]()
