"""Run of a board's host program on a bundle's data: always the program that lava-vpr ships, never the bundle's own.

A bundle may come from anywhere, and its checksums prove only that it is complete, not who wrote it. So the data that
was read and checked is written to a private folder, with this version's program files instead of the bundle's. Nothing
else reaches the interpreter: no link, and no later change of the bundle.

Kapoho Bay's program needs a Python that has the vendor's software; the environment variable NXSDK_PYTHON names it, else
it is the running one.
"""

from __future__ import annotations

import importlib.util
import logging
import os
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.bundle.core_files import scalars
from lava_vpr.deploy.bundle.folder import MANIFEST, ReadBundle, json_bytes, sealed
from lava_vpr.deploy.bundle.targets import FOLDER, TARGETS, program_files
from lava_vpr.engine.inference.biases import bias_registers
from lava_vpr.errors import (
    BackendUnavailableError,
    BundleError,
    LavaRunError,
    LavaVprError,
    NetworkLimitError,
    harmless,
)
from lava_vpr.isolated.child import run_child, started, waited
from lava_vpr.storage.arrays import array_of
from lava_vpr.storage.reading import parse_json, read_bytes
from lava_vpr.storage.writing import temporary_folder

LOOK = 0.05  # seconds between two checks of the program
GRACE = 15.0  # seconds for it to let go of the board
KEPT = 1 << 16  # last bytes kept of each of its texts
NOTES = logging.getLogger("lava_vpr")
PYTHON = "NXSDK_PYTHON"
ATTEMPTS = 2
IMPORT_SECONDS = 60.0
PATIENCE = 700.0  # seconds without progress; the program gives up sooner, unless it hangs

_FIND = (
    "import sys; sys.path[:] = [path for path in sys.path if path]; "  # not the working folder, which may be a bundle
    "import importlib.util; sys.exit(3 if importlib.util.find_spec('nxsdk') is None else 0)"
)
_ERRORS: dict[str, type[LavaVprError]] = {
    "bundle": BundleError,
    "input": NetworkLimitError,
    "missing": BackendUnavailableError,
    "start": BackendUnavailableError,
}
"""Stages of the program at which another attempt would fail in the same way, and the error to raise for each."""


@dataclass(frozen=True)
class EndedProgram:
    """How a run of the program ended.

    Attributes:
        code: Its exit code; negative: the signal that ended it.
        hung: Whether it made no progress for too long and was stopped.
        log: The end of what it wrote, and NxSDK's traceback; fit for a terminal.
        last: The last line of its errors, at most 400 characters; empty if it wrote none.
        stage, error: Where and why it failed, by its own status; empty if that does not say.
    """

    code: int
    hung: bool
    log: str = field(repr=False)
    last: str
    stage: str
    error: str


def lay_out(bundle: ReadBundle, folder: Path) -> Path:
    """Write what was read of ``bundle`` into the new folder ``folder``, with the shipped program; its ``run.py``.

    Raises:
        OSError: the folder cannot be written.
    """
    own = program_files(TARGETS[bundle.target].program)
    files = {name: data for name, data in bundle.files.items() if name.split("/")[0] != FOLDER} | own
    for name, data in (*files.items(), (MANIFEST, json_bytes(sealed(bundle.manifest, files)))):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return folder / FOLDER / "run.py"


def run_program(
    bundle: ReadBundle,
    folder: Path,
    rates: NDArray[np.uint16],
    keys: NDArray[np.uint64],
    words: Sequence[str | Path] = (),
    *,
    bias: NDArray[np.int32] | None = None,
    pixels: NDArray[np.uint8] | None = None,
    patience: float,
    advance: Callable[[int], None] | None = None,
) -> EndedProgram:
    """Run the shipped program of the bundle's board on the bundle's data; its results are then in ``folder``/out.

    Args:
        bundle: The bundle.
        folder: An empty private folder; whatever the program leaves is in there.
        rates: Spikes a step in units of 2^-16, uint16 (n, inputs).
        keys: Keys of the presentations, uint64 (n,).
        words: More words of its command line.
        bias: Biases of each presentation in units of v, int32 (n, neurons); None: always the bundle's.
        pixels: Grey levels of each image, uint8 (n, height, width), in place of rates and keys; None: these are sent.
        patience: Seconds without progress after which it is stopped.
        advance: Called with how many more queries are done.
    Raises:
        BackendUnavailableError: the interpreter cannot be started.
    """
    queries, out, log, errors = (folder / name for name in ("queries", "out", "log", "errors"))
    queries.mkdir()
    if pixels is not None:
        np.save(queries / "pixels.npy", np.ascontiguousarray(pixels), allow_pickle=False)
    else:
        np.save(queries / "rates.npy", np.ascontiguousarray(rates, np.uint16), allow_pickle=False)
        np.save(queries / "keys.npy", np.ascontiguousarray(keys, np.uint64), allow_pickle=False)
    if bias is not None:
        for name, array in zip(("biases", "exponents"), bias_registers(bias), strict=True):
            np.save(queries / f"{name}.npy", array, allow_pickle=False)
    variable = TARGETS[bundle.target].interpreter
    chosen = (os.environ.get(variable) if variable is not None else None) or sys.executable
    chosen = os.path.abspath(chosen) if os.sep in chosen else chosen  # the program has a working directory of its own
    command = [chosen, lay_out(bundle, folder / "bundle"), "--queries", queries, "--out", out, *words]
    environment = {**os.environ, "TMPDIR": str(folder)}  # all its files are removed
    try:
        with (
            log.open("wb") as log_file,
            errors.open("wb") as error_file,
            started(command, GRACE, cwd=folder, env=environment, stdout=log_file, stderr=error_file) as child,
        ):
            hung = _follow(child, out, len(keys), patience, advance)
    except OSError as error:
        remedy = f"set {variable} to a Python that has nxsdk" if variable else "install Python again"
        raise BackendUnavailableError(f"{chosen}: cannot be started ({error.strerror}); {remedy}") from None
    return ended(folder, bundle, child.returncode, hung=hung)


