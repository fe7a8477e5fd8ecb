"""Runs a bundle's host program as a process of its own: no failure of the vendor's software can take us along.

The program (``program/run.py`` in the bundle) needs a Python that has the vendor's software; the environment variable
NXSDK_PYTHON names it, else it is the running one.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import logging
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import BackendUnavailableError, BundleError, LavaRunError, LavaVprError, NetworkLimitError
from lava_vpr.isolated.child import end, run_child

NOTES = logging.getLogger("lava_vpr")
PYTHON = "NXSDK_PYTHON"
ATTEMPTS = 2
LOOK = 0.05  # seconds between two looks at the program
GRACE = 15.0  # seconds for it to let go of the board
IMPORT_SECONDS = 60.0
PATIENCE = 700.0  # seconds without progress beyond those of one run; the program gives up sooner, unless it hangs

_FIND = "import importlib.util, sys; sys.exit(3 if importlib.util.find_spec('nxsdk') is None else 0)"
_ERRORS: dict[str, type[LavaVprError]] = {
    "bundle": BundleError,
    "input": NetworkLimitError,
    "missing": BackendUnavailableError,
    "start": BackendUnavailableError,
}
"""Stages of the program at which another attempt would end alike, and what their failure is to the caller."""


@dataclass(frozen=True)
class Outcome:
    """What one run of the program left.

    Attributes:
        counts: int32 (n, neurons), -1 in rows that were not answered; or None.
        done: Which presentations were answered, bool (n,).
        stage, error: Where and why it failed; empty if it did not.
        log: What it wrote, and NxSDK's traceback.
    """

    counts: NDArray[np.int32] | None = field(repr=False)
    done: NDArray[np.bool_] = field(repr=False)
    stage: str
    error: str
    log: str


def _interpreter(python: str | None) -> str:
    """The Python that runs the program: ``python``, else what NXSDK_PYTHON names, else the running one."""
    return python or os.environ.get(PYTHON) or sys.executable


def _has_nxsdk(python: str) -> str | None:
    """Why ``python`` cannot import NxSDK; None if it has it."""
    source = "it is Intel's closed package, from its neuromorphic research community"
    if python == sys.executable and importlib.util.find_spec("nxsdk") is not None:
        return None
    try:
        code = run_child([python, "-c", _FIND], seconds=IMPORT_SECONDS).code
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{PYTHON} is {python}, which cannot be started ({error}); name a Python that has nxsdk"
    if code == 0:
        return None
    remedy = "name another" if os.environ.get(PYTHON) else f"set {PYTHON} to a Python that has it"
    return f"nxsdk is not installed for {python}; {source}; {remedy}"


def kapoho_bay_available() -> str | None:
    """Why Kapoho Bay cannot be used here and what to do; None if it can, as far as can be told without starting it."""
    reason = _has_nxsdk(_interpreter(None))
    if reason is None and os.environ.get("KAPOHOBAY") != "1":
        return "no Kapoho Bay is announced to NxSDK; connect it (lsusb must show it) and set KAPOHOBAY=1"
    return reason


def run_bundle(
    bundle_path: Path,
    rates: NDArray[np.uint16],
    keys: NDArray[np.uint64],
    *,
    python: str | None = None,
    timeout: float | None = None,
    advance: Callable[[int], None] | None = None,
) -> NDArray[np.int32]:
    """Present queries to the bundle's board. Queries that it does not answer are presented once more to a board that
    is started afresh, which is logged as a warning (`lava_vpr`).

    Args:
        bundle_path: The bundle.
        rates: Spikes a step in units of 2^-16, uint16 (n, inputs).
        keys: Keys of the presentations, uint64 (n,).
        python: A Python that has the vendor's software (default: $NXSDK_PYTHON, else the running one).
        timeout: Seconds that one run of the board, 16 queries, may take (default: 220).
        advance: Told how many more queries are done.
    Returns:
        Counts int32 (n, neurons), every row from the board.
    Raises:
        BackendUnavailableError: software or board is missing.
        BundleError: the bundle is not intact.
        NetworkLimitError: a query has more input spikes in a step than the host can send.
        LavaRunError: queries remain unanswered; the message says how many were answered.
    """
    counts: NDArray[np.int32] | None = None
    done = np.zeros(len(keys), bool)
    for attempt in range(ATTEMPTS):
        left = np.flatnonzero(~done)
        outcome = _present(bundle_path, rates[left], keys[left], _interpreter(python), timeout or 0.0, advance)
        if outcome.counts is not None:
            counts = np.full((len(keys), outcome.counts.shape[1]), -1, np.int32) if counts is None else counts
            counts[left[outcome.done]] = outcome.counts[outcome.done]
            done[left[outcome.done]] = True
        if counts is not None and done.all():
            return counts
        if outcome.stage in _ERRORS and not done.any():
            raise _ERRORS[outcome.stage](outcome.error)
        said = f"Kapoho Bay answered {int(done.sum())} of {len(done)} queries, then: {outcome.error}"
        if attempt + 1 < ATTEMPTS:
            NOTES.warning("%s; the others are presented again", said)
    raise LavaRunError(
        f"{said}; run bundle's program/run.py --self-test to see whether the board is sound", outcome.log
    )


def _present(
    bundle_path: Path,
    rates: NDArray[np.uint16],
    keys: NDArray[np.uint64],
    python: str,
    timeout: float,
    advance: Callable[[int], None] | None,
) -> Outcome:
    """Run the bundle's host program once."""
    with tempfile.TemporaryDirectory(prefix="lava-vpr-") as folder:
        queries, out, log = Path(folder, "queries"), Path(folder, "out"), Path(folder, "log")
        queries.mkdir()
        np.save(queries / "rates.npy", np.ascontiguousarray(rates, np.uint16), allow_pickle=False)
        np.save(queries / "keys.npy", np.ascontiguousarray(keys, np.uint64), allow_pickle=False)
        program = bundle_path.absolute() / "program" / "run.py"
        environment = {**os.environ, "TMPDIR": folder}  # whatever it leaves is removed
        words = [python, str(program), "--queries", str(queries), "--out", str(out), "--timeout", str(timeout)]
        with log.open("wb") as file:
            try:
                child = subprocess.Popen(
                    words,
                    cwd=folder,
                    env=environment,
                    stdin=subprocess.DEVNULL,
                    stdout=file,
                    stderr=file,
                    start_new_session=True,
                )
            except OSError as error:
                raise BackendUnavailableError(
                    f"{python}: cannot be started ({error.strerror}); set {PYTHON} to a Python that has nxsdk"
                ) from None
        try:
            hung = _follow(child, out, timeout + PATIENCE, advance)
        finally:
            end(child, GRACE)
        text = [
            path.read_text(encoding="utf-8", errors="replace") for path in (log, out / "failure.txt") if path.exists()
        ]
        return _outcome(child.returncode, hung, out, len(keys), "\n".join(text))


