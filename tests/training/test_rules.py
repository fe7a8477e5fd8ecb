"""Ways to learn are rows: the trainer, the settings that choose it, and what the command says of it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from support.common.small_models import encoded, small_config, tiny_paper

from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.training.loop import train
from lava_vpr.training.trainers import CONDUCTANCE, LEARNING, TemplateTrainer, rule_of, rule_settings


@pytest.mark.parametrize("name", LEARNING)
def test_the_settings_of_a_rule_choose_it(name: str) -> None:
    for before in LEARNING:  # whatever was chosen before
        config = update(preset("loihi"), {"learning": rule_settings(before, preset("loihi"))})
        assert rule_of(update(config, {"learning": rule_settings(name, config)})) is LEARNING[name]


def test_the_conductance_model_has_a_way_of_its_own() -> None:
    assert rule_of(tiny_paper()) is CONDUCTANCE
    assert rule_settings("float", tiny_paper()) == {"arithmetic": "float"}


def test_a_rule_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []

    class Counting(TemplateTrainer):
        def begin_epoch(self, epoch: int) -> None:
            seen.append(epoch)

    row = replace(
        LEARNING["template"], name="counting", trainer=lambda config, stretch, key, _: Counting(config, stretch)
    )
    LEARNING.register(row)
    try:
        monkeypatch.setattr("lava_vpr.training.stretches.rule_of", lambda config: LEARNING["counting"])
        made = train([encoded()], small_config(learning={"epochs": 2}))
    finally:
        LEARNING.remove("counting")
    assert seen == [0, 1, 0, 1]  # two stretches
    assert made.places == 8
