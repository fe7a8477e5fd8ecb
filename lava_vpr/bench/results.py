"""What `lava-vpr bench` finds out, as plain values: the table, the JSON file and the page are all made of these."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from lava_vpr.deploy.ranges import Range
from lava_vpr.evaluation import Metrics


@dataclass(frozen=True)
class Measured:
    """A backend on this machine, or on a board.

    Attributes:
        name: Of the backend, or of a stage beside it (``encoding``: an image file to input rates).
        what: For people: what was timed, from what to what.
        queries: How many different queries were answered.
        threads: That answered them in `queries_per_second`; single queries are timed on one.
        queries_per_second: All queries in one batch; the fastest round.
        milliseconds: Of single queries, one after another; sorted.
        peak_bytes: Most memory that the process answering them held; None: not measured.
        joules_per_query: Of the processor, by RAPL, idle not subtracted; None: see ``no_energy``.
        no_energy: Why there is no energy; empty if there is.
        absent: Why the backend was not measured at all; empty if it was.
        board: Of a board: its profiler's figures (power in mW, steps, idle power subtracted), by name.
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
    board: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Modelled:
    """A query on a board, by the cost model; nothing of this was measured on a chip.

    Attributes:
        target: Name of the board.
        chips: All of the board; all of them draw static power, used or not.
        cores, tiles: In use.
        steps: Of a presentation, the silent ones included.
        input_mode: ``injected`` or ``bias``.
        counts: Events of a query, mean over the queries, by name as in the JSON contract, and more.
        dynamic_microjoules: Of a query by component, clearing of states included, host I/O not.
        milliseconds: Of a query on the chip: all its steps and the clearing of states.
        step_microseconds: Of one step, mean over the steps.
        static_millijoules: Of all chips and embedded processors during that time.
        io_milliseconds: Of the host's traffic for the query, apart: both ways of input, and the way in use first.
        io_microjoules: Dynamic energy on the chip that only one way of input needs, by way.
        clearing: How states are cleared, what it takes: writes, microjoules, milliseconds.
        assumptions: What was assumed, a sentence each, with source.
        unavailable: Why there are no energies and times (Loihi 2); empty if there are. Ranges are None then.
    """

    target: str
    chips: int
    cores: int
    tiles: int | None
    steps: int
    input_mode: str
    counts: dict[str, float]
    dynamic_microjoules: dict[str, Range] | None
    milliseconds: Range | None
    step_microseconds: Range | None
    static_millijoules: Range | None
    io_milliseconds: dict[str, Range] | None
    io_microjoules: dict[str, Range] | None
    clearing: dict[str, Any]
    assumptions: tuple[str, ...] = ()
    unavailable: str = ""


@dataclass(frozen=True)
class Workload:
    """NeuroBench's metrics (Yik et al., Nature Communications 2025); per query where not said otherwise.

    Attributes:
        footprint_bytes: Of the network's parameters and states as stored.
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
class Peer:
    """Another matcher on the same images, in the same run.

    Attributes:
        name: ``sad``, ``cosine``, ``vprtempo``, ``brian2``, or ``lava-vpr`` itself.
        what: For people, with citation.
        metrics: Recall on the same queries; None if not computed.
        queries_per_second: From preprocessed input to match, all queries in one batch, on ``threads`` threads.
        threads: See there.
        bytes: That the matcher keeps of the references (templates or weights).
        queries: Timed.
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
class Candidate:
    """A point of the sweep, measured on the calibration images; costs are modelled (Kapoho Bay, nominal).

    Attributes:
        settings: What differs from the model: steps, weight_bits, prune, inhibition, query_spikes, neurons_per_place,
            tau_membrane, stop_margin (None: no early stopping).
        metrics: Of the default decoder.
        microjoules: Dynamic energy of a query.
        milliseconds: Of a query on the chip.
        mean_steps: Steps of a query; fewer than ``steps`` with early stopping.
        front: No other point is at least as good in recall, energy and time and better in one.
        chosen: The preset ``fast``, or this model as it stands.
    """

    settings: dict[str, Any]
    metrics: Metrics
    microjoules: float
    milliseconds: float
    mean_steps: float
    front: bool = False
    chosen: str = ""


@dataclass(frozen=True)
class CrossCheck:
    """SANA-FE on the same network, mapping and spikes, beside the closed form.

    Attributes:
        version: Of SANA-FE.
        queries: Compared.
        microjoules: By component: (closed form, SANA-FE).
        simple_milliseconds: (closed form, SANA-FE with ``simple`` timing).
        detailed_milliseconds: SANA-FE with ``detailed`` timing: the bound with contention.
        absent: Why it was not run; empty if it was.
    """

    version: str = ""
    queries: int = 0
    microjoules: dict[str, tuple[float, float]] = field(default_factory=dict)
    simple_milliseconds: tuple[float, float] | None = None
    detailed_milliseconds: float | None = None
    absent: str = ""


@dataclass(frozen=True)
class Bench:
    """Everything of one run.

    Attributes:
        model: Figures of the model: places, neurons, weight_bits, steps, preset.
        machine: Processor, cores, what software.
        recall: Of the default decoder on the same queries.
        images: Queries.
        targets: Of `Modelled`, by name.
    """

    model: dict[str, Any]
    machine: dict[str, Any]
    images: int
    recall: Metrics
    measured: tuple[Measured, ...]
    targets: dict[str, Modelled]
    workload: Workload
    cross_check: CrossCheck
    peers: tuple[Peer, ...] = ()
    sweep: tuple[Candidate, ...] = ()
