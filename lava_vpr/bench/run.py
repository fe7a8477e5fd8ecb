"""All stages of `lava-vpr bench`, one after another; a stage that fails is reported in the result, not raised."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.asking import Asker
from lava_vpr.backends.interface import Presentations
from lava_vpr.bench.measure.asked import asked, gains_in_weights, gains_presented
from lava_vpr.bench.measure.matchers import alone, beside_board, run_peers
from lava_vpr.bench.measure.timing import each_image, measure, measure_encoding, measure_localizer
from lava_vpr.bench.measure.workload import workload
from lava_vpr.bench.modelling import costs_of, plans_of
from lava_vpr.bench.query_set import QuerySet, machine, model_facts
from lava_vpr.bench.request import Begin, Request
from lava_vpr.bench.results import (
    AnsweringWay,
    Bench,
    GainsCost,
    Measured,
    Modelled,
    OnMap,
    Peer,
    QueryVariants,
    StepTimes,
    SweepPoint,
    Workload,
    from_pixels,
    on_board,
)
from lava_vpr.bench.sweep import BUDGET, Case, sweep
from lava_vpr.cluster.tasks import Pool
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.bundle.front_end import front_end_of
from lava_vpr.deploy.cost.between_queries import adaptation_microjoules
from lava_vpr.deploy.cost.costs import static_millijoules
from lava_vpr.deploy.cost.embedded import bias_milliseconds
from lava_vpr.deploy.cost.front_end import FrontEndCosts, front_end_costs
from lava_vpr.deploy.mapping.front_end import placed
from lava_vpr.encoding import EncodedTraverse, Keep
from lava_vpr.engine.presentations import PixelBlock, Trains, cores
from lava_vpr.errors import LavaVprError
from lava_vpr.model import Model, as_integer, integer_model
from lava_vpr.recognition import Comparison, Recognition, recognise
from lava_vpr.traverse import Traverse

SEEN = 20
"""Most queries for which all spikes of a spiking front end are counted."""

COUNTED = 500
"""Most queries for which all spikes are counted; the counts of each step and core stay in memory."""

T = TypeVar("T")


@dataclass
class Work:
    """The stages of a run, from the command's inputs; results that several figures need are computed once.

    Attributes:
        queries: The queries, and the model that answers them.
        traverse: The query images' files.
        truth: bool (queries, places).
        request: The figures to compute.
        further: The query images in further views.
        begin: Progress callback at the start of each stage.
        failed: Reason of each failed stage, by its name.
    """

    queries: QuerySet
    traverse: Traverse
    truth: NDArray[np.bool_]
    request: Request
    further: Sequence[EncodedTraverse]
    begin: Begin
    failed: dict[str, str] = field(default_factory=dict)

    @cached_property
    def answers(self) -> Recognition:
        """The answers of the model and of cosine, or of all baselines if peers are requested."""
        rivals = None if self.request.peers else ("cosine",)
        how = Comparison(rivals=rivals, keep_scores=False, calibration=self.request.calibration)
        queries = self.queries
        return recognise(queries.model, queries.images, self.truth, how, pool=Pool(cores()), shown=queries.shown)

    @cached_property
    def presented(self) -> Presentations:
        """The presentations of the queries, view after view, with their biases and gains."""
        asker = Asker(self.queries.model, self.request.asking, self.queries.shown.seed)
        return asker.presentations((self.queries.images, *self.further))

    @cached_property
    def gains(self) -> GainsCost | None:
        """The cost of gains; None: inputs have none."""
        asking, applied = self.request.asking, self.request.applied
        if asking.replay is not None:
            return gains_presented(asking.replay, len(self.queries), asking.views)
        return None if applied is None else gains_in_weights(applied, integer_model(self.queries.model, "--season"))

    @cached_property
    def front_end(self) -> dict[str, FrontEndCosts]:
        """The cost of the spiking front end on each board, with the network that hears its cells if one does."""
        return self._front_end(None)

    @cached_property
    def front_end_adapted(self) -> dict[str, FrontEndCosts]:
        """The same with the queries' own biases; empty if they have none, or rates of inputs."""
        heard = self.queries.model.config.encoder.direct is not None
        return self._front_end(self.presented.bias) if heard and self.presented.bias is not None else {}

    def _front_end(self, bias: NDArray[np.int32] | None) -> dict[str, FrontEndCosts]:
        """The costs with biases of all presentations, from at most `SEEN` queries, evenly spread.

        Raises:
            InputError: the queries' pixels were not kept.
        """
        images, found = self.queries.images, dict[str, FrontEndCosts]()
        if self.queries.model.config.encoder.front_end is None:
            return found
        self.begin("counting the front end", 1)
        n = len(images)
        chosen = np.linspace(0, n - 1, min(n, SEEN)).round().astype(np.int64)
        grey = images.kept(Keep.GREY, "counting the front end")[chosen]
        shown = PixelBlock(grey, None if bias is None else bias[chosen])
        for board in (BOARDS[name] for name in self.request.boards):
            spec = front_end_of(self.queries.model, counted=board.counters)
            if spec is not None:
                found[board.name] = front_end_costs(spec, placed(spec, board), shown)
        return found

    @cached_property
    def plans(self) -> dict[str, Plan | str]:
        """The network's plan for each board, or the reason why it does not fit."""
        return plans_of(self.queries.model, self.request.boards)

    @cached_property
    def trains(self) -> Trains | None:
        """All spikes of at most `COUNTED` queries, evenly spread; None: no integer network."""
        self.begin("counting", 1)
        if as_integer(self.queries.model) is None:
            return None
        n = len(self.queries)
        return self.queries.trains(
            slice(None) if n <= COUNTED else np.linspace(0, n - 1, COUNTED).round().astype(np.int64)
        )

    @cached_property
    def costs(self) -> dict[str, tuple[Modelled, StepTimes | None]]:
        """The costs of a query on each board, and its time in each step."""
        queries = self.queries
        return {k: costs_of(queries.model, k, plan, self.trains, len(queries)) for k, plan in self.plans.items()}

    @cached_property
    def timed(self) -> tuple[Measured, ...]:
        """Timings of the encoding, of the localizer, and of each requested backend."""
        queries, request = self.queries, self.request
        self.begin("timing encoding", 1)
        rows = [measure_encoding(self.traverse, queries.model.config, standard=queries.model.standard)]
        self.begin("timing the localizer", 1)
        rows.append(measure_localizer(self.traverse, queries.model, request.seed))
        for name in request.timed:
            self.begin(f"timing {name}", 1)
            rows.append(measure(queries, name, limit=request.limit))
        return tuple(rows)

    def tried(self, name: str, find: Callable[[Work], T], otherwise: T) -> T:
        """The result of ``find``; if it fails, ``otherwise``, so that minutes of other work are not lost."""
        try:
            return find(self)
        except LavaVprError as error:
            self.failed[name] = str(error)
            return otherwise


