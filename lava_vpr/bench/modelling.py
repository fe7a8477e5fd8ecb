"""Modelled costs of a query on the boards: plans, counted events, energies and times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lava_vpr.bench.results import Modelled, StepTimes
from lava_vpr.deploy.boards.board import BOARDS, Board
from lava_vpr.deploy.boards.constants import HOST_POWER, Constant, CostConstants
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.cost import embedded
from lava_vpr.deploy.cost.closed_form import step_nanoseconds
from lava_vpr.deploy.cost.costs import modelled
from lava_vpr.deploy.cost.events import EventCounts, count_events
from lava_vpr.engine.presentations import Trains
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.model import Model, as_integer


def plans_of(model: Model, targets: tuple[str, ...]) -> dict[str, Plan | str]:
    """The network's plan for each board, or the reason why it does not fit."""
    plans: dict[str, Plan | str] = {}
    if model.config.encoder.direct is not None:
        return dict.fromkeys(targets, "its cost is in the table from pixels to places")
    for name in targets:
        try:
            plans[name] = plan_of(model, BOARDS[name])
        except (NetworkLimitError, ConfigError) as error:
            plans[name] = str(error)
    return plans


def costs_of(
    model: Model, name: str, plan: Plan | str, trains: Trains | None, queries: int
) -> tuple[Modelled, StepTimes | None]:
    """Costs on one board, and its time in each step."""
    if isinstance(plan, str) or trains is None:
        return _unavailable(model, BOARDS[name], plan if isinstance(plan, str) else "no integer network"), None
    events = count_events(plan, trains)
    costs = modelled(plan, events)
    if events.queries < queries:
        sample = f"Counted on {events.queries} of the {queries} queries, evenly spread."
        costs = replace(costs, assumptions=(*costs.assumptions, sample))
    if plan.board.constants is None or costs.figures is None:
        return costs, None
    return costs, step_times(plan, events, plan.board.constants)


def constants() -> tuple[Constant, ...]:
    """Every constant of the cost models of all boards, each once, and the power of a processor."""
    known = [board.constants for board in BOARDS.values() if board.constants is not None]
    listed = [constant for of_board in known for constant in of_board.listed()]
    listed.append(HOST_POWER)
    return tuple({constant.name: constant for constant in listed}.values())


def step_times(plan: Plan, events: EventCounts, constants: CostConstants) -> StepTimes:
    """Time of the board in each step, mean over the queries, with nominal constants."""
    receive, neurons = (part / 1e3 for part in step_nanoseconds(events, constants, "nominal"))

    def mean(microseconds: NDArray[np.float64]) -> tuple[float, ...]:
        return tuple(microseconds.mean(axis=0).tolist())

    return StepTimes(
        receive=mean(receive),
        neurons=mean(neurons),
        busiest=mean(np.maximum(receive, neurons)),
        program=mean(embedded.step_microseconds(plan, events, constants, "nominal")),
        barrier=constants.barrier(events.tiles or 1).nominal,
    )


def _unavailable(model: Model, board: Board, reason: str) -> Modelled:
    """The entry of a board on which the network cannot run."""
    integer = as_integer(model)
    steps, mode = model.config.network.steps, "injected"
    if integer is not None:
        steps, mode = integer.network.interval, "bias" if integer.network.bias_input else "injected"
    return Modelled(
        target=board.name,
        chips=board.chips,
        cores=0,
        tiles=None,
        steps=steps,
        input_mode=mode,
        unavailable=reason,
    )
