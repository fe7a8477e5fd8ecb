"""The example of LENS as sensors of other sizes would have counted it: frames of 10 to 100 pixels a side.

LAVA_VPR_DATA=... python -m benchmarks events.sizes [--record]
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from benchmarks.events.lens import ALL, EVENTS, SEEDS, LearningWay, drive, truth
from benchmarks.places import recognised
from benchmarks.program import BenchmarkTable, Printed, fraction, program
from lava_vpr import train
from lava_vpr.learning.behind import compared
from lava_vpr.recognition import Comparison
from lava_vpr.storage.writing import temporary_folder
from lava_vpr.traverse import Traverse, open_traverse

SIDES = (10, 14, 20, 30, 40, 60, 80, 100)
RIVALS = {"template": "template", "cosine": "cosine", "SAD": "sad"}


COLUMNS = (
    *("pixels a side", "R@1", "R@100P", *RIVALS),
    *("altered: network", "its templates", "their cosine", "`train` says so"),
)


def resized(folder: Path, which: str, side: int) -> Traverse:
    """A drive in frames of ``side`` pixels: each pixel sums the events of the pixels that it replaces, at most 255."""
    folder.mkdir()
    for k, image in enumerate(drive(which, ALL, LearningWay(EVENTS)).images()):
        counts = cv2.resize(image.astype(np.float32), (side, side), interpolation=cv2.INTER_AREA)
        together = max(1.0, len(image) / side) ** 2
        cv2.imwrite(str(folder / f"{k:04}.png"), np.rint(counts * together).clip(0, 255).astype(np.uint8))
    return open_traverse(folder)


def cells(folder: Path, side: int) -> list[str]:
    """A row: R@1 and R@100P of the default, the mean over seeds, and R@1 of simpler matchers, of the last seed; which
    shares of altered references network, templates and cosine find, means over seeds, and in how many `train` tells."""
    pair = [resized(folder / f"{which}_{side}", which, side) for which in ("reference", "query")]
    comparison = Comparison(rivals=tuple(RIVALS.values()), keep_scores=False)
    results = recognised(EVENTS, *pair, truth(ALL), SEEDS, comparison)
    ours = [result.metrics[result.default] for result in results]
    means = np.mean([(one.recall_at_1, one.recall_at_100_precision) for one in ours], axis=0)
    rivals = (results[-1].metrics[name].recall_at_1 for name in RIVALS.values())
    models = (train(str(folder / f"reference_{side}"), config=EVENTS, seed=seed) for seed in SEEDS)
    asked = [found for model in models if (found := compared(model)) is not None]
    shares = np.mean([np.mean(found, axis=1) for found in asked], axis=0)
    told = sum(found.said is not None for found in asked)
    return [str(side), *(fraction(float(value)) for value in (*means, *rivals, *shares)), f"{told} of {len(asked)}"]


@program("lens_example")
def main() -> Printed:
    """Recall at each size, by the settings that were chosen at 80 pixels, beside simpler matchers in the same views."""
    with temporary_folder() as folder:
        rows = [cells(folder, side) for side in SIDES]
    yield BenchmarkTable(COLUMNS, rows, record="event-sizes")
