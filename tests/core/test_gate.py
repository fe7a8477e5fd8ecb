"""The gate: an integer network passes as it is, the float model is refused with one text."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from support.common.small_models import encoded, small_model, tiny_paper

from lava_vpr.config import as_integer_config, integer_config, preset
from lava_vpr.errors import ConfigError
from lava_vpr.model import as_integer, integer_model
from lava_vpr.training.loop import train


@pytest.mark.parametrize("name", ["loihi", "fast"])
def test_integer_settings_pass(name: str) -> None:
    config = preset(name)
    assert integer_config(config, "a test") is config
    assert as_integer_config(config) is config


def test_an_integer_model_passes() -> None:
    model = small_model()
    assert integer_model(model, "a test") is model
    assert as_integer(model) is model


def test_the_float_model_is_refused_with_cause_and_remedy() -> None:
    text = (
        "a board needs an integer network, but preset paper is the float conductance model; train with "
        "--preset loihi, or run this one with --backend host or lava-float"
    )
    model = train([encoded(4, 784)], tiny_paper())
    for path, message in ((None, text), (Path("p.lvpr"), f"p.lvpr: {text}")):
        for ask, asked in ((integer_config, model.config), (integer_model, model)):
            with pytest.raises(ConfigError) as caught:
                ask(asked, "a board", path)  # type: ignore[operator]
            assert str(caught.value) == message
    assert as_integer_config(model.config) is None
    assert as_integer(model) is None


def test_settings_and_network_must_both_be_of_integers() -> None:
    with pytest.raises(ConfigError, match="needs an integer network"):
        integer_model(replace(small_model(), config=tiny_paper()), "a test")
