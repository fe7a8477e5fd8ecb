"""What commands and calls give is what the record says, byte for byte; and a difference is told by its case.

Each runs ``scripts/golden.py`` in a process of its own, since copies of this one would have its threads by half.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
from golden.comparing import differing
from golden.record import RULES, read, record_of
from golden.table import MADE, cases
from support.common import children

ROOT = Path(__file__).resolve().parents[2]
QUICK = ("help/e*", "usage/eval*", "asking/query-top", "boards/fit-kb-bits", "mistakes/bundle-[cm]*", "calls/load-m*")
"""Cases of every kind that take a few seconds together."""


def compare(*words: str) -> None:
    """``scripts/golden.py compare`` finds no difference."""
    command = [sys.executable, "scripts/golden.py", "compare", *words]
    done = children.run(command, cwd=ROOT, capture_output=True, text=True, timeout=1500)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_record_has_every_case_and_each_was_made() -> None:
    keys = [case.key for case in cases()]
    assert len(set(keys)) == len(keys) > 700
    record = read()
    assert record.keys() == set(keys)
    assert {case.key: case.command for case in cases()} == {key: entry["command"] for key, entry in record.items()}
    assert {key for key, entry in record.items() if key.startswith(f"{MADE}/") and entry["code"] != 0} == set()
    assert all(rule.why for rule in RULES)


@pytest.mark.lava
def test_some_cases_give_what_the_record_says() -> None:
    compare(*(word for pattern in QUICK for word in ("--only", pattern)))


@pytest.mark.slow
@pytest.mark.lava
def test_processes_that_start_anew_give_the_same() -> None:
    compare("--apart", "--only", "asking/query-t*", "--only", "mistakes/model-*", "--only", "usage/d*")


@pytest.mark.slow
@pytest.mark.lava
@pytest.mark.timeout(1800)
def test_all_cases_give_what_the_record_says() -> None:
    compare()


def told_of(first: Path, second: Path) -> list[str]:
    """What differs between two captures."""
    return list(differing(record_of(first), record_of(second), (first, second)))


def test_every_difference_is_told_by_its_case(tmp_path: Path) -> None:
    for name in ("first", "second"):
        folder = tmp_path / name / "asking" / "one"
        (folder / "files").mkdir(parents=True)
        (folder / "case.json").write_text(json.dumps({"command": "eval m.lvpr query", "code": 0}))
        (folder / "stdout").write_text("learned in 3.2 s\n" if name == "first" else "learned in 4.9 s\n")
        (folder / "stderr").write_text("")
        (folder / "files" / "f.json").write_text('{"recall": {"1": 0.5}, "places": 3}')
        (folder / "files" / "m.lvpr").write_bytes(b"\xff\x00\x01")
    first, second = tmp_path / "first", tmp_path / "second"
    assert told_of(first, second) == []
    files = second / "asking" / "one" / "files"
    (files / "f.json").write_text('{"recall": {"1": 0.25}, "places": 3}')
    (files / "m.lvpr").write_bytes(b"\xff\x01\x01")
    (files.parent / "stderr").write_text("note: other\n")
    told = told_of(first, second)
    assert told == [
        "asking/one: eval m.lvpr query",
        *("  stderr", "    +note: other"),
        *("  f.json", "    recall.1: 0.5 -> 0.25"),
        *("  m.lvpr", "    differs from byte 1 on; 3 -> 3 bytes"),
    ]
    told = list(differing(record_of(first), record_of(second)))
    assert told[0] == "asking/one: eval m.lvpr query"
    assert "    +note: other" in told
    shutil.rmtree(second / "asking")
    assert told_of(first, second) == ["asking/one: is not there any more"]


def test_no_recorded_table_is_wider_than_a_terminal() -> None:
    outputs = [parts["stdout"] for parts in read().values() if "stdout" in parts]
    lines = [line for output in outputs if isinstance(output, list) for line in output if line[:1] in tuple("┏┃┡│├└")]
    assert len(lines) > 2000
    assert [line for line in lines if len(line) > 80] == []
