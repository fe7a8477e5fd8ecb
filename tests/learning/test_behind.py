"""What is said of a network that learned less than its own references would have given it."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest
from support.common.small_models import paper_model, small_model

from lava_vpr import train
from lava_vpr.cluster.tasks import ONE_THREAD
from lava_vpr.configfile import update
from lava_vpr.engine.rates import query_rates
from lava_vpr.errors import ConfigError
from lava_vpr.learning import behind as asking, route
from lava_vpr.learning.behind import Compared, compared
from lava_vpr.maps.changes import join, part_of
from lava_vpr.matching.probability import OFF_MAP, RIGHT
from lava_vpr.model import IntegerModel, Model
from lava_vpr.training.measuring import altered, measured
from lava_vpr.training.templates import template_of


def confused(**network: object) -> IntegerModel:
    """The small model with other settings, all of whose neurons have learned what one of the first two has."""
    model = replace(small_model(), config=update(small_model().config, {"network": network}))
    part = part_of(model, "a test")
    learned = np.tile(part.learned[:, :2], model.neurons // 2)
    return join((part._replace(learned=learned),), model.config, ONE_THREAD, same_traverse=True)


def said(model: Model) -> str | None:
    """What training says of a model."""
    found = compared(model)
    return None if found is None else found.said


def finds(model: IntegerModel) -> int:
    """How many altered references of two repetitions a network finds."""
    kinds = measured(model).samples[:, 1]
    return int((kinds[kinds != OFF_MAP] == RIGHT)[: 2 * model.places].sum())


def test_a_network_that_finds_fewer_than_its_templates_is_told_with_the_counts_of_all_three() -> None:
    model, places = confused(), np.arange(8)
    likest = 0
    for repeat in range(2):
        shown = replace(model, activity=altered(model.activity, places, model.config.seed, repeat))
        rates, known = (query_rates(one.activity, model.config).astype(float) for one in (shown, model))
        cosines = rates @ known.T / np.linalg.norm(rates, axis=1)[:, None] / np.linalg.norm(known, axis=1)
        likest += int((cosines.argmax(axis=1) == places).sum())
    own, template = finds(model), finds(template_of(model))
    assert own < template
    assert said(model) == (
        f"the learned network finds {own} of 16 altered references, its templates {template}, the cosine of its inputs "
        f"{likest}: --learning template may serve better here"
    )


def test_where_templates_find_no_more_the_remedy_is_another() -> None:
    assert said(confused(threshold=100.0)) == (
        "the learned network finds 0 of 16 altered references, its templates 0, the cosine of its inputs 16: compare "
        "them by lava-vpr eval here"
    )


def test_a_network_that_is_not_behind_and_one_of_floats_are_not_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    assert said(small_model()) is None
    assert said(paper_model()) is None

    def dear(*_: object) -> None:
        raise ConfigError("too many neurons")

    monkeypatch.setattr(asking, "template_of", dear)
    assert said(confused()) is None


def test_of_a_long_map_the_first_places_are_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(asking, "PLACES", 7)
    assert "of 14 altered references, its templates 14, the cosine of its inputs 14" in str(said(confused()))


def test_training_tells_of_it(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    none, all_ = np.zeros(40, bool), np.ones(40, bool)
    monkeypatch.setattr(route, "compared", lambda model, pool: Compared(none, all_, all_))
    with caplog.at_level(logging.WARNING, "lava_vpr"):
        train(rates=np.eye(4), learning="template", threads=1)
    assert [message.split(":")[0] for message in caplog.messages] == [
        "the learned network finds 0 of 40 altered references, its templates 40, the cosine of its inputs 40"
    ]