def _workload(work: Work) -> Workload | None:
    """NeuroBench's metrics of the first queries; None: no integer network."""
    if work.trains is None:
        return None
    # With more queries than `COUNTED`, the trains are not those of the first queries.
    return workload(work.queries, work.trains if len(work.queries) <= COUNTED else None)


def _peers(work: Work) -> tuple[Peer, ...]:
    """Other matchers on the same images, if requested."""
    if not work.request.peers:
        return ()
    work.begin("peers: speed of each", 1)
    return run_peers(work.queries, work.answers)


def _sweep(work: Work) -> tuple[SweepPoint, ...]:
    """The search around the model's settings, if requested."""
    if not work.request.sweep:
        return ()
    advance, queries = work.begin("sweep of settings", BUDGET), work.queries
    case = Case(queries.model, queries.images, work.truth, queries.shown.seed)
    return sweep(case, pool=work.request.pool, advance=advance)


def _asked(work: Work) -> QueryVariants | None:
    """Recall and costs with views, adaptation or gains, if requested."""
    if work.request.plain:
        return None
    work.begin("asking in views, or adapted", 1)
    how = work.request.asking
    return asked(work.queries, work.further, work.presented, work.truth, how, work.plans, COUNTED)


def _energy(work: Work, variants: QueryVariants | None) -> tuple[AnsweringWay, ...]:
    """All the energy of a query on every board, by the host engine if it was timed, and by cosine.

    If ``variants`` have adaptation or gains in one view, each way of the network is listed a second time with them.
    """
    work.begin("timing the host's part, and cosine", 1)
    medians = {row.name: float(np.median(row.milliseconds)) for row in work.timed if row.milliseconds}
    encoding, own = medians.get("encoding"), work.answers.metrics[work.answers.default].recall_at_1
    if encoding is None:
        return ()
    part = beside_board(work.queries) if as_integer(work.queries.model) is not None else 0.0
    on_boards = (on_board(costs, own, part, encoding) for costs, _ in work.costs.values())
    ways = [way for way in on_boards if way is not None]
    if work.queries.model.config.encoder.direct is not None:
        ways += _from_pixels(work, own, part)
    if "host" in medians:
        ways.append(AnsweringWay("host", own, medians["host"], encoding))
    if variants is not None and variants.views == 1:
        how = "adapted" if work.request.asking.replay is None else "gains"
        from_pixels_on = work.front_end_adapted
        ways += [_adapted(way, how, variants, work.plans.get(way.name), from_pixels_on.get(way.name)) for way in ways]
    cosine = work.answers.metrics["cosine"].recall_at_1
    return (*ways, AnsweringWay("cosine", cosine, alone(work.queries, "cosine"), encoding))


