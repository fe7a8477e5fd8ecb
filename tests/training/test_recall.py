"""Recall on the built-in world, so that it is checked where no real images are at hand, and in every run of the tests.

A hundred places, learned in summer, queried in winter. The bounds stand a little below what the presets reach, 98 to
100 %, and far above what is left of it where learning or decoding is broken, which is tried, too.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lava_vpr.cluster.tasks import ONE_THREAD
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.encoding import EncodedTraverse, Keep, encode_traverse
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.model import Model
from lava_vpr.recognition import recognise
from lava_vpr.synthetic.world import write_traverses
from lava_vpr.training.loop import train
from lava_vpr.traverse import open_traverse

PLACES = 100


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The images of both journeys."""
    root = tmp_path_factory.mktemp("world")
    write_traverses(root, PLACES, 0)
    return root


@pytest.fixture(scope="module")
def journeys(world: Path) -> tuple[EncodedTraverse, EncodedTraverse]:
    """Both journeys as preset ``loihi`` encodes them."""
    return encoded(world, "loihi")


Journeys = tuple[EncodedTraverse, EncodedTraverse]


def encoded(world: Path, name: str) -> Journeys:
    """Both journeys as preset ``name`` encodes them."""
    encoder = preset(name).encoder
    summer, winter = (encode_traverse(open_traverse(world / way), encoder, Keep.ALL) for way in ("reference", "query"))
    return summer, winter


def learned(journeys: Journeys, name: str, changes: dict[str, Any] | None = None) -> Model:
    """Preset ``name``, with ``changes`` of its settings, that learned the summer."""
    return train([journeys[0]], update(preset(name), changes or {}), pool=ONE_THREAD)


def figures(model: Model, journeys: Journeys) -> dict[str, Metrics]:
    """What ``model`` and the baselines make of the winter."""
    return recognise(model, journeys[1], np.eye(PLACES, dtype=bool)).metrics


@pytest.mark.parametrize(
    ("name", "least", "without_error", "weighted"),
    [("loihi", 0.98, 0.9, 0.9), ("balanced", 0.95, 0.8, 0.9), ("fast", 0.95, 0.8, 0.85)],
)
def test_presets_recognise_the_route_in_another_season(
    name: str, least: float, without_error: float, weighted: float, world: Path
) -> None:
    journeys = encoded(world, name)
    found = figures(learned(journeys, name), journeys)
    assert found["contrast"].recall_at_1 >= least
    assert found["contrast"].recall_at_100_precision >= without_error
    assert found["contrast"].auc >= least - 0.01
    assert found["standard"].recall_at_1 >= least - 0.02
    assert found["probability"].recall_at_1 >= least - 0.02
    assert found["weighted"].recall_at_1 >= weighted
    assert found["weighted_probability"].recall_at_1 >= weighted
    # The route is no easy one: comparing pixels finds two places of three.
    assert 0.5 < found["sad"].recall_at_1 < 0.7
    assert 0.9 < found["cosine"].recall_at_1 < found["contrast"].recall_at_1 + 0.02


def test_learning_in_integers_recognises_it_too(journeys: Journeys) -> None:
    found = figures(learned(journeys, "loihi", {"learning": {"arithmetic": "integer"}}), journeys)
    assert found["contrast"].recall_at_1 >= 0.95


ALONE = {"recruit": False}
"""By themselves: the places that the phases of learning leave without a neuron stay without."""
BROKEN: dict[str, dict[str, Any]] = {
    "nothing is learned": {"learning": {"eta": 0.0, "consolidation_eta": 0.0}},
    "nobody competes": {"learning": {"eta": 0.0, **ALONE}},
    "one neuron wins everything": {"learning": {"theta_plus": 0.0, **ALONE}},
    "what all share stays": {"network": {"signed": False}},
}


@pytest.mark.parametrize("what", BROKEN)
def test_the_bounds_fail_where_learning_is_broken(what: str, journeys: Journeys) -> None:
    assert figures(learned(journeys, "loihi", BROKEN[what]), journeys)["contrast"].recall_at_1 < 0.5


@pytest.mark.quick(1)
@pytest.mark.parametrize(("what", "least"), [("nobody competes", 0.9), ("one neuron wins everything", 0.7)])
def test_recruits_learn_the_places_that_competition_leaves_out(what: str, least: float, journeys: Journeys) -> None:
    changes = {**BROKEN[what]["learning"], "recruit": True}
    recruited = learned(journeys, "loihi", {"learning": changes})
    assert figures(recruited, journeys)["contrast"].recall_at_1 > least


def test_the_bounds_fail_where_decoding_is_broken(journeys: Journeys) -> None:
    model = learned(journeys, "loihi")
    turned = replace(model, responses=np.roll(model.responses, 1, axis=1))  # each place answers for its neighbour
    found = figures(turned, journeys)
    for name in ("contrast", "standard", "weighted", "probability", "weighted_probability"):
        assert found[name].recall_at_1 < 0.1, name
