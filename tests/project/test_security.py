"""docs/security.md, whose tables `make pages` writes from the code, is found from README."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_page_is_found() -> None:
    assert "docs/security.md" in (ROOT / "README.md").read_text(encoding="utf-8")
