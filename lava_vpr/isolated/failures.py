"""A failed run of Lava as the error that its caller gets."""

from __future__ import annotations

import contextlib
import signal
import tempfile
from pathlib import Path
from typing import Any

from lava_vpr import errors
from lava_vpr.errors import LavaRunError, LavaVprError

LONGEST = 400  # characters of an exception's text in the one line of an error
LOG_TAIL = 20_000  # characters


def one_line(text: str) -> str:
    """``text`` on one line, cut where it is too long for one."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else line[:LONGEST] + " ..."


def _log(folder: Path) -> str:
    """The end of what the run's processes wrote to stdout and stderr."""
    try:
        return (folder / "log").read_text(encoding="utf-8", errors="replace")[-LOG_TAIL:]
    except OSError:
        return ""


def _stacks(folder: Path) -> list[str]:
    """Where each process of the run stood, as far as they have said so."""
    return [path.read_text(encoding="utf-8", errors="replace") for path in sorted(folder.glob("stacks-*"))]


def all_stacks(folder: Path) -> bool:
    """Whether each process has written where it stands, below the line that says who it is."""
    return all(text.count("\n") > 1 for text in _stacks(folder))


def _keep(text: str) -> str:
    """Write ``text`` to a file that stays; its path, or nothing if there is no text or no room for it."""
    if not text.strip():
        return ""
    try:
        handle, path = tempfile.mkstemp(prefix="lava-vpr-failure-", suffix=".txt")
        with open(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:
        return ""
    return path


def _failure(message: str, what: str, details: str) -> LavaRunError:
    """An error whose line ends with the file in which ``details`` are kept, and ``what`` they are."""
    path = _keep(details)
    return LavaRunError(f"{message}; {what}: {path}" if path else message, details.strip())


def error_of(values: dict[str, Any], target: str, seconds: float, folder: Path) -> LavaVprError:
    """The error that a failure of ``target`` is to the caller.

    Args:
        values: As `lava_vpr.isolated.first_failure.awaited` returns them.
        target: What was run.
        seconds: The time that it had.
        folder: The folder of the run, which still has its log.
    """
    if not values:
        said = f"{target} did not end within {seconds:g} s and was stopped; allow more time or run less at once"
        return _failure(said, "where its processes stood", "\n".join([*_stacks(folder), _log(folder)]))
    where = values.get("where", "")
    if "code" in values:
        process = f"the process of {where}" if where else "its process"
        return _failure(f"{target}: {process} {_ended(values['code'])}", "its log", _log(folder))
    known = next((kind for kind in values["kinds"] if kind.startswith(f"{errors.__name__}.")), "").rpartition(".")[2]
    if known and known != LavaRunError.__name__:
        error: LavaVprError = getattr(errors, known)(values["text"])
        return error
    text = one_line(f"{values['type']}: {values['text']}" if values["text"] else values["type"])
    location = f" at {values['code_location']}" if values["code_location"] else ""
    said = f"{target} failed{f' in {where}' if where else ''}: {text}{location}"
    return _failure(said, "traceback", values["traceback"])


def _ended(code: int) -> str:
    """How a process ended that says nothing itself, by its exit code, and what to do."""
    if code >= 0:
        return f"ended itself with exit code {code} and no result; let it raise an error or return"
    name = f"signal {-code}"
    with contextlib.suppress(ValueError):
        name = signal.Signals(-code).name
    if -code in (signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT, signal.SIGILL, signal.SIGFPE):
        return f"crashed ({name}); a compiled part is at fault: install numba and lava-nc again"
    return f"was killed ({name}); if memory ran out, free some or run less at once; then run it again"
