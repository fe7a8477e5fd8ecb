"""Presents queries to Kapoho Bay by its host program, a process of its own: the vendor's failures stay there.

The program needs a Python that has the vendor's software; the environment variable NXSDK_PYTHON names it, else it is
the running one.
"""

from __future__ import annotations

import importlib.util
import logging
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.bundle.core_files import scalars
from lava_vpr.deploy.bundle.folder import ReadBundle
from lava_vpr.deploy.running.board_program import EndedProgram, run_program
from lava_vpr.errors import BackendUnavailableError, BundleError, LavaRunError, LavaVprError, NetworkLimitError
from lava_vpr.isolated.child import run_child
from lava_vpr.storage.arrays import array_of
from lava_vpr.storage.reading import read_bytes
from lava_vpr.storage.writing import temporary_folder

NOTES = logging.getLogger("lava_vpr")
PYTHON = "NXSDK_PYTHON"
ATTEMPTS = 2
IMPORT_SECONDS = 60.0
PATIENCE = 700.0  # seconds without progress beyond those of one run; the program gives up sooner, unless it hangs

_FIND = (
    "import sys; sys.path[:] = [path for path in sys.path if path]; "  # not where we stand, which may be a bundle
    "import importlib.util; sys.exit(3 if importlib.util.find_spec('nxsdk') is None else 0)"
)
_ERRORS: dict[str, type[LavaVprError]] = {
    "bundle": BundleError,
    "input": NetworkLimitError,
    "missing": BackendUnavailableError,
    "start": BackendUnavailableError,
}
"""Stages of the program at which another attempt would end alike, and what their failure is to the caller."""


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
    reason = _has_nxsdk(os.environ.get(PYTHON) or sys.executable)
    if reason is None and os.environ.get("KAPOHOBAY") != "1":
        return "no Kapoho Bay is announced to NxSDK; connect it (lsusb must show it) and set KAPOHOBAY=1"
    return reason


def run_bundle(
    bundle: ReadBundle,
    rates: NDArray[np.uint16],
    keys: NDArray[np.uint64],
    *,
    bias: NDArray[np.int32] | None = None,
    python: str | None = None,
    timeout: float | None = None,
    advance: Callable[[int], None] | None = None,
) -> NDArray[np.int32]:
    """Present queries to the bundle's board. Queries that it does not answer are presented once more to a board that
    is started afresh, which is logged as a warning (`lava_vpr`).

    Args:
        bundle: The bundle, whose data the shipped program gets (`lava_vpr.deploy.running.board_program`).
        rates: Spikes a step in units of 2^-16, uint16 (n, inputs).
        keys: Keys of the presentations, uint64 (n,).
        bias: Biases of each presentation in units of v, int32 (n, neurons); None: always the bundle's.
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
    counts, done = np.full((len(keys), scalars(bundle)["neurons"]), -1, np.int32), np.zeros(len(keys), bool)
    seconds = timeout or 0.0
    for attempt in range(ATTEMPTS):
        left = np.flatnonzero(~done)
        with temporary_folder() as folder:
            ended = run_program(
                bundle,
                folder,
                rates[left],
                keys[left],
                ("--timeout", str(seconds)),
                bias=None if bias is None else bias[left],
                python=python,
                patience=seconds + PATIENCE,
                advance=advance,
            )
            found, error = _answers(folder / "out", (len(left), counts.shape[1]), ended)
        if found is not None:
            rows, answered = found
            counts[left[answered]], done[left[answered]] = rows[answered], True
            if done.all():
                return counts
        if ended.stage in _ERRORS and not ended.hung and not done.any():
            raise _ERRORS[ended.stage](error)
        said = f"Kapoho Bay answered {int(done.sum())} of {len(done)} queries, then: {error}"
        if attempt + 1 < ATTEMPTS:
            NOTES.warning("%s; the others are presented again", said)
    raise LavaRunError(
        f"{said}; run the bundle's program/run.py --self-test to see whether the board is sound", ended.log
    )


def _answers(
    out: Path, size: tuple[int, int], ended: EndedProgram
) -> tuple[tuple[NDArray[np.int32], NDArray[np.bool_]] | None, str]:
    """What the program left for ``size`` (n, neurons), and why it went no further.

    Counts int32 (n, neurons), and which presentations were answered, bool (n,); None unless all of it agrees.
    """
    last, error = ended.last or "it said nothing", ended.error
    if ended.hung:
        error = "the program hung and was stopped"
    elif ended.code != 0 and not error:
        error = f"the program ended with exit code {ended.code} ({last})"
    try:
        counts = array_of(read_bytes(out / "counts.npy", "bundle_bytes"), np.int32, size)
        done = array_of(read_bytes(out / "done.npy", "bundle_bytes"), np.bool_, size[:1])
    except OSError:
        return None, error or last
    except ValueError:
        return None, error or "the program left impossible results"
    if (counts[done] < 0).any():
        return None, error or "the program left impossible results"
    return (counts, done), error or last
