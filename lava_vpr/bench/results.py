"""What `lava-vpr bench` finds out, as plain values: the table, the JSON file and the page are all made of these.

All the energy of a query: what a board takes is modelled (`lava_vpr.deploy.cost.costs`). What a processor does is timed
on this machine, single queries on one thread, and multiplied by an assumed power
(`lava_vpr.deploy.boards.constants.HOST_POWER`), the same for every way to answer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.constants import HOST_POWER, Estimate as Estimate, total
from lava_vpr.deploy.cost.costs import BoardFigures as BoardFigures, Modelled as Modelled
from lava_vpr.deploy.cost.front_end import FrontEndCosts
from lava_vpr.matching.evaluation import Metrics
from lava_vpr.matching.trust import Trust, is_right
from lava_vpr.recognition import Recognition
from lava_vpr.truth.alignment import Located, PositionErrors


@dataclass(frozen=True)
class Measured:
    """A backend on this machine, or on a board.

    Attributes:
        name: The name of the backend, or of a stage beside it (``encoding``: an image file to input rates).
        what: What was timed, in words, from what to what.
        queries: How many different queries were answered.
        threads: Threads that answered them in `queries_per_second`; single queries are timed on one.
        queries_per_second: All queries in one batch; the fastest round.
        milliseconds: Times of single queries, one after another; sorted.
        peak_bytes: Most memory that the process answering them held; None: not measured.
        joules_per_query: Energy of the processor, by RAPL, idle not subtracted; None: see ``no_energy``.
        no_energy: Why there is no energy; empty if there is.
        absent: Why the backend was not measured at all; empty if it was.
        board: A board's own figures, by its profiler (power in mW, steps, idle power subtracted), by name; None: it
            is none.
    """

    name: str
    what: str
    queries: int = 0
    threads: int = 1
    queries_per_second: float | None = None
    milliseconds: tuple[float, ...] = field(default=(), repr=False)
    peak_bytes: int | None = None
    joules_per_query: float | None = None
    no_energy: str = ""
    absent: str = ""
    board: dict[str, float] | None = None


@dataclass(frozen=True)
class Workload:
    """NeuroBench's metrics (Yik et al., Nature Communications 2025); per query where not said otherwise.

    Attributes:
        footprint_bytes: Bytes of the network's parameters and states as stored.
        parameters: Number of synaptic weights and other parameters.
        connection_sparsity: Zeros among all weights, 0..1.
        activation_sparsity: 1 - spikes / (neurons x steps), 0..1.
        dense_operations: Synaptic operations if no zero were skipped.
        effective_macs, effective_acs: Operations whose input and weight are both not 0; spikes make them accumulates.
        membrane_updates: Membranes that were updated.
    """

    footprint_bytes: int
    parameters: int
    connection_sparsity: float
    activation_sparsity: float
    dense_operations: float
    effective_macs: float
    effective_acs: float
    membrane_updates: float


@dataclass(frozen=True)
class AskedOn:
    """A query on a board, asked in several views or adapted; energies and times modelled, None where there are none.

    Attributes:
        presentations: Of a query, one a view.
        steps: In all presentations.
        registers: Registers that are written for a query between presentations.
        dynamic_microjoules: Dynamic energy, host I/O not included.
        milliseconds: Time on the chip.
        io_milliseconds: Time of the host's traffic, apart.
    """

    presentations: int
    steps: int
    registers: int
    dynamic_microjoules: Estimate | None = None
    milliseconds: Estimate | None = None
    io_milliseconds: Estimate | None = None


@dataclass(frozen=True)
class GainsCost:
    """What it takes that inputs have gains: counted, of a query where nothing else is said.

    Attributes:
        lessened: Inputs whose gain is below 15, mean over the queries.
        products: Products of activity and gain that the host forms, mean over the queries.
        epochs: Gains that were in force one after another, each for some of the queries.
        gain_bytes: Bytes of an epoch's gains, in the host's memory; a board holds none of them.
        bias_registers: Registers of a board that are written for biases.
        bias_bytes: Bytes that are sent for these, a word of 4 for each.
        weights: Weights on a board that are written again when the gains in them change; 0: gains are not in weights.
        weight_bytes: Their bytes, signs counted, indices and padding left out.
    """

    lessened: float
    products: float = 0.0
    epochs: int = 1
    gain_bytes: int = 0
    bias_registers: int = 0
    bias_bytes: int = 0
    weights: int = 0
    weight_bytes: int = 0


@dataclass(frozen=True)
class QueryVariants:
    """Queries asked in several views, adapted to those before, or under gains.

    Attributes:
        views: Views of a query.
        adapt: Time constant of adaptation in queries; None: not adapted, or under gains.
        recall: Figures of the default decoder, neither adapted nor under gains, on these views.
        adapted: They where the network adapts, or inputs have gains; None: neither.
        events: What the host engine counted, per query.
        multiply_adds: Of the product of weights and mean rates that the host forms for a query's biases, at most, as
            inputs at rest take none; 0: it has none of its own.
        host_milliseconds: Time of a query's biases on this machine, and of its rates under gains if it has any, median;
            None: neither.
        boards: What a query takes on each board that the network fits, by the board's name.
    """

    views: int
    adapt: float | None
    recall: Metrics
    adapted: Metrics | None
    events: dict[str, float]
    multiply_adds: int
    host_milliseconds: float | None
    boards: dict[str, AskedOn] = field(default_factory=dict)


@dataclass(frozen=True)
class Peer:
    """Another matcher on the same images, in the same run.

    Attributes:
        name: ``lava-vpr`` itself, a baseline (``sad``, ``cosine``, ``hog``, ``template``), or that of another matcher
            that took turns with them.
        what: The matcher in words, with citation.
        metrics: Recall on the same queries; None if not computed.
        queries_per_second: From preprocessed input to match, all queries in one batch, on ``threads`` threads.
        threads: Number of these threads.
        bytes: Bytes that the matcher keeps of the references (templates or weights).
        queries: Number of queries that were timed.
        absent: Why it was not run; empty if it was.
    """

    name: str
    what: str
    metrics: Metrics | None = None
    queries_per_second: float | None = None
    threads: int = 1
    bytes: int | None = None
    queries: int = 0
    absent: str = ""


@dataclass(frozen=True)
class SweepPoint:
    """A point of the sweep, measured on the calibration images; costs are modelled (Kapoho Bay, nominal).

    Attributes:
        settings: What differs from the model: steps, weight_bits, prune, inhibition, query_spikes, neurons_per_place,
            tau_membrane, stop_margin (None: no early stopping).
        metrics: Figures of the default decoder.
        microjoules: Dynamic energy of a query.
        milliseconds: Time of a query on the chip.
        mean_steps: Steps of a query; fewer than ``steps`` with early stopping.
        board_microjoules: All energy of a query on the board, dynamic and static.
        front: No other point is at least as good in recall, energy and time and better in one; of points without early
            stopping, which no backend does yet, no other without it.
        chosen: The preset ``fast``, or this model as it stands.
    """

    settings: dict[str, Any]
    metrics: Metrics
    microjoules: float
    milliseconds: float
    mean_steps: float
    board_microjoules: float
    front: bool = False
    chosen: str = ""


@dataclass(frozen=True)
class StepTimes:
    """When a board is busy during a presentation, by the cost model with nominal constants; mean over the queries.

    Attributes:
        receive: Microseconds that what arrives takes on the busiest core in each step.
        neurons: Microseconds that neurons and their messages take on the busiest core in each step.
        busiest: The longer of both in each step of each query.
        program: Microseconds that the program on the chips' processors takes in each step, while the cores wait.
        barrier: Microseconds of the synchronisation that ends each step.
    """

    receive: tuple[float, ...] = field(repr=False)
    neurons: tuple[float, ...] = field(repr=False)
    busiest: tuple[float, ...] = field(repr=False)
    program: tuple[float, ...] = field(repr=False)
    barrier: float


@dataclass(frozen=True, eq=False)
class OnMap:
    """Where queries were taken and matched.

    Attributes:
        errors: How far from their true positions queries were placed.
        matches: Place of each query, -1 for none, int64 (n,).
        correct: Which of them are right, bool (n,).
    """

    errors: PositionErrors
    matches: NDArray[np.int64] = field(repr=False)
    correct: NDArray[np.bool_] = field(repr=False)

    @classmethod
    def of(cls, answers: Recognition, located: Located | None, near: float) -> OnMap | None:
        """Where queries were matched, if it is known where they were taken; ``near`` metres count as right."""
        if located is None:
            return None
        errors = PositionErrors(located, located.errors(answers.matches), near)
        return cls(errors, answers.matches, is_right(answers.matches, answers.truth, 0))


@dataclass(frozen=True)
class Bench:
    """Everything that one run finds out.

    Attributes:
        model: Figures of the model: places, neurons, weight_bits, steps, preset.
        machine: Processor, cores, what software.
        recall: Figures of the default decoder on the same queries.
        images: Number of queries.
        measured: Backends and stages, timed here.
        targets: What a query costs on each board, by the board's name.
        workload: NeuroBench's metrics; None: the model is no integer network.
        peers, sweep: Empty if they were not asked for, or failed.
        events: What the host engine counted, per query; of every network, a float one too.
        step_times: Times of each step, by the board's name, on those that have times.
        command: How to repeat the run.
        asked: Recall and costs with views, adaptation or gains; None: not asked for, or failed.
        gains: What gains take; None: inputs have none.
        front_end: What a spiking front end costs, by the board's name; empty: the model has none.
        energy: All the energy of a query by every way to answer it: boards, the host engine, cosine.
        pixels: Width and height of the query images; None: they are vectors.
        failed: What was asked for and could not be done, by stage, with the reason.
        trust: How far probabilities can be trusted, by way to answer; empty where there are none.
        on_map: Where queries were matched; None where positions are not known.
    """

    model: dict[str, Any]
    machine: dict[str, Any]
    images: int
    recall: Metrics
    measured: tuple[Measured, ...]
    targets: dict[str, Modelled]
    workload: Workload | None
    peers: tuple[Peer, ...] = ()
    sweep: tuple[SweepPoint, ...] = ()
    events: dict[str, float] = field(default_factory=dict)
    step_times: dict[str, StepTimes] = field(default_factory=dict)
    command: str = ""
    asked: QueryVariants | None = None
    gains: GainsCost | None = None
    front_end: Mapping[str, FrontEndCosts] = field(default_factory=dict)
    energy: tuple[AnsweringWay, ...] = ()
    pixels: tuple[int, int] | None = None
    failed: dict[str, str] = field(default_factory=dict)
    trust: dict[str, Trust] = field(default_factory=dict)
    on_map: OnMap | None = None


@dataclass(frozen=True)
class AnsweringWay:
    """A way to answer a query, with all the energy that it takes, in uJ.

    Attributes:
        name: The board, or what the processor runs instead: ``host`` (this network), ``cosine``, ``hog``, ``sad``; with
            ``, adapted`` behind where the network adapts, ``, gains`` where inputs have gains.
        recall: R@1 on the same queries, 0..1.
        work_milliseconds: The processor's time after the encoding, median: beside a board input spikes drawn and counts
            decoded, without one the whole match.
        encoding_milliseconds: The processor's time from an image file to what is compared, median.
        dynamic: Modelled dynamic energy on the board; None: there is no board.
        static: Modelled static energy of the whole board while its chips work; None: there is no board.
        io_static: That of the time for which the chips wait for host I/O besides; None: there is no board.
    """

    name: str
    recall: float
    work_milliseconds: float
    encoding_milliseconds: float
    dynamic: Estimate | None = None
    static: Estimate | None = None
    io_static: Estimate | None = None

    @property
    def work(self) -> Estimate:
        """Energy of the processor's work after the encoding."""
        return HOST_POWER * self.work_milliseconds  # mW ms

    @property
    def encoding(self) -> Estimate:
        """Energy of the encoding."""
        return HOST_POWER * self.encoding_milliseconds

    @property
    def without_encoding(self) -> Estimate:
        """All energy but that of the encoding, which every way takes."""
        parts = (self.dynamic, self.static, self.io_static, self.work)
        return total(part for part in parts if part is not None)

    @property
    def whole(self) -> Estimate:
        """All energy of a query."""
        return self.without_encoding + self.encoding

    def as_json(self) -> dict[str, Any]:
        """The figures by name, as scripts read them; the way's name is the key."""
        return {
            "recall_at_1": self.recall,
            "dynamic_microjoules": self.dynamic,
            "static_microjoules": self.static,
            "io_static_microjoules": self.io_static,
            "work_microjoules": self.work,
            "without_encoding_microjoules": self.without_encoding,
            "encoding_microjoules": self.encoding,
            "total_microjoules": self.whole,
            "work_milliseconds": self.work_milliseconds,
            "encoding_milliseconds": self.encoding_milliseconds,
        }


def on_board(costs: Modelled, recall: float, work: float, encoding: float) -> AnsweringWay | None:
    """The way through a board; None: there are no energies of it.

    Args:
        costs: What the cost model says of a query.
        recall: R@1 of the network.
        work: The host's own work for a query besides the encoding, ms.
        encoding: Time of the encoding, ms.
    """
    figures = costs.figures
    if figures is None:
        return None
    static, whole = figures.static_millijoules, figures.wall_static_millijoules
    later = Estimate.of(lambda level: 1e3 * (whole.at(level) - static.at(level)))
    return AnsweringWay(costs.target, recall, work, encoding, figures.dynamic_microjoules, static * 1e3, later)
