"""Where compiled kernels are kept, settled before numba is imported; and a cache that can only save time.

numba looks only at the file that a function stands in, so a kernel with another file's function inlined would go stale.
Where it cannot write, its disk is full or an entry is cut short it raises; here a kernel is compiled again then.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import os
import re
import stat
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lava_vpr.errors import ConfigError
from lava_vpr.interrupts import held

PACKAGE = Path(__file__).parent
SOURCES = ("engine/**/*.py", "events/*.py", "inputs/*.py", "matching/*.py")
NOTES = logging.getLogger("lava_vpr")

_noted = False
_open = 0
_began = _spent = 0.0
COMPILING_TEXT = "compiling kernels (first run)"
COMPILING: list[Callable[[bool], None]] = []
"""Callbacks for compilation, of which the last is called: True when a kernel begins, False when it is done."""


def note_compiling(begun: bool) -> None:
    """Print once that kernels are compiled: the callback of a program, under those of whatever is drawn meanwhile."""
    if begun:
        COMPILING.remove(note_compiling)
        with contextlib.suppress(OSError):
            print(f"note: {COMPILING_TEXT}", file=sys.stderr, flush=True)


def drop_stale() -> None:
    """Delete compiled kernels in the package's own folders that are older than any of their sources.

    What numba was writing when it was killed goes with them.
    """
    newest = max(path.stat().st_mtime for pattern in SOURCES for path in PACKAGE.glob(pattern))
    for pattern in ("__pycache__/*.nb[ci]", "__pycache__/*.nb[ci].tmp.*"):
        for path in PACKAGE.rglob(pattern):
            with contextlib.suppress(OSError):
                if path.stat().st_mtime < newest:
                    path.unlink()


def _writable(folder: Path) -> bool:
    """Whether ``folder``, or the closest of its parents that exists, lets us write."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK)


def own_folder() -> Path | None:
    """A folder of ours alone among the temporary files: compiled code is loaded from it. None: there is none."""
    with contextlib.suppress(OSError):
        folder = Path(tempfile.gettempdir()) / f"lava-vpr-kernels-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        if stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o077:
            return folder
    return None


def _users(variable: str, name: str) -> bool:
    """Whether the folder that ``variable`` names, or ``name`` at the user's home if there is one, can be written."""
    home, chosen = Path(os.path.expanduser("~")), os.environ.get(variable)
    return _writable(Path(chosen)) if chosen else home.is_dir() and _writable(home / name)


def prepare() -> None:
    """Drop stale kernels; give numba and matplotlib `own_folder` where they can write neither here nor at home.

    Without a home directory, neither may create a folder named ``~`` here, nor warn about it.
    """
    drop_stale()
    cache, config = _users("XDG_CACHE_HOME", ".cache"), _users("XDG_CONFIG_HOME", ".config")
    if cache and config:
        return
    own = own_folder()
    if not os.environ.get("MPLCONFIGDIR") and own is not None:
        os.environ["MPLCONFIGDIR"] = str(own)
    if not cache:
        os.environ["XDG_CACHE_HOME"] = str(own or os.devnull)
        if not (os.environ.get("NUMBA_CACHE_DIR") or _writable(PACKAGE / "engine" / "__pycache__") or own is None):
            os.environ["NUMBA_CACHE_DIR"] = str(own)


def compiled(**options: Any) -> Any:
    """`numba.njit` with a cache that can fail without harm: a decorator of kernels, each compiled at its first call.

    Args:
        options: As for `numba.njit`, without ``cache``.
    """
    numba = imported()

    def decorate(function: Any) -> Any:
        kernel = numba.njit(**options)(function)
        if kernel is function:  # NUMBA_DISABLE_JIT
            return function
        try:
            kernel._cache = _cache_class()(function)
        except RuntimeError:  # numba found no folder that can be written
            _note("lava-vpr's own folder and your home", "no permission to write")
        return kernel

    return decorate


_FEATURES = re.compile(r"([+-][\w.-]+(,|$))*")


@functools.cache
def imported() -> Any:
    """numba, imported for the first time here.

    Raises:
        ConfigError: one of its environment variables is none that it can read.
    """
    features = os.environ.get("NUMBA_CPU_FEATURES", "")
    try:
        if not _FEATURES.fullmatch(features):  # LLVM would end the process
            raise ValueError(f"NUMBA_CPU_FEATURES is {features!r}")
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "Environment variable", RuntimeWarning)
            import numba
    except (ValueError, RuntimeWarning) as error:
        said = str(error).splitlines()[0]
        raise ConfigError(
            f"numba cannot start ({said}); correct or unset its environment variables, NUMBA_..."
        ) from None
    return numba


@functools.cache
def _cache_class() -> Any:
    """numba's cache of a kernel, which ignores entries that it cannot read and continues where it cannot write."""
    from numba.core.caching import FunctionCache
    from numba.core.runtime import rtsys

    class KernelCache(FunctionCache):
        """The cache of one kernel."""

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            """See there, whose refreshing of the context takes .3 s of imports that only compiling needs."""
            found = None
            try:
                with held():  # LLVM would free twice what is loaded by half
                    rtsys.initialize(target_context)
                    found = self._load_overload(sig, target_context)
            except Exception:  # a damaged pickle may raise anything
                with contextlib.suppress(OSError), held():
                    self.flush()
            if found is None:
                _tell(True)
            return found

        def save_overload(self, *what: Any) -> None:
            _tell(False)
            try:
                with held():  # else half a file would be left
                    super().save_overload(*what)
            except Exception as error:  # an index that is damaged and cannot be replaced, too
                _note(self.cache_path, getattr(error, "strerror", None) or str(error))

    return KernelCache


def _tell(begun: bool) -> None:
    """Say that kernels are compiled now, or that the last of them is done: one may be compiled within another."""
    global _open, _began, _spent
    _open += 1 if begun else -1
    if _open == int(begun):
        now = time.perf_counter()
        _began, _spent = (now, _spent) if begun else (_began, _spent + now - _began)
        for told in COMPILING[-1:]:
            told(begun)


def seconds_compiling() -> float:
    """How long kernels were compiled in this process, s."""
    return _spent


def _note(place: str, reason: str) -> None:
    """Say once that compiled kernels are not kept."""
    global _noted
    if not _noted:
        _noted = True
        NOTES.warning(
            "compiled kernels cannot be kept in %s (%s), so each command compiles them again; free space there, or set "
            "NUMBA_CACHE_DIR to a folder that can be written",
            place,
            reason,
        )
