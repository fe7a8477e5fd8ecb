"""Starts the host program of a board on a bundle's data: the program that lava-vpr ships, never the bundle's own.

A bundle may come from anywhere, and its checksums say only that it is whole, not who wrote it. What was read and
checked is laid out in a private folder with this version's program files in place of the bundle's; nothing beside them,
no link and no later change of the bundle, reaches the interpreter.
"""

from __future__ import annotations

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

from lava_vpr.deploy.bundle.folder import MANIFEST, ReadBundle, json_bytes, sealed
from lava_vpr.deploy.bundle.programs import FOLDER, program_files
from lava_vpr.deploy.bundle.targets import TARGETS
from lava_vpr.engine.inference.biases import bias_registers
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.isolated.child import started, waited
from lava_vpr.storage.reading import parse_json, read_bytes
from lava_vpr.storage.text import harmless

LOOK = 0.05  # seconds between two looks at the program
GRACE = 15.0  # seconds for it to let go of the board
KEPT = 1 << 16  # bytes of each of its texts that are kept, the last ones


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


def interpreter(bundle: ReadBundle, python: str | None = None) -> str:
    """The Python that runs the bundle's board: ``python``, else what the vendor's variable names, else the running one.

    A path with a folder in it is made absolute, as the program has a working directory of its own.
    """
    variable = TARGETS[bundle.target].interpreter
    chosen = python or (os.environ.get(variable) if variable is not None else None) or sys.executable
    return os.path.abspath(chosen) if os.sep in chosen else chosen


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
    python: str | None = None,
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
        python: See `interpreter`.
        patience: Seconds without progress after which it is stopped.
        advance: Told how many more queries are done.
    Raises:
        BackendUnavailableError: the interpreter cannot be started.
    """
    queries, out, log, errors = (folder / name for name in ("queries", "out", "log", "errors"))
    queries.mkdir()
    np.save(queries / "rates.npy", np.ascontiguousarray(rates, np.uint16), allow_pickle=False)
    np.save(queries / "keys.npy", np.ascontiguousarray(keys, np.uint64), allow_pickle=False)
    if bias is not None:
        for name, array in zip(("biases", "exponents"), bias_registers(bias), strict=True):
            np.save(queries / f"{name}.npy", array, allow_pickle=False)
    chosen = interpreter(bundle, python)
    command = [chosen, lay_out(bundle, folder / "bundle"), "--queries", queries, "--out", out, *words]
    environment = {**os.environ, "TMPDIR": str(folder)}  # whatever it leaves is removed
    try:
        with (
            log.open("wb") as log_file,
            errors.open("wb") as error_file,
            started(command, GRACE, cwd=folder, env=environment, stdout=log_file, stderr=error_file) as child,
        ):
            hung = _follow(child, out, len(keys), patience, advance)
    except OSError as error:
        variable = TARGETS[bundle.target].interpreter
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
