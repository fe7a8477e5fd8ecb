"""Small made-up traverses and models for tests."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.encoding import EncodedTraverse
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
    )


def small_config(**changes: object) -> Config:
    """The default preset, short."""
    base = update(preset("loihi"), {"stretch": 4, "network": {"steps": 60}, "learning": {"steps": 80, "epochs": 5}})
    return update(base, dict(changes))


def tiny_paper() -> Config:
    """The paper preset with few neurons and steps."""
    return update(
        preset("paper"),
        {"network": {"neurons": 12, "steps": 2000, "rest_steps": 60}, "learning": {"epochs": 3, "label_epochs": 2}},
    )


@lru_cache(maxsize=4)
def small_model(places: int = 8) -> Model:
    """A quickly trained model of two stretches."""
    return train([encoded(places)], small_config(), jobs=2)


def two_images_a_place() -> Model:
    """The small model with each place seen twice, in no order."""
    model, more = small_model(), encoded(8, seed=5)
    order = np.random.default_rng(1).permutation(16)
    return dataclasses.replace(
        model,
        labels=np.tile(np.arange(8), 2)[order],
        patches=np.concatenate([model.patches, more.patches])[order],
        activity=np.concatenate([model.activity, more.activity])[order],
    )


def write_images(folder: Path, n: int = 6, seed: int = 0, shape: tuple[int, int] = (24, 48)) -> Path:
    """``n`` blocky colour images, img0.png on."""
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(n):
        cv2.imwrite(str(folder / f"img{i}.png"), picture(1000 * seed + i, shape))
    return folder


def picture(seed: int, shape: tuple[int, int] = (24, 48)) -> NDArray[np.uint8]:
    """One blocky colour image."""
    small = np.random.default_rng(seed).integers(0, 256, (6, 9, 3)).astype(np.uint8)
    return np.asarray(cv2.resize(small, shape[::-1], interpolation=cv2.INTER_NEAREST))
