"""The real images that benchmarks and long tests use, encoded once, and models that learned them."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, EncoderConfig
from lava_vpr.encoding import EncodedTraverse, Keep, encode_traverse
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import InputError
from lava_vpr.model import Model
from lava_vpr.recognition import Comparison, Recognition, recognise
from lava_vpr.training.loop import train
from lava_vpr.traverse import open_traverse

FOLDERS = {
    "nordland": ("summer", "winter"),
    "nordland_long": ("summer", "winter"),
    "gardens": ("reference", "query"),
    "lens_example": ("reference", "query"),
}
"""Folders of references and queries by dataset."""
SECTIONS = tuple((start, start + 100) for start in range(0, 500, 100))


def images_of(dataset: str, name: str) -> Path:
    """A folder of images of a dataset.

    Raises:
        InputError: LAVA_VPR_DATA does not name it.
    """
    root = Path(os.environ.get("LAVA_VPR_DATA", "")) / "data" / dataset / name
    if not os.environ.get("LAVA_VPR_DATA") or not root.is_dir():
        raise InputError(f"{root}: no images; set LAVA_VPR_DATA to the folder that holds data/{dataset}/{name}")
    return root


def required(*datasets: str) -> None:
    """End the program with one line, before it does any work, unless all images of ``datasets`` are there."""
    try:
        for dataset in datasets:
            for name in FOLDERS[dataset]:
                images_of(dataset, name)
    except InputError as error:
        raise SystemExit(f"error: {error}") from None


def folder(season: str) -> Path:
    """The images of one season of Nordland (reference summer, query winter); errors as `images_of`."""
    return images_of("nordland", season)


@lru_cache(maxsize=8)
def encoded(season: str, encoder: EncoderConfig) -> EncodedTraverse:
    """All 500 images of a season."""
    return encode_traverse(open_traverse(folder(season)), encoder, Keep.ALL)


def part(traverse: EncodedTraverse, chosen: slice | NDArray[np.int64]) -> EncodedTraverse:
    """Some images of an encoded traverse, with their absolute indices."""
    return traverse.take(chosen)


def learn(places: tuple[int, int], config: Config) -> Model:
    """A model of the summer images ``places``."""
    return train(
        [part(encoded("summer", config.encoder), slice(*places))], config, route_images=500, pool=Pool(cores())
    )


def answer(model: Model, places: tuple[int, int], backend: str = "host", **comparison: Any) -> Recognition:
    """What ``model`` makes of the winter images ``places``; ``comparison`` holds fields of `Comparison`."""
    queries = part(encoded("winter", model.config.encoder), slice(*places))
    truth = np.eye(len(queries), dtype=bool)
    return recognise(model, queries, truth, Comparison(**comparison), backend=backend, pool=Pool(cores()))
