"""Everything of `lava-vpr bench`, one stage after another; what cannot be done here is said and not raised."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lava_vpr import __version__
from lava_vpr.backends.asking import PLAINLY, Asking
from lava_vpr.backends.registry import timed_by_default
from lava_vpr.bench.energy import Way, on_board
from lava_vpr.bench.measure import alone
from lava_vpr.bench.measure.asked import asked
from lava_vpr.bench.measure.timing import measure, measure_encoding, measure_localizer
from lava_vpr.bench.measure.workload import workload
from lava_vpr.bench.peers import run_peers
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.bench.results import Asked, Bench, Candidate, Measured, Modelled, OnMap, Peer, StepTimes, Workload
from lava_vpr.bench.sweep import BUDGET, sweep
from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.deploy.boards.board import BOARDS, Board
from lava_vpr.deploy.boards.constants import HOST_POWER, Constant, CostConstants
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.cost import embedded
from lava_vpr.deploy.cost.closed_form import step_nanoseconds
from lava_vpr.deploy.cost.costs import modelled
from lava_vpr.deploy.cost.events import EventCounts, count_events
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.threads import cores
from lava_vpr.engine.trains import Trains
from lava_vpr.errors import ConfigError, LavaVprError, NetworkLimitError
from lava_vpr.experiments.points import Case
from lava_vpr.gate import not_integer
from lava_vpr.matching.probability import Calibration
from lava_vpr.matching.trust import is_right
from lava_vpr.model import Model, as_integer
from lava_vpr.recognition import Comparison, Recognition, recognise
from lava_vpr.traverse import Traverse
from lava_vpr.truth.alignment import NEAR_M, Located, PositionErrors

T = TypeVar("T")

COUNTED = 500
"""Queries whose every spike is counted, at most: the counts of each step and core are kept."""

Advance = Callable[[int], None]
Begin = Callable[[str, int], Advance]
"""A function that is told what begins and in how many parts, and returns what is told of parts done."""


@dataclass(frozen=True)
class Request:
    """What a run is to find out.

    Attributes:
        targets: Boards to model.
        backends: Backends to time on this machine.
        sweep, peers: Whether to search settings, and to run other matchers.
        limit: Most queries that a backend is timed on; None: by backend.
        seed: The seed of the queries' noise; None: the model's.
        asking: How queries are asked besides once and plainly.
        calibration: Of the model's decoder; None: probabilities are not known.
        located: Where places and queries were taken; None: not known.
        near: Metres within which a match counts.
        pool: Who measures the points of the sweep.
    """

    targets: tuple[str, ...] = field(default_factory=lambda: tuple(BOARDS))
    backends: tuple[str, ...] = field(default_factory=timed_by_default)
    sweep: bool = False
    peers: bool = False
    limit: int | None = None
    seed: int | None = None
    asking: Asking = PLAINLY
    calibration: Calibration | None = None
    located: Located | None = None
    near: float = NEAR_M
    pool: Pool = ONE_THREAD


@dataclass
class _Attempts:
    """Stages that may fail: minutes of other work are not lost if one does.

    Attributes:
        failed: Why a stage failed, by stage.
    """

    failed: dict[str, str] = field(default_factory=dict)

    def result(self, stage: str, work: Callable[[], T], otherwise: T) -> T:
        """What ``work`` finds out, or ``otherwise`` if it fails."""
        try:
            return work()
        except LavaVprError as error:
            self.failed[stage] = str(error)
            return otherwise


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
    queries = QuerySet.of(model, images, request.seed)
    answers = _recall(queries, truth, request)
    plans = plans_of(model, request.targets)
    begin("counting", 1)
    trains = counted_trains(queries)
    costs = {name: _costs(model, name, plan, trains, len(queries)) for name, plan in plans.items()}
    measured = _measured(traverse, queries, request, begin)
    attempts = _Attempts()
    boards = [modelled_costs for modelled_costs, _ in costs.values()]
    return Bench(
        model=_model(model, answers),
        machine=machine(),
        images=len(queries),
        recall=answers.metrics[answers.default],
        measured=measured,
        targets={name: modelled_costs for name, (modelled_costs, _) in costs.items()},
        workload=attempts.result("workload", lambda: _workload(queries, trains), None),
        peers=attempts.result("peers", lambda: _peers(queries, truth, answers, request, begin), ()),
        sweep=attempts.result("sweep", lambda: _sweep(queries, truth, request, begin), ()),
        events={name: value / max(1, len(queries)) for name, value in answers.events.items()},
        constants=constants_of(BOARDS.values()),
        step_times=tuple(times for _, times in costs.values() if times is not None),
        command=command,
        asked=attempts.result("asking", lambda: _asked(queries, further, truth, request, plans, begin), None),
        energy=attempts.result("energy", lambda: _energy(queries, answers, boards, measured, begin), ()),
        failed=attempts.failed,
        trust=answers.trust,
        on_map=_on_map(answers, request),
    )


def _recall(queries: QuerySet, truth: NDArray[np.bool_], request: Request) -> Recognition:
    """The answers of the model and of cosine, and of all baselines if peers are to be run."""
    return recognise(
        queries.model,
        queries.images,
        truth,
        Comparison(rivals=None if request.peers else ("cosine",), keep_scores=False, calibration=request.calibration),
        pool=Pool(cores()),
        shown=queries.shown,
    )


def _on_map(answers: Recognition, request: Request) -> OnMap | None:
    """Where queries were matched, if it is known where they were taken."""
    if request.located is None:
        return None
    errors = PositionErrors(request.located, request.located.errors(answers.matches), request.near)
    return OnMap(errors, answers.matches, is_right(answers.matches, answers.truth, 0))


def _energy(
    queries: QuerySet, answers: Recognition, boards: Iterable[Modelled], measured: Sequence[Measured], begin: Begin
) -> tuple[Way, ...]:
    """All the energy of a query on every board, by the host engine if it was timed, and by cosine."""
    begin("timing the host's part, and cosine", 1)
    medians = {row.name: float(np.median(row.milliseconds)) for row in measured if row.milliseconds}
    encoding, own = medians.get("encoding"), answers.metrics[answers.default].recall_at_1
    if encoding is None:
        return ()
    part = alone.beside_board(queries) if as_integer(queries.model) is not None else 0.0
    ways = [on_board(costs, own, part, encoding) for costs in boards]
    if "host" in medians:
        ways.append(Way("host", own, medians["host"], encoding))
    ways.append(Way("cosine", answers.metrics["cosine"].recall_at_1, alone.cosine(queries), encoding))
    return tuple(way for way in ways if way is not None)


def _asked(
    queries: QuerySet,
    further: Sequence[EncodedTraverse],
    truth: NDArray[np.bool_],
    request: Request,
    plans: dict[str, Plan | str],
    begin: Begin,
) -> Asked | None:
    """Recall and costs with views or adaptation, if they were asked for."""
    if request.asking == PLAINLY:
        return None
    begin("asking in views, or adapted", 1)
    return asked(queries, further, truth, request.asking, plans, COUNTED)


def plans_of(model: Model, targets: tuple[str, ...]) -> dict[str, Plan | str]:
    """Where the network stands on each board, or why it cannot."""
    plans: dict[str, Plan | str] = {}
    for name in targets:
        try:
            plans[name] = plan_of(model, BOARDS[name])
        except (NetworkLimitError, ConfigError) as error:
            plans[name] = str(error)
    return plans


def counted_trains(queries: QuerySet) -> Trains | None:
    """Every spike of at most `COUNTED` queries, evenly spread; None: no integer network."""
    if as_integer(queries.model) is None:
        return None
    n = len(queries)
    if n <= COUNTED:
        return queries.trains(slice(None))
    return queries.trains(np.linspace(0, n - 1, COUNTED).round().astype(np.int64))


def _costs(
    model: Model, name: str, plan: Plan | str, trains: Trains | None, queries: int
) -> tuple[Modelled, StepTimes | None]:
    """The costs on one board, and its time in each step."""
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


def constants_of(boards: Iterable[Board]) -> tuple[Constant, ...]:
    """Every constant of the cost model of ``boards``, each once, and the power of a processor."""
    listed = [constant for board in boards if board.constants is not None for constant in board.constants.listed()]
    listed.append(HOST_POWER)
    return tuple({constant.name: constant for constant in listed}.values())


def step_times(plan: Plan, events: EventCounts, constants: CostConstants) -> StepTimes:
    """What the board does in each step, mean over the queries, with nominal constants."""
    receive, neurons = (part / 1e3 for part in step_nanoseconds(events, constants, "nominal"))

    def mean(microseconds: NDArray[np.float64]) -> tuple[float, ...]:
        return tuple(microseconds.mean(axis=0).tolist())

    return StepTimes(
        target=plan.board.name,
        receive=mean(receive),
        neurons=mean(neurons),
        busiest=mean(np.maximum(receive, neurons)),
        program=mean(embedded.step_microseconds(plan, events, constants, "nominal")),
        barrier=constants.barrier(events.tiles or 1).nominal,
    )


def _unavailable(model: Model, board: Board, reason: str) -> Modelled:
    """A board that the network cannot run on."""
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


def _measured(traverse: Traverse, queries: QuerySet, request: Request, begin: Begin) -> tuple[Measured, ...]:
    """Every backend that was asked for, timed; the encoding before it, and the public path."""
    begin("timing encoding", 1)
    rows = [measure_encoding(traverse, queries.model.config, standard=queries.model.standard)]
    begin("timing the localizer", 1)
    rows.append(measure_localizer(traverse, queries.model, request.seed))
    for name in request.backends:
        begin(f"timing {name}", 1)
        rows.append(measure(queries, name, limit=request.limit))
    return tuple(rows)


def _model(model: Model, answers: Recognition) -> dict[str, object]:
    """Figures of the model that the others are to be read with."""
    return {
        "preset": model.config.preset,
        "places": model.places,
        "neurons": model.neurons,
        "inputs": model.config.encoder.inputs,
        "weight_bits": model.weight_bits,
        "steps": model.config.network.steps,
        "input_spikes_per_step": model.config.encoder.query_spikes,
        "decoder": answers.default,
    }


def machine(cpuinfo: Path = Path("/proc/cpuinfo")) -> dict[str, object]:
    """Processor and software that the measured figures belong to."""
    try:
        lines = cpuinfo.read_text(errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    facts: dict[str, object] = {
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "processors": cores(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "lava_vpr": __version__,
    }
    for package in ("numpy", "numba", "lava-nc"):
        try:
            facts[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            facts[package] = None
    return facts


def _workload(queries: QuerySet, trains: Trains | None) -> Workload | None:
    """NeuroBench's metrics of the first queries; None: no integer network."""
    if trains is None:
        return None
    if len(queries) > COUNTED:
        return workload(queries)  # the trains that were counted are those of other queries
    return workload(queries, trains)


def _peers(
    queries: QuerySet, truth: NDArray[np.bool_], answers: Recognition, request: Request, begin: Begin
) -> tuple[Peer, ...]:
    """Other matchers on the same images, if they were asked for."""

    def advance(text: str) -> None:
        begin(f"peers: {text}", 1)

    if not request.peers:
        return ()
    return run_peers(queries, truth, recognition=answers, advance=advance)


def sweepable(model: Model) -> str | None:
    """Why settings of ``model`` cannot be searched; None if they can."""
    if as_integer(model) is None:
        return str(not_integer("the search of settings"))
    if not model.learned.size:
        return "a bundle has no float weights to quantise anew; give the model that was deployed"
    return None


def _sweep(queries: QuerySet, truth: NDArray[np.bool_], request: Request, begin: Begin) -> tuple[Candidate, ...]:
    """The search around the model's settings, if it was asked for."""
    if not request.sweep:
        return ()
    advance = begin("sweep of settings", BUDGET)
    case = Case(queries.model, queries.images, truth, queries.shown.seed)
    return sweep(case, pool=request.pool, advance=advance)