def _from_pixels(work: Work, recall: float, decoding: float) -> list[AnsweringWay]:
    """A query from pixels to places on each board with public constants: the host reads the image and decodes."""
    spec = front_end_of(work.queries.model)
    if spec is None:
        return []
    seen = float(np.median(each_image(work.traverse, spec.seen)))
    ways = (from_pixels(name, costs, recall, decoding, seen) for name, costs in work.front_end.items())
    return [way for way in ways if way is not None]


def _adapted(
    way: AnsweringWay, how: str, variants: QueryVariants, plan: Plan | str | None, costs: FrontEndCosts | None
) -> AnsweringWay:
    """A ``way`` of the network with adaptation or gains: the host computes biases and sends a board one per neuron."""
    recall = way.recall if variants.adapted is None else variants.adapted.recall_at_1
    work = way.work_milliseconds + (variants.host_milliseconds or 0.0)
    way = replace(way, name=f"{way.name}, {how}", recall=recall, work_milliseconds=work)
    if costs is not None:  # from pixels to places
        return from_pixels(way.name, costs, recall, work, way.encoding_milliseconds) or way
    if not isinstance(plan, Plan) or plan.board.constants is None or way.dynamic is None or way.io_static is None:
        return way
    constants = plan.board.constants
    waiting = static_millijoules(plan, bias_milliseconds(plan, constants), constants) * 1e3
    dynamic = way.dynamic + adaptation_microjoules(plan, constants)
    return replace(way, dynamic=dynamic, io_static=way.io_static + waiting)


def recall_and_costs(
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
    """Measure the recall of the queries, then their costs.

    Args:
        model: A trained model.
        traverse: The query images' files.
        images: The query images, encoded with the model's settings.
        truth: bool (queries, places).
        request: The figures to compute.
        further: The query images in the further views of the request (`Asking.of`).
        command: How to repeat the run, for the report.
        begin: Progress callback at the start of each stage.
    Raises:
        LavaVprError: recall cannot be computed, or the replay is of other queries. Other failures are reported in the
            result.
    """
    begin("recall", 1)
    work = Work(QuerySet.of(model, images, request.seed), traverse, truth, request, further, begin)
    if request.asking.replay is not None:
        _ = work.presented
    answers, costs, count = work.answers, work.costs, len(images)
    variants = work.tried("asking", _asked, None)
    return Bench(
        model=model_facts(model, answers.default),
        machine=machine(),
        images=count,
        recall=answers.metrics[answers.default],
        events={name: value / max(1, count) for name, value in answers.events.items()},
        trust=answers.trust,
        on_map=OnMap.of(answers, request.located, request.near),
        targets={name: modelled for name, (modelled, _) in costs.items()},
        step_times={name: times for name, (_, times) in costs.items() if times is not None},
        measured=work.timed,
        workload=work.tried("workload", _workload, None),
        peers=work.tried("peers", _peers, ()),
        sweep=work.tried("sweep", _sweep, ()),
        asked=variants,
        gains=work.gains,
        front_end=work.tried("spiking front end", lambda work: work.front_end, {}),
        energy=work.tried("energy", partial(_energy, variants=variants), ()),
        pixels=traverse.pixels,
        command=command,
        failed=work.failed,
    )
