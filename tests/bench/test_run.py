"""The stages of a benchmark: what they hand on agrees with each other."""

from __future__ import annotations

import numpy as np
import pytest
from support.boards.plans import busy_plan, trains_of

from lava_vpr.bench.modelling import step_times
from lava_vpr.deploy.boards.constants import LOIHI_1
from lava_vpr.deploy.cost.costs import modelled
from lava_vpr.deploy.cost.events import count_events


@pytest.mark.slow
def test_the_parts_of_a_step_add_up_to_its_time() -> None:
    """The picture of the steps and the table of costs say the same."""
    plan = busy_plan()
    events = count_events(plan, trains_of(plan.network, 3, 0))
    times, costs = step_times(plan, events, LOIHI_1), modelled(plan, events).figures
    assert min(times.program) > 0
    whole = np.mean(times.busiest) + np.mean(times.program) + times.barrier
    assert whole == pytest.approx(costs.step_microseconds.nominal)
