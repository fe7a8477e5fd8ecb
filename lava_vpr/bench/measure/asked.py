"""Recall and cost of queries presented in several views, with adaptation, or under gains.

Each view is a presentation. With adaptation, the host multiplies weights and rates once per query and writes a register
of every excitatory neuron before each presentation. Gains stay on the host, which multiplies activity by them. A season
that was applied is part of the weights and costs nothing per query.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.asking import Asking
from lava_vpr.backends.interface import HostBackend, Presentations
from lava_vpr.backends.teaching import Learner
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.bench.results import AskedOn, GainsCost, QueryVariants
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import LifNetwork
from lava_vpr.deploy.boards.constants import Estimate
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.cost.between_queries import adaptation_microjoules
from lava_vpr.deploy.cost.costs import modelled
from lava_vpr.deploy.cost.embedded import bias_milliseconds
from lava_vpr.deploy.cost.events import count_events
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.adaptation import Adaptation
from lava_vpr.engine.gains import FULL
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.presentations import cores
from lava_vpr.model import IntegerModel, as_integer
from lava_vpr.recognition import Comparison, recognise
from lava_vpr.season.file import unlearned
from lava_vpr.season.table import GainTable

TIMED = 20
"""Most queries whose biases and gains are timed."""
WORD_BYTES = 4
"""Bytes sent to a board for one register."""


def asked(
    queries: QuerySet,
    further: Sequence[EncodedTraverse],
    shown: Presentations,
    truth: NDArray[np.bool_],
    asking: Asking,
    plans: Mapping[str, Plan | str],
    most: int,
) -> QueryVariants:
    """Recall and costs of ``queries`` presented as ``asking`` says.

    Args:
        queries: The queries, and the model that is asked.
        further: The same queries in the further views (`Asking.of`).
        shown: Their presentations in all views.
        truth: bool (queries, places).
        asking: Views, adaptation and gains, checked.
        plans: The network's plan for each board, or why it does not fit.
        most: Most presentations of which every spike is counted.
    Raises:
        LavaVprError: recall cannot be computed.
    """
    model, n = queries.model, len(queries)
    comparison = Comparison(rivals=(), keep_scores=False, asking=asking)
    plain = replace(shown, rates=shown.seen, bias=None, plain=None)
    result = recognise(model, queries.images, truth, comparison, pool=Pool(cores()), shown=plain, further=further)
    integer, milliseconds, products = as_integer(model), None, 0
    boards: dict[str, AskedOn] = {}
    if integer is not None:
        network = integer.network
        if asking.adapt is not None:
            milliseconds = _median(partial(_bias, Adaptation(network, asking.adapt), plain), n)
        elif asking.replay is not None:
            milliseconds = _median(partial(_gained, _learner(integer, asking.replay), queries), n)
        products = 0 if shown.bias is None else network.weights.size
        boards = _boards(plans, network, asking, queries, _some(shown, n, asking.views, most))
    _, events = HostBackend(Pool(cores())).count_spikes(model, shown)
    return QueryVariants(
        views=asking.views,
        adapt=asking.adapt,
        recall=result.metrics[result.default],
        adapted=(result.adapted | result.learned).get(result.default),
        events={name: value / max(1, n) for name, value in events.items()},
        multiply_adds=products,
        host_milliseconds=milliseconds,
        boards=boards,
    )


def gains_presented(table: GainTable, queries: int, views: int) -> GainsCost:
    """The cost of gains where the host multiplies by those of ``table``, for its first ``queries``, at least one."""
    epoch, neurons = table.epoch[:queries], table.bias.shape[1]
    lessened = np.count_nonzero(table.gains < FULL, axis=1)[epoch]
    multiplied = np.where(lessened > 0, table.gains.shape[1], 0)  # all are, or none
    registers = neurons * views
    return GainsCost(
        lessened=float(lessened.mean()),
        products=float(multiplied.mean()) * views,
        epochs=len(np.unique(epoch)),
        gain_bytes=table.gains[0].nbytes,
        bias_registers=registers,
        bias_bytes=WORD_BYTES * registers,
    )


def gains_in_weights(gains: NDArray[np.uint8], model: IntegerModel) -> GainsCost:
    """The cost of ``gains`` that are contained in the weights of ``model``."""
    lessened, weights = float(np.count_nonzero(gains < FULL)), model.network.weights.size
    return GainsCost(lessened, weights=weights, weight_bytes=-(-weights * model.network.stored_bits // 8))


def _median(ask: Callable[[slice], object], n: int) -> float | None:
    """The median time of ``ask`` on this machine, called with one of the first ``n`` queries at a time; None without
    queries."""
    taken = []
    for i in range(min(TIMED, n)):
        began = time.perf_counter()
        ask(slice(i, i + 1))
        taken.append(1e3 * (time.perf_counter() - began))
    return float(np.median(taken)) if taken else None


def _bias(adaptation: Adaptation, plain: Presentations, query: slice) -> object:
    """Compute the biases of a query with adaptation."""
    return adaptation.biases(plain.rates[query])


def _learner(model: IntegerModel, table: GainTable) -> Learner:
    """What computes biases and rates under the last gains of ``table``, as in a drive that learns."""
    return Learner(model, replace(unlearned(model), gains=table.gains[-1]), LifNetwork.adapt)


def _gained(learner: Learner, queries: QuerySet, query: slice) -> object:
    """The biases and rates of a query under gains."""
    return learner.weighed([queries.shown.part(query)], [queries.images.take(query)])


def _some(shown: Presentations, n: int, views: int, most: int) -> Presentations:
    """At most ``most`` presentations, but at least one query's: all views of queries spread evenly over ``n``."""
    some = np.unique(np.linspace(0, max(0, n - 1), min(n, max(1, most // views))).round().astype(np.int64))
    chosen = np.concatenate([some + view * n for view in range(views)])
    return shown.part(chosen)


def _boards(
    plans: Mapping[str, Plan | str], network: FixedNetwork, asking: Asking, queries: QuerySet, shown: Presentations
) -> dict[str, AskedOn]:
    """The cost of a query on each board that the network fits, by the board's name."""
    rows, trains = {}, HostBackend(Pool(cores())).trains(queries.model, shown)
    for name, plan in plans.items():
        if isinstance(plan, str):
            continue
        adapted = shown.bias is not None
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
