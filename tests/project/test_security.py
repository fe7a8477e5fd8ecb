"""docs/security.md says what the code does: its limits, and the rules that accepted files are held against."""

from __future__ import annotations

import re
from pathlib import Path

from support.fuzz.soundness.rules import INVARIANTS

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "security.md"
CHECKER = ROOT / "tests" / "support" / "fuzz" / "soundness"


def test_every_rule_that_is_listed_is_checked_and_the_other_way_round() -> None:
    code = "".join(path.read_text(encoding="utf-8") for path in CHECKER.glob("*.py") if path.name != "rules.py")
    checked = set(re.findall(r'"([FTMCBL][0-9]+)"', code))
    listed = set(re.findall(r"^- \*\*([A-Z][0-9]+)\*\* ", PAGE.read_text(encoding="utf-8"), re.MULTILINE))
    by_way_of_others = {"M1"}  # the rules T, asked of a model's settings
    assert checked | by_way_of_others == listed == set(INVARIANTS)


def test_rules_are_numbered_without_gaps() -> None:
    for letter in sorted({name[0] for name in INVARIANTS}):
        numbers = [int(name[1:]) for name in INVARIANTS if name[0] == letter]
        assert numbers == list(range(1, len(numbers) + 1))


def test_the_page_is_found() -> None:
    assert "docs/security.md" in (ROOT / "README.md").read_text(encoding="utf-8")
