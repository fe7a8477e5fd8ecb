"""Power and time on a board, measured by the vendor's profiler with idle power subtracted; nothing here is modelled.

The board's host program runs the profiler (option ``--power``). A run is as long as those of public
measurements (`STEPS`).
"""

from __future__ import annotations

import math

from lava_vpr.backends.deployed import bundle_of
from lava_vpr.backends.interface import Presentations
from lava_vpr.bench.results import Measured
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.bundle.board_program import run_program
from lava_vpr.deploy.bundle.folder import ReadBundle
from lava_vpr.errors import LavaRunError
from lava_vpr.model import Model, checked_network
from lava_vpr.storage.reading import parse_json, read_bytes
from lava_vpr.storage.writing import temporary_folder

STEPS = 100_000
"""Fewest steps of a run; queries are repeated to reach them. Source: public measurements of idle power of Loihi and
Loihi 2 run as many steps (lava-dl's tiny_yolo_sdnn benchmark; users' scripts for NxSDK)."""

TIMEOUT = 2 * 3600.0
FIGURES = ("steps", "microseconds_per_step", "milliwatts", "idle_milliwatts", "dynamic_milliwatts")


def measure(model: Model, shown: Presentations, backend: str) -> Measured:
    """Run queries on the board for at least `STEPS` steps and return what its profiler reports.

    Args:
        model: With an integer network, or a bundle for this board.
        shown: The queries.
        backend: Name of the board.
    Raises:
        LavaRunError: the board's program failed, or could measure no power; the text is the program's own.
        NetworkLimitError: the model does not fit the board.
    """
    network = checked_network(model, backend)
    interval = network.interval
    n = len(shown.rates)
    more = Presentations.joined([shown] * max(1, -(-STEPS // (interval * n))))
    with bundle_of(model, BOARDS[backend]) as bundle:
        profile = _run(bundle, more, backend)
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


def _run(bundle: ReadBundle, shown: Presentations, backend: str) -> dict[str, float]:
    """The figures that the board's program measures, by name (`FIGURES`)."""
    with temporary_folder() as folder:
        power = folder / "power.json"
        words = ("--power", power)
        ended = run_program(bundle, folder, shown.rates, shown.keys, words, patience=TIMEOUT)
        if ended.hung:
            raise LavaRunError(f"{backend}: the board's program hung and was stopped; try its --self-test", ended.log)
        if ended.code:
            said = ended.last or f"{backend}: the board's program failed without a word; try its --self-test"
            raise LavaRunError(said, ended.log)
        try:
            profile = parse_json(read_bytes(power, "text_bytes"))
            figures = {name: float(profile[name]) for name in FIGURES}
        except (OSError, ValueError, KeyError, TypeError, OverflowError) as error:
            raise LavaRunError(f"{backend}: the board's program told no power ({error}); measure again") from None
    if not all(math.isfinite(figure) for figure in figures.values()):
        raise LavaRunError(f"{backend}: the board's program told impossible figures of power; measure again")
    return figures
