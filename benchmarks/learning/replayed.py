"""Queries under gains, as others than the host are shown them: presented as a gain table says."""

from __future__ import annotations

import numpy as np

from benchmarks.places import ALL_CORES
from lava_vpr.backends.answering import in_turn
from lava_vpr.backends.asking import Asker, Asking, calibration_of
from lava_vpr.backends.interface import HostBackend, Presentations
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.gains import FULL
from lava_vpr.matching.answers import Together
from lava_vpr.matching.forward_filter import NONE
from lava_vpr.model import Model, integer_model
from lava_vpr.season.table import GainTable


def gained(model: Model, drive: EncodedTraverse, count: int) -> Presentations:
    """Queries of a drive, presented as ``query --learn`` does: each was answered before it could teach, what it was
    presented with stands in a gain table, and is replayed from there.

    Args:
        model: A model with signed weights.
        drive: All queries of the drive, in order.
        count: How many of those whose gains are no longer all full are returned, spread evenly.
    """
    asking = Asking(tracked_adapt=True, learn=True).tracking(model, NONE)
    together = Together(calibration=calibration_of(model, ALL_CORES))
    turns = in_turn(model, Asker(model, asking), [(drive,)], HostBackend(ALL_CORES), together)
    table = GainTable.of(integer_model(model, "--learn"), [turn.used for turn in turns if turn.used is not None])
    under = np.flatnonzero((table.gains[table.epoch] < FULL).any(axis=1))
    chosen = under[np.linspace(0, len(under) - 1, count).astype(np.int64)]
    return Asker(model, Asking(replay=table)).presentations((drive,)).part(chosen)
