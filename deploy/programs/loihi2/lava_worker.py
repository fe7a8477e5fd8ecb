"""The work of the process that runs Lava: it takes a job from a folder and leaves its answers there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import first_failure
from job_folder import load_job
from lava_network import Player, define_processes
from lava_pixels import PixelPlayer
from refusals import Refused
from result_files import put


def work(folder: Path) -> int:
    """Present the queries of a job; the exit code."""
    try:
        _, options, arrays = load_job(folder)
        define_processes()
        first_failure.watch_processes(folder)
        seen, n = np.memmap(folder / "steps", np.int64, "w+", shape=(1,)), len(arrays["keys"])
        player = (PixelPlayer if "pixels" in arrays else Player)(arrays, options, seen)
        for start in range(0, n, options["batch"]):
            end = min(n, start + options["batch"])
            put(str(folder / f"batch-{start}.npy"), player.present(start, end))
        player.process.stop()
        if player.profiler:
            put(str(folder / "power.json"), player.profiler.figures())
    except Refused as error:
        first_failure.record(folder, {"stage": error.stage, "text": str(error)})
        return 1
    except BaseException as error:
        first_failure.record_exception(folder, error)
        return 1
    return 0