def _status(out: Path) -> dict[str, object]:
    """What the program says of itself."""
    try:
        return dict(json.loads((out / "status.json").read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return {}


def _follow(child: subprocess.Popen[bytes], out: Path, patience: float, advance: Callable[[int], None] | None) -> bool:
    """Wait for the program's end and tell its progress; return whether there was none for too long."""
    known, since = 0, time.monotonic()
    while True:
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(LOOK)
        over = child.returncode is not None  # before the file is looked at: nothing is missed
        count = _status(out).get("done")
        if isinstance(count, int) and count > known:
            if advance is not None:
                advance(count - known)
            known, since = count, time.monotonic()
        if over or time.monotonic() - since > patience:
            return not over


def _outcome(code: int, hung: bool, out: Path, n: int, log: str) -> Outcome:
    """Read what the program left; rows count as answered only if all of it agrees."""
    status = _status(out)
    lines = [line for line in log.splitlines() if line.strip()]
    last = lines[-1].strip()[:400] if lines else "it said nothing"
    stage, error = str(status.get("stage") or "run"), str(status.get("error") or "")
    if hung:
        stage, error = "run", "the program hung and was stopped"
    elif code != 0 and not error:
        stage, error = "run", f"the program ended with exit code {code} ({last})"
    try:
        counts = np.load(out / "counts.npy", allow_pickle=False)
        done = np.load(out / "done.npy", allow_pickle=False)
    except (OSError, ValueError):
        return Outcome(None, np.zeros(n, bool), stage, error or last, log)
    sound = counts.dtype == np.int32 and counts.ndim == 2 and done.dtype == bool and len(counts) == n == len(done)
    if not sound or (counts[done] < 0).any():
        return Outcome(None, np.zeros(n, bool), stage, error or "the program left impossible results", log)
    return Outcome(counts, done, stage, error or last, log)
