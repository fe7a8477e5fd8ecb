"""The first failure of a run of Lava, from the process where it happened to an error in the caller's.

Lava catches what a model raises, logs it below its own log level and waits for ever, so a failure is written to a file
by the process in which it happens.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import tempfile
import threading
import time
import traceback
from pathlib import Path
from typing import Any

from lava_vpr import errors
from lava_vpr.errors import LavaRunError, LavaVprError

LONGEST = 400  # characters of an exception's text in the one line of an error
LOG_TAIL = 20_000  # characters
NOTING = 5.0  # seconds in which a failure is noted, on the slowest of machines
PAUSE = 0.01  # seconds between two looks whether it is


def one_line(text: str) -> str:
    """``text`` on one line, cut where it is too long for one."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else line[:LONGEST] + " ..."


def _code_location(error: BaseException) -> str:
    """Where an exception came from: its last frame outside installed packages and the standard library."""
    frames = [(Path(f.filename), f.lineno, f.name) for f in traceback.extract_tb(error.__traceback__)]
    ours = [f for f in frames if not {"site-packages", f"python3.{sys.version_info.minor}"} & set(f[0].parts)]
    if not frames:
        return ""
    path, line, function = (ours or frames)[-1]
    return f"{path.name}:{line} in {function}"


def _known_class(error: BaseException) -> str:
    """The closest class of ``error`` that lava_vpr.errors defines, or nothing."""
    return next((c.__name__ for c in type(error).__mro__ if getattr(errors, c.__name__, None) is c), "")


def record(folder: Path, values: dict[str, Any]) -> None:
    """Note a failure, unless one has been noted before it.

    One that another process is noting just now is waited for: the end of this one may be the end of that.
    """
    with contextlib.suppress(OSError):  # the folder is gone: nobody waits for it
        try:
            os.close(os.open(folder / "error.lock", os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
        except FileExistsError:
            if _noted(folder):
                return
        part = folder / f"error-{os.getpid()}-{threading.get_ident()}.part"
        part.write_text(json.dumps(values), encoding="utf-8")
        part.replace(folder / "error.json")


def _noted(folder: Path) -> bool:
    """Whether the failure is noted that another process or thread began to note; False if that was killed over it."""
    end = time.monotonic() + NOTING
    while not (folder / "error.json").exists():
        if time.monotonic() > end:
            return False
        time.sleep(PAUSE)
    return True


def record_exception(folder: Path, error: BaseException, where: str = "") -> None:
    """Note an exception of the model, or other part, called ``where``; its traceback goes to the log as well."""
    full = "".join(traceback.format_exception(type(error), error, error.__traceback__))
    with contextlib.suppress(OSError, ValueError):
        sys.stderr.write(full)
        sys.stderr.flush()
    values = {"where": where, "type": type(error).__name__, "text": str(error), "code_location": _code_location(error)}
    record(folder, {**values, "known": _known_class(error), "traceback": full})


def record_end(folder: Path, where: str, code: int) -> None:
    """Note that the process of the model called ``where`` ended with ``code`` (negative: a signal)."""
    record(folder, {"where": where, "code": code})


def recorded(folder: Path) -> dict[str, Any] | None:
    """The first failure noted, or None."""
    try:
        return dict(json.loads((folder / "error.json").read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None


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


def of_record(values: dict[str, Any], target: str, folder: Path) -> LavaVprError:
    """The error that a recorded failure is to the caller."""
    where = values["where"]
    if "code" in values:
        return of_end(f"{target}: the process of {where}", values["code"], folder)
    known = getattr(errors, values["known"], None)
    if known is not None and known is not LavaRunError:
        error: LavaVprError = known(values["text"])
        return error
    text = one_line(f"{values['type']}: {values['text']}" if values["text"] else values["type"])
    location = f" at {values['code_location']}" if values["code_location"] else ""
    said = f"{target} failed{f' in {where}' if where else ''}: {text}{location}"
    return _failure(said, "traceback", values["traceback"])


def of_end(what: str, code: int, folder: Path) -> LavaRunError:
    """The error of a process, called ``what``, that ended with ``code`` and without a word."""
    if code < 0:
        try:
            name = signal.Signals(-code).name
        except ValueError:
            name = f"signal {-code}"
        reason = f"was killed ({name})"
        remedy = "if memory ran out, free some or run less at once; then run it again"
        if -code in (signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT, signal.SIGILL, signal.SIGFPE):
            reason, remedy = f"crashed ({name})", "a compiled part is at fault: install numba and lava-nc again"
    else:
        reason, remedy = f"ended itself with exit code {code} and no result", "let it raise an error or return"
    return _failure(f"{what} {reason}; {remedy}", "its log", _log(folder))


def of_timeout(target: str, seconds: float, folder: Path) -> LavaRunError:
    """The error of a run that took too long."""
    said = f"{target} did not end within {seconds:g} s and was stopped; allow more time or run less at once"
    return _failure(said, "where its processes stood", "\n".join([*_stacks(folder), _log(folder)]))
