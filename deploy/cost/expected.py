"""Modelled times of a network on a board before there are queries, from its own reference images.

Spikes of references are drawn, counted and timed as `bench` does with those of queries, so equal images give equal
times.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.constants import LEVELS, Estimate, Level
from lava_vpr.deploy.boards.plan import Plan, Times
from lava_vpr.deploy.cost.closed_form import core_nanoseconds
from lava_vpr.deploy.cost.costs import all_microseconds, query_milliseconds
from lava_vpr.deploy.cost.events import count_events
from lava_vpr.engine.presentations import cores
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.engine.rates import query_rates16, spike_trains
from lava_vpr.model import Model

MOST = 100
"""Reference images that are presented, evenly spread over the route."""

_TOGETHER = 10
"""Images whose events are in memory at once; on many cores they need much of it."""


def timed(plan: Plan, model: Model) -> Plan:
    """``plan`` with modelled times, if the board's are public, from unchanged images of the first traverse.

    Args:
        plan: The plan of the network of ``model``.
        model: The model, with its references.
    """
    constants, asked = plan.board.constants, min(MOST, model.places)
    if constants is None:
        return plan
    chosen = np.linspace(0, model.places - 1, asked).round().astype(np.int64)
    rates = query_rates16(model.activity[chosen], model.config.encoder)
    keys = presentation_keys(model.config.seed, "query", image_keys(rates))
    steps: dict[Level, list[NDArray[np.float64]]] = {level: [] for level in LEVELS}
    busy = np.zeros(len(plan.cores))
    for start in range(0, asked, _TOGETHER):
        some = slice(start, start + _TOGETHER)
        events = count_events(plan, spike_trains(plan.network, rates[some], keys[some], threads=cores()))
        for level in LEVELS:
            steps[level].append(all_microseconds(plan, events, constants, level))
        busy += np.maximum(*core_nanoseconds(events, constants, "nominal")).sum(axis=(0, 1)) / 1e3
    step = Estimate.of(lambda level: float(np.concatenate(steps[level]).mean()))
    each = (busy / (asked * plan.network.interval)).tolist()
    return replace(
        plan,
        cores=tuple(replace(core, microseconds=time) for core, time in zip(plan.cores, each, strict=True)),
        times=Times(asked, model.places, step, query_milliseconds(plan, step, constants)),
    )
