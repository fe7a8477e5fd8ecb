"""The options of a run of `lava-vpr bench`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.asking import PLAINLY, Asking
from lava_vpr.backends.registry import timed_by_default
from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.matching.probability import Calibration
from lava_vpr.truth.alignment import NEAR_M, Located

Begin = Callable[[str, int], Callable[[int], None]]
"""A function called with what begins and in how many parts, which returns a function called with the parts done."""


@dataclass(frozen=True)
class Request:
    """The options of a run: what to time, model and compare.

    Attributes:
        targets: Boards to model; empty: all.
        backends: Backends to time on this machine; empty: those that are timed by default.
        sweep, peers: Whether to search settings, and whether to run other matchers.
        limit: Most queries that a backend is timed on; None: by backend.
        seed: The seed of the queries' noise; None: the model's.
        asking: How queries are presented: views, adaptation, gains.
        applied: Gains uint8 (inputs,) with which the model's weights were quantised; None: none.
        calibration: Calibration of the model's decoder; None: probabilities are unknown.
        located: Positions of places and queries; None: unknown.
        near: Metres within which a match counts.
        pool: The pool that measures the points of the sweep.
    """

    targets: tuple[str, ...] = ()
    backends: tuple[str, ...] = ()
    sweep: bool = False
    peers: bool = False
    limit: int | None = None
    seed: int | None = None
    asking: Asking = PLAINLY
    applied: NDArray[np.uint8] | None = field(default=None, repr=False)
    calibration: Calibration | None = None
    located: Located | None = None
    near: float = NEAR_M
    pool: Pool = ONE_THREAD

    @property
    def boards(self) -> tuple[str, ...]:
        """The boards to model, without repeats."""
        return tuple(dict.fromkeys(self.targets)) or tuple(BOARDS)

    @property
    def timed(self) -> tuple[str, ...]:
        """The backends to time, without repeats."""
        return tuple(dict.fromkeys(self.backends)) or timed_by_default()

    @property
    def plain(self) -> bool:
        """Whether each query is one presentation with the network's own biases."""
        return self.asking.views == 1 and self.asking.adapt is None and self.asking.replay is None