def ended(folder: Path, bundle: ReadBundle, code: int, *, hung: bool) -> EndedProgram:
    """What the program that ran in ``folder`` said; the bundle is named where it said the copy."""

    def named(text: object) -> str:
        return text.replace(str(folder / "bundle"), str(bundle.path)) if isinstance(text, str) else ""

    log, errors, details = (named(_tail(folder / name)) for name in ("log", "errors", "out/failure.txt"))
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    said = _status(folder / "out")
    stage, error = (" ".join(harmless(named(said.get(name))).split())[:400] for name in ("stage", "error"))
    whole = "\n".join(text for text in (log, errors, details) if text)
    return EndedProgram(code, hung, whole, lines[-1][:400] if lines else "", stage, error)


def _status(out: Path) -> dict[str, object]:
    """What the program says of itself in the folder of its results; empty if that is nothing sound."""
    try:
        said = parse_json(read_bytes(out / "status.json", "bundle_json_bytes"))
    except (OSError, ValueError):
        return {}
    return said if isinstance(said, dict) else {}


def _follow(
    child: subprocess.Popen[bytes], out: Path, n: int, patience: float, advance: Callable[[int], None] | None
) -> bool:
    """Wait for the program's end and tell its progress; return whether there was none for too long."""
    known, since = 0, time.monotonic()
    while True:
        over = waited(child, LOOK) is not None  # before the file is looked at: nothing is missed
        count = _status(out).get("done")
        if type(count) is int and known < count <= n:
            if advance is not None:
                advance(count - known)
            known, since = count, time.monotonic()
        if over or time.monotonic() - since > patience:
            return not over


def _tail(path: Path) -> str:
    """The last `KEPT` bytes of a text that the program wrote, fit for a terminal; empty if there is no such file."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return ""
    with os.fdopen(handle, "rb") as file:
        known = os.fstat(handle)
        if not stat.S_ISREG(known.st_mode):
            return ""
        file.seek(max(0, known.st_size - KEPT))
        return harmless(file.read(KEPT).decode(errors="replace"))


def _has_nxsdk(python: str) -> str | None:
    """The reason why ``python`` cannot import NxSDK; None if it can."""
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
    """The reason why Kapoho Bay cannot be used here, and the remedy; None if it seems usable without starting it."""
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
    pixels: NDArray[np.uint8] | None = None,
    advance: Callable[[int], None] | None = None,
) -> NDArray[np.int32]:
    """Present queries to the bundle's board. Queries that it does not answer are presented once more to a board that
    is started afresh, which is logged as a warning (`lava_vpr`).

    Args:
        bundle: The bundle, whose data the shipped program gets (`lay_out`).
        rates: Spikes a step in units of 2^-16, uint16 (n, inputs).
        keys: Keys of the presentations, uint64 (n,).
        bias: Biases of each presentation in units of v, int32 (n, neurons); None: always the bundle's.
        pixels: As in `run_program`.
        advance: Called with how many more queries are done.
    Returns:
        Counts int32 (n, neurons), every row from the board.
    Raises:
        BackendUnavailableError: software or board is missing.
        BundleError: the bundle is not intact.
        NetworkLimitError: a query has more input spikes in a step than the host can send.
        LavaRunError: queries remain unanswered; the message says how many were answered.
    """
    counts, done = np.full((len(keys), scalars(bundle)["neurons"]), -1, np.int32), np.zeros(len(keys), bool)
    for attempt in range(ATTEMPTS):
        left = np.flatnonzero(~done)
        with temporary_folder() as folder:
            ended = run_program(
                bundle,
                folder,
                rates[left],
                keys[left],
                bias=None if bias is None else bias[left],
                pixels=None if pixels is None else pixels[left],
                patience=PATIENCE,
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
