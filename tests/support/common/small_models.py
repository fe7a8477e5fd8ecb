"""Small made-up traverses, settings and models.

Used by backends, bench, benchmarks, cli, core, deploy, engine, exchange, learning, maps, matching, studies
and training.
"""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np

from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.inputs.patches import HOG_VALUES
from lava_vpr.model import Model
from lava_vpr.training.loop import train


def encoded(places: int = 8, inputs: int = 1568, seed: int = 0, noise: float = 0.0) -> EncodedTraverse:
    """Places with random activity of their own; with ``noise``, seen again under other conditions."""
    rng = np.random.default_rng(seed)
    activity = rng.random((places, inputs)) ** 6
    if noise:
        activity = activity + noise * np.random.default_rng(seed + 99).random((places, inputs)) ** 6
    if inputs == 784:  # pixels
        activity = 255 * np.minimum(activity, 1)
    return EncodedTraverse(
        names=tuple(f"img{i}.png" for i in range(places)),
        indices=np.arange(places) + 5,
        patches=rng.integers(0, 256, (places, 28, 28)).astype(np.uint8),
        activity=activity.astype(np.float32),
        thumbnails=rng.integers(0, 256, (places, 48, 64, 3)).astype(np.uint8),
        hog=rng.integers(0, 256, (places, HOG_VALUES)).astype(np.uint8),
    )


def small_config(**changes: object) -> Config:
    """The default preset, with 1568 inputs, short."""
    smaller = {"stretch": 4, "encoder": {"image_size": 56}, "learning": {"steps": 80, "epochs": 5}}
    return update(update(preset("loihi"), smaller), dict(changes))


def tiny_paper() -> Config:
    """The paper preset with few neurons and steps."""
    return update(
        preset("paper"),
        {"network": {"neurons": 12, "steps": 2000, "rest_steps": 60}, "learning": {"epochs": 3, "label_epochs": 2}},
    )


@lru_cache(maxsize=4)
def small_model(places: int = 8) -> Model:
    """A quickly trained model of two stretches."""
    return train([encoded(places)], small_config(), pool=Pool(2))


@lru_cache(maxsize=4)
def paper_model(places: int = 8) -> Model:
    """A quickly trained model of preset paper."""
    return train([encoded(places, 784)], tiny_paper())


def two_images_a_place() -> Model:
    """The small model with each place seen twice, in no order."""
    model, more = small_model(), encoded(8, seed=5)
    order = np.random.default_rng(1).permutation(16)
    return dataclasses.replace(
        model,
        labels=np.tile(np.arange(8), 2)[order],
        patches=np.concatenate([model.patches, more.patches])[order],
        activity=np.concatenate([model.activity, more.activity])[order],
        hog=np.concatenate([array for array in (model.hog, more.hog) if array is not None])[order],
    )
