"""What the pictures of README and docs share: the synthetic world that they draw, colours, axes without frames."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray

matplotlib.use("Agg")
from matplotlib.axes import Axes

from lava_vpr.synthetic.world import World, render

DOCS = Path(__file__).resolve().parents[1] / "docs"
WORLD = World(seed=0, places=100, width=256, height=128)
DARK, BLUE, GREEN, GREY, LIGHT = "#111827", "#1d4ed8", "#15803d", "#6b7280", "#9ca3af"


def target(name: str, what: str) -> Path:
    """The file that the command names, by default one of docs."""
    parser = argparse.ArgumentParser(description=what)
    parser.add_argument("file", type=Path, nargs="?", default=DOCS / name)
    file: Path = parser.parse_args().file
    return file


def summer() -> NDArray[np.uint8]:
    """The references, uint8 (places, h, w, 3) BGR."""
    return np.stack([render(WORLD, place, "summer") for place in range(WORLD.places)])


def show(axes: Axes, image: NDArray[np.uint8], **options: str) -> None:
    """An image, uint8 (h, w, 3) BGR, without ticks."""
    axes.imshow(image[..., ::-1], **options)  # type: ignore[arg-type]
    axes.set(xticks=[], yticks=[])


def bare(axes: Mapping[str, Axes], names: Iterable[str]) -> None:
    """Plots without the upper and the right line of their frames."""
    for name in names:
        axes[name].spines[["top", "right"]].set_visible(False)
