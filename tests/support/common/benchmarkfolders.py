"""Drawn images in the folders of the benchmark datasets, and rows of these with short sections.

Used by cli, images and paper_table.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lava_vpr.datasets.layouts import DATASETS, DatasetLayout
from lava_vpr.synthetic.world import World, render

LOOKS = ("summer", "rain", "winter")
"""Conditions of the traverses, the query's last."""
PACES = (0.5, 0.25, 0.4)
"""Places from one image to the next of traverses that differ in speed."""


@contextmanager
def short_sections(places: int) -> Iterator[None]:
    """All datasets with sections of so few places."""
    rows = list(DATASETS.values())
    try:
        for row in rows:
            DATASETS.remove(row.name)
            DATASETS.register(replace(row, places=places))
        yield
    finally:
        for row in rows:
            DATASETS.remove(row.name)
            DATASETS.register(row)


@lru_cache(maxsize=512)
def place(number: int, look: str) -> Any:
    """The image of a place, uint8 (48, 64, 3)."""
    return render(World(seed=3, places=64, width=64, height=48), number, look)


def layout_of(name: str, first: str) -> DatasetLayout:
    """The layout of a dataset whose first traverse is so called."""
    return next(layout for layout in DATASETS[name].layouts if layout.folders[0] == first)


def folder_of(root: Path, traverse: str, images: int) -> Path:
    """Where so many images of a traverse stand; if it is a list, it is written, and names them: 0.png, 1.png and on."""
    if not traverse.endswith(".txt"):
        return root / traverse
    folder = Path("images", Path(traverse).stem)
    (root / traverse).write_text("".join(f"./{folder}/{k}.png\n" for k in range(images)))
    return root / folder


def draw(root: Path, layout: DatasetLayout, places: int) -> list[Path]:
    """A dataset of ``places`` places; the tables of positions, one a traverse, if its order tells nothing.

    Images that sampling leaves out are blank; those of a list stand in a folder of their own. Positions are metres
    along a straight road, the layout's spacing (or 10) from place to place.
    """
    looks = [*LOOKS[: len(layout.references)], LOOKS[-1]]
    tables = []
    root.mkdir(parents=True, exist_ok=True)
    for number, (folder, look) in enumerate(zip(layout.folders, looks, strict=True)):
        if layout.ground_truth == "frames":
            shown = [None if k % layout.step else k // layout.step for k in range(places * layout.step)]
        else:
            pace = PACES[number if number < len(layout.references) else -1]
            along = np.arange(0, places - 0.5, pace if layout.step == 1 else 2 * pace / layout.step)
            shown = [round(float(at)) for at in along]
            tables.append(root / f"{number}.csv")
            metres = along * (layout.spacing or 10.0)
            with tables[-1].open("w", newline="") as file:
                csv.writer(file).writerows([("x", "y"), *((f"{at:.2f}", "0") for at in metres)])
        own = folder_of(root, folder, len(shown))
        own.mkdir(parents=True)
        for k, which in enumerate(shown):
            blank = np.full((48, 64, 3), 99, np.uint8)
            cv2.imwrite(str(own / f"{k}.png"), blank if which is None else place(which, look))
    return tables
