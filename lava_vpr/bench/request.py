"""What a run of `lava-vpr bench` is to find out."""

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
    """What a run is to find out.

    Attributes:
        targets: Boards to model; empty: all.
        backends: Backends to time on this machine; empty: those that are timed by default.
        sweep, peers: Whether to search settings, and to run other matchers.
        limit: Most queries that a backend is timed on; None: by backend.
        seed: The seed of the queries' noise; None: the model's.
        asking: How queries are asked besides once and plainly.
        applied: Gains uint8 (inputs,) that the model's weights were quantised under; None: none.
        calibration: Of the model's decoder; None: probabilities are not known.
        located: Where places and queries were taken; None: not known.
        near: Metres within which a match counts.
        pool: Who measures the points of the sweep.
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
        """Boards to model, each once."""
        return tuple(dict.fromkeys(self.targets)) or tuple(BOARDS)

    @property
    def timed(self) -> tuple[str, ...]:
        """Backends to time, each once."""
        return tuple(dict.fromkeys(self.backends)) or timed_by_default()

    @property
    def plain(self) -> bool:
        """Whether each query is asked once, and without biases of its own."""
        return self.asking.views == 1 and self.asking.adapt is None and self.asking.replay is None
