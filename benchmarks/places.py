"""Places of real images that benchmarks and long tests use, encoded once, and models that learned them."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, EncoderConfig
from lava_vpr.encoding import EncodedTraverse, Keep, encode_traverse, encode_views
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import InputError
from lava_vpr.experiments.grid import compute
from lava_vpr.inputs.views import ViewsConfig
from lava_vpr.learning.references import encode_route
from lava_vpr.model import Model
from lava_vpr.recognition import Comparison, Recognition, recognise
from lava_vpr.training.loop import train
from lava_vpr.traverse import Traverse, open_traverse

ALL_CORES = Pool(cores())
"""Runs tasks on all cores of this machine."""
FOLDERS = {
    "nordland": ("summer", "winter"),
    "nordland_long": ("summer", "winter"),
    "gardens": ("reference", "query"),
    "lens_example": ("reference", "query"),
}
"""Folders of references and queries by dataset."""
SECTIONS = tuple((start, start + 100) for start in range(0, 500, 100))


def near(queries: int, tolerance: int = 0) -> NDArray[np.bool_]:
    """The truth where query i shows place i, bool (queries, queries)."""
    index = np.arange(queries)
    return np.abs(index[:, None] - index) <= tolerance


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


@lru_cache(maxsize=8)
def encoded(season: str, encoder: EncoderConfig) -> EncodedTraverse:
    """All 500 images of a season of Nordland: references are summer, queries winter."""
    return encode_traverse(open_traverse(images_of("nordland", season)), encoder, Keep.ALL)


@lru_cache(maxsize=16)
def learn(places: tuple[int, int], config: Config) -> Model:
    """A model of the summer images ``places``; equal arguments share it, so nobody may write to it."""
    return train([encoded("summer", config.encoder).take(slice(*places))], config, route_images=500, pool=ALL_CORES)


def answer(model: Model, places: tuple[int, int], backend: str = "host", **comparison: Any) -> Recognition:
    """What ``model`` makes of the winter images ``places``; ``comparison`` holds fields of `Comparison`."""
    queries = encoded("winter", model.config.encoder).take(slice(*places))
    truth = np.eye(len(queries), dtype=bool)
    return recognise(model, queries, truth, Comparison(**comparison), backend=backend, pool=ALL_CORES)


TEMPLATES = {"rule": "template", "epochs": 1}

Views = tuple[EncodedTraverse, ...]


class PlacesSection(NamedTuple):
    """Some places of a dataset; ``nordland_all`` is one list of both parts of the journey."""

    dataset: str
    first: int
    end: int

    def __str__(self) -> str:
        return f"{self.dataset} {self.first}:{self.end}"


def sections_of(dataset: str, end: int) -> tuple[PlacesSection, ...]:
    """Sections of 100 places."""
    return tuple(PlacesSection(dataset, first, first + 100) for first in range(0, end, 100))


@lru_cache(maxsize=24)
def _images(dataset: str, which: int, encoder: EncoderConfig, views: ViewsConfig) -> Views:
    """References (0) or queries (1) of a dataset in each view, all that settings of queries leave as it is."""
    images = open_traverse(images_of(dataset, FOLDERS[dataset][which]))
    return encode_views(images, encoder, views.views, Keep.ALL)


def _of_pixels(encoder: EncoderConfig) -> EncoderConfig:
    """The settings that activity depends on, the others at their defaults: images are read once for all of these."""
    default = EncoderConfig()
    return dataclasses.replace(
        encoder,
        query_inputs=default.query_inputs,
        query_spikes=default.query_spikes,
        train_spikes=default.train_spikes,
        read_threshold=default.read_threshold,
        read_inhibition=default.read_inhibition,
    )


def places(section: PlacesSection, which: int, config: Config, views: ViewsConfig | None = None) -> Views:
    """References (0) or queries (1) of a section in each view.

    Raises:
        InputError: LAVA_VPR_DATA does not name them.
    """
    dataset, first, end = section
    views, encoder = config.views if views is None else views, _of_pixels(config.encoder)
    if dataset != "nordland_all":
        return tuple(view.take(slice(first, end)) for view in _images(dataset, which, encoder, views))
    pairs = zip(*(_images(name, which, encoder, views) for name in ("nordland", "nordland_long")), strict=True)
    return tuple(_joined(*pair).take(slice(first, end)) for pair in pairs)


def _joined(one: EncodedTraverse, two: EncodedTraverse) -> EncodedTraverse:
    """Two traverses, one behind the other."""
    return EncodedTraverse(
        one.names + tuple(f"long-{name}" for name in two.names),
        np.concatenate([one.indices, two.indices + len(one)]),
        np.concatenate([one.activity, two.activity]),
        np.concatenate([one.kept(Keep.PATCHES, "a list"), two.kept(Keep.PATCHES, "a list")]),
        np.concatenate([one.kept(Keep.THUMBNAILS, "a list"), two.kept(Keep.THUMBNAILS, "a list")]),
        np.concatenate([one.kept(Keep.HOG, "a list"), two.kept(Keep.HOG, "a list")]),
    )


def recognised(
    config: Config,
    references: Traverse,
    queries: Traverse,
    truth: NDArray[np.bool_],
    seeds: Sequence[int],
    comparison: Comparison,
) -> list[Recognition]:
    """What models of each seed make of queries; vectors are fitted on the references, images seen in the views."""
    config, standard, learned = encode_route([references], config)
    asked = encode_traverse(queries, config.encoder, Keep.ALL, standard=standard)

    def of_seed(shared: None, seed: int) -> Recognition:
        model = train(learned, dataclasses.replace(config, seed=seed), standard=standard, pool=ALL_CORES)
        return recognise(model, asked, truth, comparison, pool=ALL_CORES)

    return list(compute(of_seed, seeds).values())


def learned(section: PlacesSection, config: Config, which: int = 0) -> Model:
    """A model of a section, from its references, or in the other season, from its queries."""
    return train(places(section, which, config), config, pool=ALL_CORES)
