"""Everything of `lava-vpr bench`, one stage after another; what cannot be done here is said and not raised."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.bench import modelling
from lava_vpr.bench.measure import alone
from lava_vpr.bench.measure.asked import asked
from lava_vpr.bench.measure.timing import measure, measure_encoding, measure_localizer
from lava_vpr.bench.measure.workload import workload
from lava_vpr.bench.peers import run_peers
from lava_vpr.bench.query_set import QuerySet, machine, model_facts
from lava_vpr.bench.request import Begin, Request
from lava_vpr.bench.results import (
    AnsweringWay,
    Bench,
    Measured,
    OnMap,
    Peer,
    QueryVariants,
    SweepPoint,
    Workload,
    on_board,
)
from lava_vpr.bench.sweep import BUDGET, Case, sweep
from lava_vpr.cluster.tasks import Pool
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import LavaVprError
from lava_vpr.model import Model, as_integer
from lava_vpr.recognition import Comparison, Recognition, recognise
from lava_vpr.traverse import Traverse

COUNTED = 500
"""Queries whose every spike is counted, at most: the counts of each step and core are kept."""


@dataclass
class Work:
    """What stages take from the command and from each other; each part is worked out once, when it is first needed.

    Attributes:
        queries: The queries, and the model that is asked.
        traverse: The query images' files.
        truth: bool (queries, places).
        request: What to find out.
        further: The query images in further views.
        begin: Told what begins.
    """

    queries: QuerySet
    traverse: Traverse
    truth: NDArray[np.bool_]
    request: Request
    further: Sequence[EncodedTraverse]
    begin: Begin

    @cached_property
    def answers(self) -> Recognition:
        """The answers of the model and of cosine, and of all baselines if peers are to be run."""
        rivals = None if self.request.peers else ("cosine",)
        how = Comparison(rivals=rivals, keep_scores=False, calibration=self.request.calibration)
        queries = self.queries
        return recognise(queries.model, queries.images, self.truth, how, pool=Pool(cores()), shown=queries.shown)

    @cached_property
    def boards(self) -> modelling.Boards:
        """Where the network stands on each board, and what a query costs there."""
        plans = modelling.plans_of(self.queries.model, self.request.boards)
        self.begin("counting", 1)
        return modelling.Boards.of(self.queries, plans, COUNTED)

    @cached_property
    def measured(self) -> tuple[Measured, ...]:
        """Every backend that is to be timed; the encoding before it, and the public path."""
        queries, request = self.queries, self.request
        self.begin("timing encoding", 1)
        rows = [measure_encoding(self.traverse, queries.model.config, standard=queries.model.standard)]
        self.begin("timing the localizer", 1)
        rows.append(measure_localizer(self.traverse, queries.model, request.seed))
        for name in request.timed:
            self.begin(f"timing {name}", 1)
            rows.append(measure(queries, name, limit=request.limit))
        return tuple(rows)


def _workload(work: Work) -> Workload | None:
    """NeuroBench's metrics of the first queries; None: no integer network."""
    trains = work.boards.trains
    if trains is None:
        return None
    # Of more queries than are counted, the trains are those of others than the first.
    return workload(work.queries, trains if len(work.queries) <= COUNTED else None)


def _peers(work: Work) -> tuple[Peer, ...]:
    """Other matchers on the same images, if they were asked for."""

    def advance(text: str) -> None:
        work.begin(f"peers: {text}", 1)

    if not work.request.peers:
        return ()
    return run_peers(work.queries, work.truth, recognition=work.answers, advance=advance)


def _sweep(work: Work) -> tuple[SweepPoint, ...]:
    """The search around the model's settings, if it was asked for."""
    if not work.request.sweep:
        return ()
    advance, queries = work.begin("sweep of settings", BUDGET), work.queries
    case = Case(queries.model, queries.images, work.truth, queries.shown.seed)
    return sweep(case, pool=work.request.pool, advance=advance)


