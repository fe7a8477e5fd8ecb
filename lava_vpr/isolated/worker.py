"""Runs one target for `lava_vpr.isolated.runner`: ``python -m lava_vpr.isolated.worker FOLDER CALLER``.

The worker is two processes (`lava_vpr.isolated.lifetime.keep`): the keeper, which never imports Lava, and the one that
runs the target. Lava's processes are children of that one and are killed by the system when it dies.
"""

from __future__ import annotations

import faulthandler
import importlib
import logging
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lava_vpr.isolated import lifetime

if TYPE_CHECKING:
    from lava_vpr.isolated.job_folder import ProgressWriter

_progress: ProgressWriter | None = None


def report(done: int) -> None:
    """Say that ``done`` further units of work are done, from the target or any Lava model.

    Outside a worker it says nothing.
    """
    if _progress is not None:
        _progress.add(done)


def quiet_logging() -> None:
    """Keep Lava from adding a handler to the root logger with every Process, and to its compiler's with every run."""
    logging.basicConfig(level=logging.WARNING)  # one handler, to the log of the run
    add = logging.Logger.addHandler

    def add_unless_lava(self: logging.Logger, handler: logging.Handler) -> None:
        if self is not logging.getLogger() and not self.name.startswith("lava."):
            add(self, handler)

    vars_of_logger: Any = logging.Logger
    vars_of_logger.addHandler = add_unless_lava


def work(folder: Path) -> int:
    """Call the target and return the exit code."""
    global _progress
    from lava_vpr.isolated import first_failure, job_folder  # after the keeper has forked, which needs none of them

    try:
        faulthandler.enable()
        quiet_logging()
        _progress = job_folder.ProgressWriter(folder)
        first_failure.tell_stacks(folder, "the target")
        first_failure.watch_processes(folder)
        target, options, arrays = job_folder.load_job(folder)
        module, _, name = target.partition(":")
        function = getattr(importlib.import_module(module), name)
        job_folder.save_arrays(folder / "results", function(arrays, options))
    except BaseException as error:
        first_failure.record_exception(folder, error)
        return 1
    return 0


if __name__ == "__main__":
    # Under its own name, so that `report` finds what this process set.
    from lava_vpr.isolated import worker

    given = Path(sys.argv[1])
    sys.exit(lifetime.keep(given, int(sys.argv[2]), partial(worker.work, given)))
