"""The results of `lava-vpr bench` as plain values, from which the tables, the JSON file and the page are made.

All the energy of a query has two parts. That of a board is modelled (`lava_vpr.deploy.cost.costs`). That of a processor
is its time for single queries on one thread of this machine, multiplied by an assumed power
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
    """Measured time, memory and energy of a backend on this machine or on a board.

    Attributes:
        name: The name of the backend, or of a stage beside it (``encoding``: an image file to input rates).
        what: Description of what was timed, from where to where.
        queries: Number of different queries answered.
        threads: Threads used for `queries_per_second`; single queries are timed on one.
        queries_per_second: All queries in one batch; the fastest round.
        milliseconds: Times of single queries, one after another; sorted.
        peak_bytes: Peak memory of the process that answered them; None: not measured.
        joules_per_query: Energy of the processor, by RAPL, idle not subtracted; None: see ``no_energy``.
        no_energy: Why there is no energy; empty if there is.
        absent: Why the backend was not measured at all; empty if it was.
        board: Figures of a board's own profiler by name (power in mW with idle power subtracted, steps); None: not a
            board.
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
    """NeuroBench's metrics (Yik et al., Nature Communications 2025), per query unless stated otherwise.

    Attributes:
        footprint_bytes: Bytes of the network's parameters and states as stored.
        parameters: Number of synaptic weights and other parameters.
        connection_sparsity: Zeros among all weights, 0..1.
        activation_sparsity: 1 - spikes / (neurons x steps), 0..1.
        dense_operations: Synaptic operations if zeros were not skipped.
        effective_macs, effective_acs: Operations whose input and weight are both not 0; with spikes they are
            accumulates.
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
    """Modelled costs of a query on a board, in several views or adapted; None where the board has no public constants.

    Attributes:
        presentations: Presentations of a query, one per view.
        steps: In all presentations.
        registers: Registers written for a query between presentations.
        dynamic_microjoules: Dynamic energy, host I/O not included.
        milliseconds: Time on the chip.
        io_milliseconds: Time of host I/O, not included in ``milliseconds``.
    """

    presentations: int
    steps: int
    registers: int
    dynamic_microjoules: Estimate | None = None
    milliseconds: Estimate | None = None
    io_milliseconds: Estimate | None = None


@dataclass(frozen=True)
class GainsCost:
    """The cost of gains of inputs, counted per query unless stated otherwise.

    Attributes:
        lessened: Number of inputs whose gain is below 15, mean over the queries.
        products: Products of activity and gain that the host computes, mean over the queries.
        epochs: Number of different gains used one after another over the queries.
        gain_bytes: Bytes of an epoch's gains in the host's memory; boards store no gains.
        bias_registers: Registers of a board written for biases.
        bias_bytes: Bytes sent for these, a word of 4 bytes each.
        weights: Weights on a board that must be written again when gains change; 0: weights do not contain gains.
        weight_bytes: Their bytes, with signs, without indices and padding.
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
    """Results of queries presented in several views, with adaptation, or under gains.

    Attributes:
        views: Views of a query.
        adapt: Time constant of adaptation in queries; None: not adapted, or under gains.
        recall: Figures of the default decoder, neither adapted nor under gains, on these views.
        adapted: The same figures with adaptation or gains; None: neither.
        events: What the host engine counted, per query.
        multiply_adds: Most multiply-adds of the product of weights and mean rates that the host computes for a query's
            biases (inputs of rate 0 need none); 0: queries have no biases of their own.
        host_milliseconds: Median time to compute a query's biases on this machine, and its rates under gains if there
            are any; None: neither.
        boards: Costs of a query on each board that the network fits, by the board's name.
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
    """Recall and speed of another matcher on the same images, in the same run.

    Attributes:
        name: ``lava-vpr`` itself, a baseline (``sad``, ``cosine``, ``hog``, ``template``), or another matcher timed in
            turns with them.
        what: The matcher in words, with citation.
        metrics: Recall on the same queries.
        queries_per_second: From preprocessed input to match, all queries in one batch, on ``threads`` threads.
        threads: Number of these threads.
        bytes: Bytes that the matcher stores for the references (templates or weights).
        queries: Number of queries that were timed.
    """

    name: str
    what: str
    metrics: Metrics
    queries_per_second: float
    threads: int
    bytes: int
    queries: int


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
        front: Whether no other point is at least as good in recall, energy and time, and better in one. Points without
            early stopping, which no backend does yet, are compared only with each other.
        chosen: `MODEL` or `FAST` for this model's own settings or those of preset ``fast``, else empty.
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
    """Modelled time of a board in each step of a presentation, with nominal constants; mean over the queries.

    Attributes:
        receive: Microseconds that the busiest core needs for arriving spikes in each step.
        neurons: Microseconds that the busiest core needs for neurons and their messages in each step.
        busiest: The longer of the two in each step of each query.
        program: Microseconds of the embedded program in each step, during which the cores wait.
        barrier: Microseconds of the synchronisation that ends each step.
    """

    receive: tuple[float, ...] = field(repr=False)
    neurons: tuple[float, ...] = field(repr=False)
    busiest: tuple[float, ...] = field(repr=False)
    program: tuple[float, ...] = field(repr=False)
    barrier: float


@dataclass(frozen=True, eq=False)
class OnMap:
    """Positions of the queries and of their matches.

    Attributes:
        errors: Distances between the queries' true positions and those of their matches.
        matches: Place of each query, -1 for none, int64 (n,).
        correct: Which of them are right, bool (n,).
    """

    errors: PositionErrors
    matches: NDArray[np.int64] = field(repr=False)
    correct: NDArray[np.bool_] = field(repr=False)

    @classmethod
    def of(cls, answers: Recognition, located: Located | None, near: float) -> OnMap | None:
        """The positions of queries and matches, or None if unknown; a match within ``near`` metres is correct."""
        if located is None:
            return None
        errors = PositionErrors(located, located.errors(answers.matches), near)
        return cls(errors, answers.matches, is_right(answers.matches, answers.truth, 0))


@dataclass(frozen=True)
class Bench:
    """All results of one run.

    Attributes:
        model: Figures of the model: places, neurons, weight_bits, steps, preset.
        machine: Processor, cores and software versions.
        recall: Figures of the default decoder on the same queries.
        images: Number of queries.
        measured: Backends and stages, timed here.
        targets: What a query costs on each board, by the board's name.
        workload: NeuroBench's metrics; None: the model is no integer network.
        peers, sweep: Empty if not requested, or failed.
        events: Events per query, counted by the host engine for any network, also in floating point.
        step_times: Times of each step, by the board's name, on those that have times.
        command: How to repeat the run.
        asked: Recall and costs with views, adaptation or gains; None: not requested, or failed.
        gains: Cost of gains; None: inputs have none.
        front_end: Cost of a spiking front end by the board's name; empty: the model has none.
        energy: All the energy of a query for every way to answer it: boards, the host engine, cosine.
        pixels: Width and height of the query images; None: they are vectors.
        failed: Reason of each failed stage, by its name.
        trust: Calibration figures of the probabilities, by way to answer; empty where there are none.
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
    """A way to answer a query, with all its energy in uJ.

    Attributes:
        name: The board, or what the processor runs instead: ``host`` (this network), ``cosine``, ``hog``, ``sad``. The
            suffix ``, adapted`` marks adaptation, ``, gains`` gains of inputs.
        recall: R@1 on the same queries, 0..1.
        work_milliseconds: Median time of the processor after the encoding: with a board it draws input spikes and
            decodes counts, without one it does the whole match.
        encoding_milliseconds: Median time of the processor from an image file to the input of the matcher.
        dynamic: Modelled dynamic energy of the board; None: no board.
        static: Modelled static energy of the whole board while its chips work; None: no board.
        io_static: Modelled static energy of the board while its chips wait for host I/O; None: no board.
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
        """All energy except that of the encoding, which every way needs."""
        parts = (self.dynamic, self.static, self.io_static, self.work)
        return total(part for part in parts if part is not None)

    @property
    def whole(self) -> Estimate:
        """All energy of a query."""
        return self.without_encoding + self.encoding

    def as_json(self) -> dict[str, Any]:
        """The figures by name, as scripts read them, without the way's name."""
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
    """The way that uses a board; None if the board's energy is unknown.

    Args:
        costs: Modelled costs of a query.
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


def from_pixels(name: str, costs: FrontEndCosts, recall: float, work: float, encoding: float) -> AnsweringWay | None:
    """The way from pixels to places in one run on a board; None if the board's energy is unknown.

    Args:
        name: Its name.
        costs: Modelled costs of a query, those of the network of places among them.
        recall: R@1 of the network.
        work: The host's own work for a query besides the encoding, ms.
        encoding: Time until an image is what pixels take, ms.
    """
    if costs.dynamic_microjoules is None or costs.between_microjoules is None or costs.static_millijoules is None:
        return None
    dynamic = total((*costs.dynamic_microjoules.values(), *costs.between_microjoules.values()))
    static = costs.static_millijoules * 1e3  # while the chips wait for the host, too
    return AnsweringWay(name, recall, work, encoding, dynamic, static, Estimate(0, 0, 0))
