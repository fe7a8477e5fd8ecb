"""Power and time on a board as the vendor's profiler measures them; idle power subtracted, never modelled.

The host program of a bundle drives the board (its option ``--power``). One run must be long: short ones have shown
negative power.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from lava_vpr.backends.interface import Presentations
from lava_vpr.bench.measure.child import repeated
from lava_vpr.bench.results import Measured
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.deploy.bundle.targets import TARGETS
from lava_vpr.engine.inference.fixed import SILENT_STEPS
from lava_vpr.errors import LavaRunError
from lava_vpr.isolated.child import run_child
from lava_vpr.model import Model, checked_network

STEPS = 100_000
"""Least steps of a run; queries are repeated with other noise. Source: public measurements of idle power of Loihi and
Loihi 2 run as many steps (lava-dl's tiny_yolo_sdnn benchmark; users' scripts for NxSDK)."""

TIMEOUT = 2 * 3600.0
FIGURES = ("steps", "microseconds_per_step", "milliwatts", "idle_milliwatts", "dynamic_milliwatts")


def measure(model: Model, shown: Presentations, backend: str) -> Measured:
    """Run queries on the board for `STEPS` steps and take over what its profiler tells.

    Args:
        model: With an integer network, or a bundle for this board.
        shown: The queries.
        backend: Name of the board.
    Raises:
        LavaRunError: the board's program failed, or could measure no power; its own words.
        NetworkLimitError: the model does not fit the board.
    """
    network = checked_network(model, backend)
    interval = network.steps + SILENT_STEPS
    n = len(shown.image_ids)
    rates, ids = repeated(shown.rates, shown.image_ids, max(1, -(-STEPS // (interval * n))))
    with tempfile.TemporaryDirectory(prefix="lava-vpr-") as folder:
        bundle = model.bundle
        if bundle is None:
            bundle = deploy(model, BOARDS[backend], Path(folder) / "bundle", picture=False).bundle.path
        profile = _run(bundle, Path(folder), Presentations(rates, ids, shown.seed), backend)
    each = interval * profile["microseconds_per_step"]
    figures = profile | {
        "microseconds_per_query": each,
        "dynamic_microjoules_per_query": each * profile["dynamic_milliwatts"] * 1e-3,
    }
    return Measured(
        backend,
        f"a board, by the vendor's profiler: mean over {profile['steps']:,.0f} steps, host's input and read-out "
        "included",
        queries=n,
        queries_per_second=1e6 / each,
        no_energy="the board's energy is under its own figures",
        board=figures,
    )


def _run(bundle: Path, folder: Path, shown: Presentations, backend: str) -> dict[str, float]:
    """The figures that the bundle's program measures, by name (`FIGURES`)."""
    queries, power = folder / "queries", folder / "power.json"
    queries.mkdir()
    np.save(queries / "rates.npy", np.ascontiguousarray(shown.rates, np.uint16), allow_pickle=False)
    np.save(queries / "keys.npy", np.ascontiguousarray(shown.keys, np.uint64), allow_pickle=False)
    variable = TARGETS[backend].interpreter
    python = os.environ.get(variable) if variable is not None else None
    words = [python or sys.executable, str(bundle.absolute() / "program" / "run.py")]
    words += ["--queries", str(queries), "--out", str(folder / "out"), "--power", str(power)]
    try:
        ended = run_child(words, seconds=TIMEOUT)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise LavaRunError(f"{backend}: the board's program did not end well ({error}); try its --self-test") from None
    if ended.code:
        raise LavaRunError(ended.last or f"{backend}: the board's program failed without a word", ended.err)
    try:
        profile = json.loads(power.read_text(encoding="utf-8"))
        return {name: float(profile[name]) for name in FIGURES}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LavaRunError(f"{backend}: the board's program told no power ({error}); deploy the model again") from None
