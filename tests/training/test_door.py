"""A training looks at what it is given before it learns: images, sizes and costs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.common.commands import fails
from support.common.small_models import encoded, small_config, small_model, tiny_paper

from lava_vpr import model
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.errors import ConfigError, InputError
from lava_vpr.recognition import count_query_spikes
from lava_vpr.storage.limits import variable
from lava_vpr.training.loop import check_size, train
from lava_vpr.training.stretches import Progress


def never(state: Progress) -> None:
    raise AssertionError("something was learned")


def nan() -> np.ndarray:
    activity = encoded().activity.copy()
    activity[3, 5] = np.nan
    return activity


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"activity": np.ones((8, 784), np.float32)}, "have 784 inputs, the model 1568"),
    ({"activity": np.ones((8, 2000), np.float32)}, "have 2000 inputs, the model 1568"),
    ({"activity": np.ones((7, 1568), np.float32)}, "activity of type float32 and shape"),
    ({"activity": np.ones(1568, np.float32)}, "activity of type float32 and shape"),
    ({"activity": np.ones((8, 1568))}, "activity of type float64"),
    ({"activity": nan()}, "activity that is not in 0"),
    ({"activity": -encoded().activity}, "activity that is not in 0"),
    ({"activity": np.full((8, 1568), np.inf, np.float32)}, "activity that is not in 0"),
    ({"indices": np.arange(7)}, "indices of type int64 and shape"),
    ({"indices": np.arange(8.0)}, "indices of type float64"),
    ({"indices": np.arange(8) - 1}, "indices below 0"),
    ({"patches": np.zeros((8, 28, 27), np.uint8)}, "patches of type uint8 and shape"),
    ({"thumbnails": np.zeros((7, 48, 64, 3), np.uint8)}, "thumbnails of type uint8 and shape"),
]


@pytest.mark.parametrize(("change", "cause"), WRONG)
def test_images_that_were_not_encoded_so_are_refused(change: dict[str, Any], cause: str) -> None:
    for references in ([replace(encoded(), **change)], [encoded(), replace(encoded(), **change)]):
        with pytest.raises(InputError, match=cause) as caught:
            train(references, small_config(), progress=never)
        assert str(caught.value).startswith(f"references of traverse {len(references)} have ")
    with pytest.raises(InputError, match=f"^queries have .*{cause.removeprefix('have ')}"):
        count_query_spikes(small_model(), replace(encoded(), **change))


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"indices": np.array([0, 1, 2, 3, 4, 5, 6, 6])}, "two references have the same index"),
        ({"names": ("a\0b", *"bcdefgh")}, r"the name 'a\\x00b' of place 0; rename"),
        ({"names": ("\ud800", *"bcdefgh")}, "of place 0; rename"),
    ],
)
def test_references_that_no_model_can_keep_are_refused(change: dict[str, Any], cause: str) -> None:
    with pytest.raises(InputError, match=cause):
        train([replace(encoded(), **change)], small_config(), progress=never)


def test_grey_levels_are_grey_levels() -> None:
    bright = replace(encoded(inputs=784), activity=np.full((8, 784), 256, np.float32))
    with pytest.raises(InputError, match=r"activity that is not in 0\.\.255"):
        train([bright], tiny_paper(), progress=never)


def test_the_route_reaches_as_far_as_its_places() -> None:
    assert small_model().route_images == 13  # places 5 to 12
    for wrong in (12, 30.0, 2**60):
        with pytest.raises(InputError, match=f"route_images is {wrong}, but there is a place 12"):
            train([encoded()], small_config(), route_images=wrong, progress=never)


COSTLY: list[tuple[Config, int, str]] = [
    (small_config(), 30_000, "a model of 30,000 places and 30,000 neurons takes .* set LAVA_VPR_MAX_MODEL_BYTES"),
    (
        small_config(network={"steps": 65_536}, encoder={"query_spikes": 1000.0}),
        2_000,
        "a query takes .* operations, .* set LAVA_VPR_MAX_PRESENTATION_OPERATIONS, or lower network.steps",
    ),
    (
        small_config(learning={"steps": 100_000, "epochs": 10_000}),
        20_000,
        "training takes .* set LAVA_VPR_MAX_TRAINING_OPERATIONS, or lower learning.epochs or learning.steps",
    ),
    (
        update(tiny_paper(), {"network": {"delay_max_ms": 100.0, "dt_ms": 0.01, "neurons": 20_000}}),
        8,
        "a query takes .* bytes, .* set LAVA_VPR_MAX_PRESENTATION_BYTES",
    ),
    (
        update(tiny_paper(), {"network": {"steps": 20_000, "neurons": 400}, "encoder": {"max_rate_hz": 1000.0}}),
        8,
        "a training presentation takes .* bytes, .* set LAVA_VPR_MAX_PRESENTATION_BYTES",
    ),
]


@pytest.mark.parametrize(("config", "places", "cause"), COSTLY)
def test_what_costs_too_much_is_refused_before_it_is_learned(config: Config, places: int, cause: str) -> None:
    with pytest.raises(ConfigError, match=cause):
        check_size(places, config)


def test_no_number_of_places_is_too_many_but_for_what_it_costs() -> None:
    for name in ("loihi", "fast"):
        assert sum(part.places for part in check_size(16_384, preset(name))) == 16_384


def test_presentations_that_are_all_silence_are_refused() -> None:
    assert check_size(1024, small_config(network={"steps": 4}))
    with pytest.raises(ConfigError, match=r"network\.steps is 4, but 1,025 neurons need 4 silent ones; raise it"):
        check_size(1025, small_config(network={"steps": 4}))
    assert check_size(1025, small_config(network={"steps": 4, "input_mode": "bias"}))


def test_what_may_be_learned_can_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The size that is seen before training is at least that of the file."""
    model.save(small_model(), tmp_path / "a.lvpr")
    monkeypatch.setenv(variable("model_bytes"), "10000")
    with pytest.raises(ConfigError) as caught:
        check_size(8, small_config())
    words = str(caught.value).replace(",", "").split()
    monkeypatch.setenv(variable("model_bytes"), words[words.index("takes") + 1])
    check_size(8, small_config())
    assert model.load(tmp_path / "a.lvpr").places == 8


def test_the_command_says_so(here: Path) -> None:
    (here / "c.toml").write_text("[network]\nsteps = 65536\nneurons = 100000\n")
    assert fails("train", "reference", "-o", "o.lvpr", "--config", "c.toml").startswith("a query takes ")
