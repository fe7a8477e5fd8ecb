"""Modelled times before there are queries: the reference images, asked as queries and counted as those of `bench`."""

from __future__ import annotations

import numpy as np
import pytest
from support.common.small_models import encoded, small_model

from lava_vpr.backends.interface import HostBackend, query_presentations
from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2
from lava_vpr.deploy.boards.plan import Times
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.cost import expected
from lava_vpr.deploy.cost.costs import modelled
from lava_vpr.deploy.cost.events import count_events


@pytest.mark.parametrize("most", [100, 3])
def test_times_are_those_of_the_references_as_queries(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of many references some, evenly spread; however few are counted at once."""
    monkeypatch.setattr(expected, "MOST", most)
    model = small_model()
    plan = plan_of(model, KAPOHO_BAY)
    asked = np.arange(8) if most > 8 else np.array([0, 4, 7])
    trains = HostBackend().trains(model, query_presentations(model, encoded()).part(asked))
    events = count_events(plan, trains)
    costs = modelled(plan, events).figures
    monkeypatch.setattr(expected, "_TOGETHER", 2)
    found = expected.timed(plan, model)
    assert found.times == Times(len(asked), 8, costs.step_microseconds, costs.milliseconds)
    assert found.times.activity == f"{'' if most > 8 else '3 of '}its 8 reference images, asked as queries"
    (core,) = found.cores
    program = costs.embedded["step_microseconds"].nominal
    barrier = KAPOHO_BAY.constants.barrier(1).nominal
    assert core.microseconds == pytest.approx(costs.step_microseconds.nominal - program - barrier)


def test_a_board_without_public_times_has_none() -> None:
    plan = plan_of(small_model(), LOIHI_2)
    assert expected.timed(plan, small_model()) is plan
    assert plan.times is None
