"""One case tried as the program would: written, read by the public readers, judged, and given to commands.

Used by storage and support.
"""

from __future__ import annotations

import os
import shutil
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from click.testing import CliRunner
from support.fuzz.files import readers
from support.fuzz.files.bundles import RAW_MARK
from support.fuzz.files.cases import Case
from support.fuzz.files.corpus import Corpus
from support.fuzz.files.lists import IMAGE_LISTS
from support.fuzz.soundness.rules import Findings

from lava_vpr.cli import main
from lava_vpr.errors import LavaVprError

REFUSED, SOUND = "refused", "taken and sound"
UNSOUND, TRACEBACK, MESSAGE = "TAKEN AND UNSOUND", "TRACEBACK", "BAD MESSAGE"
HANG, MEMORY, CRASH = "HANG", "MEMORY", "CRASH"
FAILURES = (UNSOUND, TRACEBACK, MESSAGE, HANG, MEMORY, CRASH)
LONGEST_MESSAGE = 500
COMMANDS_AFTER_REFUSAL, COMMANDS_AFTER_ACCEPTANCE = 0.08, 0.3
"""The part of the cases with which a command is tried, too."""


@dataclass(frozen=True)
class Outcome:
    """What became of a case: one of the constants above, and what is to be told of it."""

    kind: str
    told: str = ""


def written(case: Case, folder: Path) -> Path:
    """Write the files of ``case`` below ``folder``; the file, or the folder of a bundle."""
    root = folder / "bundle" if case.format == "bundle" else folder
    for name, data in case.files.items():
        target = root / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if not data.startswith(RAW_MARK):
            target.write_bytes(data)
            continue
        kind, _, argument = data[len(RAW_MARK) :].decode().partition(" ")
        if kind == "fifo":
            os.mkfifo(target)
        elif kind == "folder":
            target.mkdir()
        elif kind == "link":
            target.symlink_to(argument if argument[0] == "/" else target.name)
    return root if case.format == "bundle" else folder / next(iter(case.files))


def tried(case: Case, corpus: Corpus, name: str = "work") -> Outcome:
    """What becomes of ``case``; ``name`` is that of the folder beside the honest files to work in."""
    folder = corpus.folder / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    before = os.getcwd()
    os.chdir(folder)
    try:
        return _tried(case, corpus, written(case, folder))
    finally:
        os.chdir(before)


def _tried(case: Case, corpus: Corpus, path: Path) -> Outcome:
    reader: Callable[[Case, Corpus, Path], Findings] = getattr(readers, f"read_{case.format}")
    outcome = _guarded(lambda: reader(case, corpus, path), path)
    if outcome.kind == REFUSED and case.draw < COMMANDS_AFTER_REFUSAL:
        return _commanded(case, path, outcome, must_refuse=True)
    if outcome.kind == SOUND and case.draw < COMMANDS_AFTER_ACCEPTANCE:
        return _commanded(case, path, outcome, must_refuse=False)
    return outcome


def _guarded(read: Callable[[], Findings], path: Path) -> Outcome:
    """What reading comes to."""
    try:
        findings = read()
    except LavaVprError as error:
        wrong = wrong_with(str(error), path)
        return Outcome(MESSAGE, f"{wrong}: {str(error)[:600]!r}") if wrong else Outcome(REFUSED, str(error))
    except MemoryError:
        return Outcome(MEMORY, "".join(traceback.format_exc().splitlines(True)[-3:]))
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return Outcome(TRACEBACK, traceback.format_exc())
    return Outcome(UNSOUND, "; ".join(findings[:4])) if findings else Outcome(SOUND)


def wrong_with(message: str, path: Path | None) -> str:
    """What is wrong with a message about the file or bundle ``path``; empty if nothing is."""
    if "\n" in message or not message.isprintable():
        return "more than one line, or unprintable"
    if path is not None and not message.startswith(str(path)):
        return "does not begin with the file's name"
    if "; " not in message:
        return "has no remedy"
    if len(message) - (len(str(path)) if path is not None else 0) >= LONGEST_MESSAGE:
        return f"has {len(message)} characters"
    if "has memory for" in message or "not enough memory" in message:
        return "was refused by memory running out"
    return ""


def _commanded(case: Case, path: Path, outcome: Outcome, *, must_refuse: bool) -> Outcome:
    """``outcome``, unless a command does something else than it says."""
    words = _command(case, path)
    if words is None or (case.format == "settings" and not must_refuse):
        return outcome
    result = CliRunner().invoke(main, words)
    told = "lava-vpr " + " ".join(words)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        kind = MEMORY if isinstance(result.exception, MemoryError) else TRACEBACK
        return Outcome(kind, f"{told}\n{''.join(traceback.format_exception(*result.exc_info))}")
    if must_refuse and result.exit_code != 1:
        return Outcome(MESSAGE, f"{told}: exit code {result.exit_code}, though the reader refuses: {outcome.told}")
    if result.exit_code not in (0, 1):
        return Outcome(MESSAGE, f"{told}: exit code {result.exit_code}: {result.output[-300:]}")
    lines = [
        line for line in result.stderr.splitlines() if not line.startswith(("note: ", "warning: ", "resuming from "))
    ]
    if result.exit_code == 0:
        return outcome if not lines else Outcome(MESSAGE, f"{told}: {result.stderr[:400]!r}")
    head = "lava-vpr: error: "
    if len(lines) != 1 or not lines[0].startswith(head):
        return Outcome(MESSAGE, f"{told}: {result.stderr[:600]!r}")
    wrong = wrong_with(lines[0][len(head) :], path if must_refuse else None)
    return Outcome(MESSAGE, f"{told}: {wrong}: {lines[0][:600]!r}") if wrong else outcome


def _command(case: Case, path: Path) -> list[str] | None:
    """A command that reads the file, chosen by the case's own number."""
    file, honest = str(path), case.honest
    choice = case.number % 6
    if case.format in ("model", "bundle"):
        commands = (
            ["eval", file, "../query"],
            ["query", file, "../query", "-o", "matches.csv"],
            ["eval", file, "../query", "--backend", "bundle"],
            ["verify", file, "../query", "--backend", "bundle", "--limit", "2"],
            ["fit", file, "--target", "kapoho-bay"],
            ["deploy", file, "--target", "loihi2", "-o", "deployed"],
        )
        return commands[choice]
    if case.format == "checkpoint":
        references = ["../reference"] if honest == "paper" else ["../reference", "../second"]
        return [
            "train",
            *references,
            "-o",
            file.removesuffix(".checkpoint"),
            "--config",
            f"../{honest}.toml",
            "--resume",
        ]
    if case.format == "settings":
        return ["train", "../reference", "-o", "x.lvpr", "--config", file]
    if honest in IMAGE_LISTS:
        return ["query", "../float.lvpr", file, "-o", "matches.csv"]
    if honest.startswith("truth"):
        return ["eval", "../float.lvpr", "../query", "--gt", file]
    return ["eval", "../float.lvpr", "../query", "--positions", file, file, "--radius", "5"]
