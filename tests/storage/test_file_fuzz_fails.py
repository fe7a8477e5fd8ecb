"""The fuzzer can fail: readers that take what is unsound, that break, hang, swallow memory or die are told."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.fuzz.files import cases, pool, readers
from support.fuzz.files.corpus import Corpus
from support.fuzz.files.trial import CRASH, HANG, MEMORY, MESSAGE, SOUND, TRACEBACK, UNSOUND, wrong_with
from support.fuzz.soundness.rules import Findings

from lava_vpr.errors import InputError


def spin() -> None:
    """Use the processor for ever."""
    while True:
        pass


def swallow() -> None:
    """Ask for far more memory than a file of some bytes may cost."""
    bytearray(pool.MEMORY * 2)


def break_off() -> None:
    """What no reader may do."""
    raise KeyError("steps")


def complain() -> None:
    """A message that no user understands."""
    raise InputError("radius is nan")


BREAKS: dict[str, Callable[[], object]] = {
    HANG: spin,
    MEMORY: swallow,
    TRACEBACK: break_off,
    MESSAGE: complain,
    CRASH: os.abort,
}


def outcomes(folder: Path, numbers: range, seed: int = 0) -> dict[int, str]:
    """What the workers tell of cases, by number."""
    return {number: outcome.kind for number, outcome in pool.run(Corpus(folder), seed, numbers, workers=2)}


@pytest.fixture
def lists_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cases of lists alone: they need no honest models."""
    monkeypatch.setattr(cases, "SHARES", {"list": 1})
    monkeypatch.setattr("support.fuzz.files.trial.COMMANDS_AFTER_ACCEPTANCE", 0.0)


@pytest.mark.parametrize("kind", BREAKS)
@pytest.mark.usefixtures("lists_only")
def test_a_reader_that_fails_is_told_with_its_case_alone(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pool, "CPU_SECONDS", 1)

    def read(case: Any, corpus: Any, path: Any) -> Findings:
        if case.number == 5:
            BREAKS[kind]()
        return Findings()

    monkeypatch.setattr(readers, "read_list", read)
    told = outcomes(tmp_path, range(10))
    assert told == {number: kind if number == 5 else SOUND for number in range(10)}


@pytest.mark.usefixtures("lists_only")
def test_a_reader_that_waits_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pool, "STILL_SECONDS", 0.5)
    monkeypatch.setattr(readers, "read_list", lambda *_: time.sleep(1e6))
    assert outcomes(tmp_path, range(1)) == {0: HANG}


@pytest.mark.usefixtures("lists_only")
def test_what_the_checker_finds_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(readers, "read_list", lambda *_: Findings(["L1: other files"]))
    assert outcomes(tmp_path, range(1)) == {0: UNSOUND}


@pytest.mark.parametrize(
    "message",
    [
        "/a/b: is empty",
        "/a/b: is empty; train again\nand again",
        "/a/b: is \x1b[31mempty; train again",
        "/a/c: is empty; train again",
        f"/a/b: is {'empty' * 200}; train again",
        "/a/b: needs more than this machine has memory for; use another",
    ],
)
def test_a_message_is_one_short_printable_line_with_file_and_remedy(message: str) -> None:
    assert wrong_with(message, Path("/a/b"))
    assert not wrong_with("/a/b: is empty; train again", Path("/a/b"))