def _asked(work: Work) -> QueryVariants | None:
    """Recall and costs with views or adaptation, if they were asked for."""
    if work.request.plain:
        return None
    work.begin("asking in views, or adapted", 1)
    return asked(work.queries, work.further, work.truth, work.request.asking, work.boards.plans, COUNTED)


def _energy(work: Work) -> tuple[AnsweringWay, ...]:
    """All the energy of a query on every board, by the host engine if it was timed, and by cosine."""
    work.begin("timing the host's part, and cosine", 1)
    medians = {row.name: float(np.median(row.milliseconds)) for row in work.measured if row.milliseconds}
    encoding, own = medians.get("encoding"), work.answers.metrics[work.answers.default].recall_at_1
    if encoding is None:
        return ()
    part = alone.beside_board(work.queries) if as_integer(work.queries.model) is not None else 0.0
    ways = [on_board(costs, own, part, encoding) for costs in work.boards.costs.values()]
    if "host" in medians:
        ways.append(AnsweringWay("host", own, medians["host"], encoding))
    ways.append(
        AnsweringWay("cosine", work.answers.metrics["cosine"].recall_at_1, alone.cosine(work.queries), encoding)
    )
    return tuple(way for way in ways if way is not None)


@dataclass(frozen=True)
class Stage:
    """A stage of a run.

    Attributes:
        field: What it finds out: a field of `Bench`.
        find: How.
        name: Its name where it fails, which does not end the run; None: without it there is no result.
        otherwise: The field's value then.
    """

    field: str
    find: Callable[[Work], Any]
    name: str | None = None
    otherwise: Any = None


STAGES = (
    Stage("recall", lambda work: work.answers.metrics[work.answers.default]),
    Stage("model", lambda work: model_facts(work.queries.model, work.answers.default)),
    Stage("machine", lambda work: machine()),
    Stage("images", lambda work: len(work.queries)),
    Stage("events", lambda work: {k: v / max(1, len(work.queries)) for k, v in work.answers.events.items()}),
    Stage("trust", lambda work: work.answers.trust),
    Stage("on_map", lambda work: OnMap.of(work.answers, work.request.located, work.request.near)),
    Stage("targets", lambda work: work.boards.costs),
    Stage("step_times", lambda work: work.boards.step_times),
    Stage("constants", lambda work: modelling.constants()),
    Stage("measured", lambda work: work.measured),
    Stage("workload", _workload, "workload"),
    Stage("peers", _peers, "peers", ()),
    Stage("sweep", _sweep, "sweep", ()),
    Stage("asked", _asked, "asking"),
    Stage("energy", _energy, "energy", ()),
)
"""The stages in order; those with a name may fail: minutes of other work are not lost if one does."""


def run(
    model: Model,
    traverse: Traverse,
    images: EncodedTraverse,
    truth: NDArray[np.bool_],
    request: Request,
    *,
    further: Sequence[EncodedTraverse] = (),
    command: str = "",
    begin: Begin = lambda text, parts: lambda done: None,
) -> Bench:
    """Find out the recall of the queries, then their costs.

    Args:
        model: A trained model.
        traverse: The query images' files.
        images: The query images, encoded with the model's settings.
        truth: bool (queries, places).
        request: What to find out.
        further: The query images in the further views that it asks for (`Asking.of`).
        command: How to repeat the run, for the report.
        begin: Told what begins.
    Raises:
        LavaVprError: recall cannot be computed. Whatever else is missing is said in the result.
    """
    begin("recall", 1)
    work = Work(QuerySet.of(model, images, request.seed), traverse, truth, request, further, begin)
    values: dict[str, Any] = {}
    failed: dict[str, str] = {}
    for stage in STAGES:
        try:
            values[stage.field] = stage.find(work)
        except LavaVprError as error:
            if stage.name is None:
                raise
            failed[stage.name], values[stage.field] = str(error), stage.otherwise
    return Bench(**values, command=command, failed=failed)
