"""Vectors of 4,096 values, reduced to what fits: learned, deployed to both targets, verified on every backend.

    LAVA_VPR_DATA=... python -m benchmarks.descriptors.long [--queries 3]

The vectors are dense histograms of oriented gradients of the grey image at 64 x 64 pixels, cells of 4 x 4, 16
directions, normalised in blocks of 2 x 2 cells: made of real images, summer and winter of Nordland's first 100 places.
All that follows is what a user does, command by command, with what each prints.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.nordland import images_of, required
from lava_vpr.errors import LavaVprError
from lava_vpr.inputs.patches import grey
from lava_vpr.storage.temporary import temporary_folder
from lava_vpr.traverse import open_traverse

SIDE, CELL, DIRECTIONS, PLACES = 64, 4, 16, 100
VALUES = (SIDE // CELL) ** 2 * DIRECTIONS


def dense(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Histograms of oriented gradients of an image, float32 (4096,)."""
    block = (2 * CELL, 2 * CELL)
    made = cv2.HOGDescriptor((SIDE, SIDE), block, block, (CELL, CELL), DIRECTIONS)
    return np.asarray(made.compute(grey(image, SIDE, cv2.INTER_LINEAR)), np.float32).ravel()


def command(folder: Path, *words: str) -> None:
    """Run a command of lava-vpr in ``folder``, and show it with what it prints."""
    print(f"\n$ lava-vpr {' '.join(words)}", flush=True)
    done = subprocess.run([sys.executable, "-m", "lava_vpr", *words], cwd=folder, check=False)
    if done.returncode:
        raise SystemExit(f"error: lava-vpr {words[0]} ended with {done.returncode}")


@click.command()
@click.option(
    "--queries", type=click.IntRange(1, PLACES), default=3, show_default=True, help="Queries that are verified."
)
def main(queries: int) -> None:
    """Make the vectors, and run the commands."""
    required("nordland")
    try:
        with temporary_folder() as folder:
            for season in ("summer", "winter"):
                images = open_traverse(images_of("nordland", season), places=(0, PLACES)).images()
                vectors = np.stack([dense(image) for image in images])
                assert vectors.shape == (PLACES, VALUES)
                np.save(folder / f"{season}.npy", vectors)
            command(folder, "train", "summer.npy", "-o", "route.lvpr")
            command(folder, "eval", "route.lvpr", "winter.npy")
            for target in ("kapoho-bay", "loihi2"):
                command(folder, "deploy", "route.lvpr", "--target", target, "-o", target, "--calibrate", "winter.npy")
                command(folder, "eval", target, "winter.npy", "--baseline", "vectors")
            for model in ("route.lvpr", "kapoho-bay", "loihi2"):
                command(folder, "verify", model, "winter.npy", "--limit", str(queries))
    except LavaVprError as error:
        raise SystemExit(f"error: {error}") from None


if __name__ == "__main__":
    main()
