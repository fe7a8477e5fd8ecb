"""What it brings and costs to ask queries in several views, or adapted to the queries before.

Each view is a presentation. Where the network adapts, the host multiplies weights and rates of each query once, and
before each presentation a register of every excitatory neuron is written.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.asking import Asker, Asking
from lava_vpr.backends.interface import HostBackend, Presentations
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.bench.results import AskedOn, QueryVariants
from lava_vpr.cluster.tasks import Pool
from lava_vpr.deploy.boards.constants import Estimate
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.cost.costs import adaptation_microjoules, modelled
from lava_vpr.deploy.cost.embedded import bias_milliseconds
from lava_vpr.deploy.cost.events import count_events
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.adaptation import Adaptation
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.presentations import cores
from lava_vpr.model import as_integer
from lava_vpr.recognition import Comparison, recognise

TIMED = 20
"""Queries whose biases are timed, at most."""


def asked(
    queries: QuerySet,
    further: Sequence[EncodedTraverse],
    truth: NDArray[np.bool_],
    asking: Asking,
    plans: Mapping[str, Plan | str],
    most: int,
) -> QueryVariants:
    """Recall and costs of ``queries`` that are asked as ``asking`` says.

    Args:
        queries: The queries, and the model that is asked.
        further: They in the further views (`Asking.of`).
        truth: bool (queries, places).
        asking: How they are asked, checked.
        plans: Where the network stands on each board, or why it cannot.
        most: Presentations whose every spike is counted, at most.
    Raises:
        LavaVprError: recall cannot be computed.
    """
    model, n = queries.model, len(queries)
    shown = Asker(model, seed=queries.shown.seed).presentations((queries.images, *further))
    comparison = Comparison(rivals=(), keep_scores=False, asking=asking)
    result = recognise(model, queries.images, truth, comparison, pool=Pool(cores()), shown=shown)
    integer, milliseconds, products = as_integer(model), None, 0
    boards: dict[str, AskedOn] = {}
    if integer is not None:
        network = integer.network
        if asking.adapt is not None:
            bias = Adaptation(network, asking.adapt).biases(shown.rates[:n])
            shown = replace(shown, bias=np.tile(bias, (asking.views, 1)))
            milliseconds, products = _bias_milliseconds(network, asking.adapt, shown.rates[:n]), network.weights.size
        boards = _boards(plans, network, asking, queries, _some(shown, n, asking.views, most))
    _, events = HostBackend(Pool(cores())).count_spikes(model, shown)
    return QueryVariants(
        views=asking.views,
        adapt=asking.adapt,
        recall=result.metrics[result.default],
        adapted=result.adapted.get(result.default),
        events={name: value / max(1, n) for name, value in events.items()},
        multiply_adds=products,
        host_milliseconds=milliseconds,
        boards=boards,
    )


def _bias_milliseconds(network: FixedNetwork, tau: float, rates: NDArray[np.uint16]) -> float | None:
    """The median time of a query's biases on this machine; None: there is no query."""
    adaptation, taken = Adaptation(network, tau), []
    for i in range(min(TIMED, len(rates))):
        began = time.perf_counter()
        adaptation.biases(rates[i : i + 1])
        taken.append(1e3 * (time.perf_counter() - began))
    return float(np.median(taken)) if taken else None


def _some(shown: Presentations, n: int, views: int, most: int) -> Presentations:
    """At most ``most`` presentations, or those of one query: all views of queries, of ``n``, that are evenly spread."""
    some = np.unique(np.linspace(0, max(0, n - 1), min(n, max(1, most // views))).round().astype(np.int64))
    chosen = np.concatenate([some + view * n for view in range(views)])
    return shown.part(chosen)


def _boards(
    plans: Mapping[str, Plan | str], network: FixedNetwork, asking: Asking, queries: QuerySet, shown: Presentations
) -> dict[str, AskedOn]:
    """What a query takes on each board that the network fits, by the board's name."""
    rows, trains = {}, HostBackend(Pool(cores())).trains(queries.model, shown)
    for name, plan in plans.items():
        if isinstance(plan, str):
            continue
        adapted = asking.adapt is not None
        writes = asking.views * plan.board.clearing.of(network, adapted=adapted)["writes_per_query"]
        costs, constants = modelled(plan, count_events(plan, trains, bias=shown.bias)), plan.board.constants
        in_all: list[Estimate] = []
        if constants is not None and costs.figures is not None:
            nothing = Estimate(0.0, 0.0, 0.0)
            energy = adaptation_microjoules(plan, constants) if adapted else nothing
            traffic = bias_milliseconds(plan, constants) if adapted else nothing
            found = costs.figures
            each = (found.dynamic_microjoules + energy, found.milliseconds, found.io_milliseconds + traffic)
            in_all = [part * asking.views for part in each]
        rows[name] = AskedOn(asking.views, asking.views * costs.steps, writes, *in_all)
    return rows
