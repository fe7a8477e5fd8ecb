"""Where compiled kernels are kept, settled before numba is imported.

numba looks only at the file that a function stands in, so a kernel with another file's function inlined would go stale;
and it refuses to be imported where nothing can be written.
"""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from pathlib import Path

PACKAGE = Path(__file__).parent
SOURCES = ("engine/**/*.py", "inputs/*.py")


def drop_stale() -> None:
    """Delete compiled kernels in the package's own folders that are older than any of their sources."""
    newest = max(path.stat().st_mtime for pattern in SOURCES for path in PACKAGE.glob(pattern))
    for path in PACKAGE.rglob("__pycache__/*.nb[ci]"):
        with contextlib.suppress(OSError):
            if path.stat().st_mtime < newest:
                path.unlink()


def _writable(folder: Path) -> bool:
    """Whether ``folder``, or the closest of its parents that exists, lets us write."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK)


def own_folder() -> Path:
    """A folder of ours alone among the temporary files: compiled code is loaded from it."""
    folder = Path(tempfile.gettempdir()) / f"lava-vpr-kernels-{os.getuid()}"
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        if stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o077:
            return folder
    return Path(tempfile.mkdtemp(prefix="lava-vpr-kernels-"))


def prepare() -> None:
    """Drop stale kernels; where neither the package nor the user's cache can be written, use `own_folder`."""
    drop_stale()
    if os.environ.get("NUMBA_CACHE_DIR"):
        return
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    if not (_writable(PACKAGE / "engine" / "__pycache__") or _writable(user)):
        os.environ["NUMBA_CACHE_DIR"] = str(own_folder())
