"""Made-up data of a report.

Used by report.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config
from lava_vpr.configfile import to_toml
from lava_vpr.inputs.encoder import INPUTS, ChannelLayout
from lava_vpr.inputs.orientation import orientation_channels
from lava_vpr.matching.evaluation import evaluate
from lava_vpr.report.data import Raster, ReportData

WRONG, REJECTED = 5, 9
# For tests that look at words: drawing takes most of the time.
WORDS: dict[str, Any] = {"matrices": {}, "rasters": ()}
ALONG = np.linspace(0, 1, 12)
BEND = np.stack([3000 * ALONG, 400 * np.sin(5 * ALONG)], axis=1)
"""A road that bends, float64 (12, 2) in metres."""


def thumbnails(n: int, height: int = 24, width: int = 40) -> NDArray[np.uint8]:
    """Images of a horizon, a sun and a track that move with the place."""
    y, x = np.mgrid[:height, :width]
    images = np.zeros((n, height, width, 3), np.uint8)
    for i in range(n):
        horizon = height * (0.3 + 0.25 * math.sin(i / 3))
        images[i, ..., 0] = np.where(y < horizon, 210, 60)
        images[i, ..., 1] = np.where(y < horizon, 190, 110)
        sun = (y - 5) ** 2 + (x - (7 * i) % width) ** 2 < 12
        track = (np.abs(x - width / 2) < (y - horizon) * 0.6) & (y > horizon)
        images[i, ..., 2] = np.where(sun, 255, np.where(track, 120, 40))
    return images


def example(n: int = 12, kind: str = "orientation", **changes: Any) -> ReportData:
    """A report over ``n`` places; query 5 is wrong and query 9 unanswered."""
    rng = np.random.default_rng(7)
    images, truth = thumbnails(n), np.eye(n, dtype=np.bool_)
    scores = rng.uniform(0, 4, (n, n)) + 8 * truth
    if n > REJECTED:
        scores[WRONG, 2], scores[REJECTED] = 14.0, 0.0
    matches = np.where(scores.any(axis=1), scores.argmax(axis=1), -1)
    ranked = np.sort(np.pad(scores, ((0, 0), (1, 0))), axis=1)
    confidence = ranked[:, -1] - ranked[:, -2]
    sad = -rng.uniform(10, 60, (n, n)) + 20 * truth
    matrices = {"contrast": scores, "sad": sad, "cosine": 1 + sad / 80}
    metrics = {name: evaluate(s, s.max(axis=1), truth) for name, s in (*matrices.items(), ("weighted", scores))}
    channels, grid = {"orientation": (4, 7), "onoff": (2, 28), "pixels": (1, 28)}[kind]
    if kind == "orientation":
        weights = np.stack([orientation_channels(i, side=28, orientations=4) for i in images], axis=1)
    else:
        weights = rng.integers(0, 8, (channels * grid * grid, n)).astype(np.float64)
    shown = [q for q in (0, 1, WRONG, REJECTED) if q < n]
    rasters = tuple(
        Raster(q, int(matches[q]), q, 103, n, rng.integers(0, 103, 60), rng.integers(0, n, 60), 600 + q) for q in shown
    )
    data = ReportData(
        title="Synthetic world, noon to dusk",
        command="lava-vpr eval world.lvpr query/ --baseline sad --baseline cosine",
        summary={"neurons": str(n), "weight bits": "3", "steps": "100"},
        default_decoder="contrast",
        metrics=metrics,
        matrices=matrices,
        truth=truth,
        matches=matches,
        confidence=confidence,
        place_names=tuple(f"r{i:03}.png" for i in range(n)),
        query_names=tuple(f"q{i:03}.png" for i in range(n)),
        place_numbers=tuple(range(n)),
        query_numbers=tuple(range(n)),
        place_thumbnails=images,
        query_thumbnails=255 - images,
        input_layout=ChannelLayout(channels, grid),
        drawing=INPUTS[kind].drawing,
        legend=INPUTS[kind].legend,
        weights=weights,
        neuron_places=np.arange(n)[::-1].copy(),
        rasters=rasters,
        events={"synaptic_operations": 88012, "exc_spikes": 41.25, "messages": 4250},
        config_toml=to_toml(Config()),
    )
    return dataclasses.replace(data, **changes)
