"""Vectors of 4,096 values, reduced to what fits: learned, deployed to both targets, verified on every backend.

    LAVA_VPR_DATA=... python -m benchmarks commands.long_descriptors [--queries 3]

The vectors are dense histograms of oriented gradients of the grey image at 64 x 64 pixels, cells of 4 x 4, 16
directions, normalised in blocks of 2 x 2 cells: made of real images, summer and winter of Nordland's first 100 places.
All that follows is what a user does, command by command, with what each prints.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.commands.running import PROGRAM
from benchmarks.places import images_of
from benchmarks.program import Printed, program
from lava_vpr.inputs.patches import grey
from lava_vpr.storage.writing import temporary_folder
from lava_vpr.traverse import open_traverse

SIDE, CELL, DIRECTIONS, PLACES = 64, 4, 16, 100


def dense(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Histograms of oriented gradients of an image, float32 (4096,)."""
    block = (2 * CELL, 2 * CELL)
    made = cv2.HOGDescriptor((SIDE, SIDE), block, block, (CELL, CELL), DIRECTIONS)
    return np.asarray(made.compute(grey(image, SIDE, cv2.INTER_LINEAR)), np.float32).ravel()


def commands(queries: int) -> Iterator[list[str]]:
    """All that a user does with the vectors."""
    yield ["train", "summer.npy", "-o", "route.lvpr"]
    yield ["eval", "route.lvpr", "winter.npy"]
    for target in ("kapoho-bay", "loihi2"):
        yield ["deploy", "route.lvpr", "--target", target, "-o", target, "--calibrate", "winter.npy"]
        yield ["eval", target, "winter.npy", "--baseline", "vectors"]
    for model in ("route.lvpr", "kapoho-bay", "loihi2"):
        yield ["verify", model, "winter.npy", "--limit", str(queries)]


@program("nordland")
@click.option("--queries", type=click.IntRange(1, PLACES), default=3, show_default=True, help="Queries to verify.")
def main(queries: int) -> Printed:
    """Make the vectors, and run the commands."""
    with temporary_folder() as folder:
        for season in ("summer", "winter"):
            images = open_traverse(images_of("nordland", season), places=(0, PLACES)).images()
            np.save(folder / f"{season}.npy", np.stack([dense(image) for image in images]))
        for words in commands(queries):
            yield f"\n$ lava-vpr {' '.join(words)}"
            if code := subprocess.run([*PROGRAM, *words], cwd=folder, check=False).returncode:
                raise SystemExit(f"error: lava-vpr {words[0]} ended with {code}")
