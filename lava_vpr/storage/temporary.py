"""Temporary folders that are gone when they have served, also after Ctrl-C, SIGTERM and SIGHUP."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lava_vpr.errors import LavaRunError
from lava_vpr.interrupts import held

PREFIX = "lava-vpr-"


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """A new folder, ours alone, that is removed with all it holds at the end of the block.

    Only SIGKILL and a loss of power leave it behind.

    Raises:
        LavaRunError: there is no place for it.
    """
    folder: Path | None = None
    try:
        with held():
            folder = _made()
        yield folder
    finally:
        if folder is not None:
            with held():
                shutil.rmtree(folder, ignore_errors=True)


def _made() -> Path:
    """Make the folder."""
    try:
        return Path(tempfile.mkdtemp(prefix=PREFIX))
    except OSError as error:
        raise LavaRunError(
            f"no temporary folder can be made ({error}); set TMPDIR to one that can be written"
        ) from error
