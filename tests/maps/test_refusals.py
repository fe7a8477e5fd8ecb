"""Changes of a map that cannot be are refused in one line."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from support.common.small_models import encoded, paper_model, small_config, small_model

from lava_vpr import maps
from lava_vpr.errors import ConfigError, InputError, ModelFileError
from lava_vpr.model import Model
from lava_vpr.positions.frames import Positions
from lava_vpr.training.loop import train

HERE = Positions(np.arange(16.0).reshape(8, 2), "xy")


def placed() -> Model:
    """The small model, with positions."""
    return dataclasses.replace(small_model(), positions=HERE.values, frame=HERE.frame)


def bundled() -> Model:
    return dataclasses.replace(small_model(), learned=np.zeros((0, 0), np.float32))


def with_seed() -> Model:
    return train([encoded()], small_config(seed=1, learning={"epochs": 1}))


def with_threshold() -> Model:
    return train([encoded()], small_config(network={"threshold": 2.0}))


PAPER = "needs stretches that learn by themselves, but preset paper is one network for the whole route"
REFUSED: list[tuple[Any, type[Exception], str]] = [
    (
        lambda: maps.extend(bundled(), [encoded()]),
        ModelFileError,
        "extending needs what the network has learned, which a",
    ),
    (lambda: maps.remove(bundled(), [5]), ModelFileError, "removing places needs what the network has learned"),
    (lambda: maps.merge([small_model(), bundled()]), ModelFileError, "merging needs what the network has learned"),
    (lambda: maps.extend(paper_model(), [encoded(inputs=784)]), ConfigError, f"extending {PAPER}"),
    (lambda: maps.remove(paper_model(), [5]), ConfigError, f"removing places {PAPER}"),
    (lambda: maps.merge([paper_model(), small_model()]), ConfigError, f"merging {PAPER}"),
    (
        lambda: maps.extend(small_model(), [encoded(), encoded()]),
        InputError,
        "from 1 traverse, but .* in 2 traverses; give",
    ),
    (lambda: maps.extend(small_model(), [encoded(inputs=784)]), InputError, "have 784 inputs, the model 1568"),
    (lambda: maps.extend(small_model(), [encoded()], positions=HERE), InputError, "have positions and o"),
    (lambda: maps.extend(placed(), [encoded()]), InputError, "some places have positions and others have none"),
    (
        lambda: maps.extend(placed(), [encoded()], positions=Positions(np.zeros((8, 2)), "latlon")),
        InputError,
        "positions in x,y and in lat,lon cannot be compared",
    ),
    (lambda: maps.extend(small_model(), [encoded()], names=["a"]), InputError, "have names of their own"),
    (lambda: maps.merge([small_model()]), InputError, "there is nothing to merge; give two models or more"),
    (
        lambda: maps.merge([small_model(), with_seed()]),
        ConfigError,
        "model 2 was trained with seed 1, the first with 0;",
    ),
    (
        lambda: maps.merge([small_model(), with_threshold()]),
        ConfigError,
        "model 2 was trained with network.threshold 2.0",
    ),
    (
        lambda: maps.merge([small_model(), train([encoded(), encoded()], small_config())]),
        InputError,
        "model 2 was learned from 2 traverses, the first from 1 traverse; merge models of as many",
    ),
    (lambda: maps.remove(small_model(), []), InputError, "no place is named"),
    (lambda: maps.remove(small_model(), [5, 13]), InputError, "the model has no place 13; its places are 5:13"),
    (
        lambda: maps.remove(small_model(), range(5, 12)),
        InputError,
        "of 8 places 1 would be left, but a map has at least 2",
    ),
]


@pytest.mark.parametrize(("attempt", "error", "text"), REFUSED)
def test_what_cannot_be_is_refused(attempt: Any, error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=text):
        attempt()
