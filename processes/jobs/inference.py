"""Whole runs of Lava as functions of arrays and options, to be called in a process of their own.

Each takes ``arrays``: ``weights`` int16 (inputs, neurons), ``bias`` int32 (neurons,), ``rates`` uint16 (n, inputs),
``keys`` uint64 (n,), and maybe ``biases`` int32 (n, neurons), those of each presentation in place of the network's;
and ``options``: the numbers of `FixedNetwork.scalars`, ``tag`` (``fixed_pt`` or ``floating_pt``)
and ``record`` (bool). Each returns ``counts`` int32 (n, neurons), and how many spikes each input and each inhibitory
neuron sent, ``input_spikes`` int64 (inputs,) and ``inh_spikes`` int64 (inhibitory,); with ``record`` also the rasters
``exc``, ``inh`` and ``inputs``, uint8 (n, interval, neurons or inhibitory or inputs). With option ``timed``, ``runs``
(many presentations a run of Lava where that is faster) or ``single`` (one), also what `RunTimes` has.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import need
from lava_vpr.engine.inference.biases import bias_input_spikes
from lava_vpr.engine.inference.counting import EVENTS
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.isolated import child
from lava_vpr.isolated.worker import report
from lava_vpr.loihi import DECAY_BITS
from lava_vpr.processes.base.encoders import EncoderProcess
from lava_vpr.processes.base.lava_checks import refuse_cpu_models
from lava_vpr.processes.base.magma import (
    FIXED_TAG,
    AbstractProcess,
    InPort,
    Loihi2HwCfg,
    Loihi2SimCfg,
    OutPort,
    RunConfig,
    RunSteps,
)
from lava_vpr.processes.base.shared_memory import shared_array
from lava_vpr.processes.encoders.process import BiasInputs, PoissonEncoder, RegularEncoder
from lava_vpr.processes.networks.process import FusedPlaceNetwork, PlaceNetwork
from lava_vpr.processes.spike_counter.process import SpikeCounter

REPORT_SECONDS = 0.5
"""Aim for the time between two reports; one return from Lava costs 1-2 ms."""

Arrays = dict[str, NDArray[Any]]
Emitted = NDArray[np.int64]


class RunTimes:
    """When each run of Lava began and ended, and what its processes held.

    `arrays` are ``runs`` float64 (runs, 3): presentations, begin and end in seconds of `time.monotonic`; the first
    run includes what Lava compiles and starts; and ``held`` int64 (1,): bytes of all processes after the last run, 0
    where that is not known.
    """

    def __init__(self, options: dict[str, Any]) -> None:
        self.wanted = bool(options.get("timed"))
        self.single = options.get("timed") == "single"
        self._rows: list[tuple[float, float, float]] = []
        self._held = 0

    def add(self, presentations: int, began: float) -> None:
        """Note a run of Lava that has just ended."""
        self._rows.append((float(presentations), began, time.monotonic()))

    def look(self) -> None:
        """Note how much memory is held, while Lava's processes are still there."""
        if self.wanted:
            self._held = child.held_by_family() or 0

    def arrays(self) -> Arrays:
        """The results ``runs`` and ``held`` for the caller; empty unless requested."""
        if not self.wanted:
            return {}
        return {"runs": np.array(self._rows, np.float64).reshape(-1, 3), "held": np.array([self._held], np.int64)}


def network_of(arrays: Arrays, options: dict[str, Any]) -> FixedNetwork:
    """The network that a job is asked to run."""
    weights, bias = np.ascontiguousarray(arrays["weights"], np.int16), np.asarray(arrays["bias"], np.int32)
    return FixedNetwork.of_scalars(weights, bias, options)


def _presented_biases(arrays: Arrays) -> NDArray[np.int32] | None:
    """The biases of each presentation, int32 (n, neurons); None: always the network's."""
    return np.ascontiguousarray(arrays["biases"], np.int32) if "biases" in arrays else None


class Way(NamedTuple):
    """How Lava runs a network.

    Attributes:
        tag: Tag of the models: ``fixed_pt`` or ``floating_pt``.
        library: Lava's own library instead of this project's models.
        board: On a Loihi 2 board instead of in simulation; of the library, too.
    """

    tag: str
    library: bool = False
    board: bool = False

    @property
    def floating(self) -> bool:
        """Whether models compute in floating point."""
        return self.tag != FIXED_TAG


ON_HOST = (PoissonEncoder, RegularEncoder, SpikeCounter)
"""Processes that run in Python beside a board, behind the vendor's adapters: they inject spikes, or count them."""


def begin(process: AbstractProcess, way: Way) -> RunConfig | None:
    """The configuration of a run; None on a board, for which the network is compiled and started here.

    Raises:
        BackendUnavailableError: a part of the network would run on the CPU instead of the board.
    """
    if not way.board:
        return Loihi2SimCfg(select_tag=way.tag, select_sub_proc_model=way.library)
    executable = refuse_cpu_models(process, Loihi2HwCfg(select_sub_proc_model=True), ON_HOST)
    process.create_runtime(executable=executable)
    return None


def play(
    process: AbstractProcess,
    units: int,
    steps: int,
    way: Way,
    presentations: int,
    batch: int = 1,
    clock: RunTimes | None = None,
) -> None:
    """Run Lava and report the presentations that are done.

    Args:
        process: Any of the Processes to run.
        units: Times that ``steps`` steps are run.
        steps: Lava steps of a unit.
        way: How Lava runs it.
        presentations: In all units together.
        batch: Presentations of a unit.
        clock: Clock started and stopped with every run.
    Raises:
        BackendUnavailableError: a part of the network would run on the CPU instead of the board.
    """
    clock = clock or RunTimes({})
    config = begin(process, way)
    done, chunk = 0, 1
    while done < units:
        size = min(chunk, units - done)
        began = time.monotonic()
        process.run(condition=RunSteps(num_steps=steps * size), run_cfg=config)
        elapsed = time.monotonic() - began
        presented = min(presentations, (done + size) * batch) - done * batch
        clock.add(presented, began)
        report(presented)
        if done and not clock.single:  # the first run includes what Lava compiles and starts
            chunk = max(1, min(2 * chunk, int(REPORT_SECONDS * size / elapsed)))
        done += size
    clock.look()
    # Only after a good end: where a model failed, Lava would wait for its peers for ever.
    process.stop()


def play_written(
    process: AbstractProcess,
    network: PlaceNetwork,
    presentations: int,
    way: Way,
    *,
    inputs: BiasInputs | None = None,
    biases: NDArray[np.int32] | None = None,
    clock: RunTimes | None = None,
) -> None:
    """Run Lava's library with pauses to write: ``inputs`` before the silent steps, ``biases`` between presentations.

    Args:
        process: Any of the Processes to run.
        network: The network that is presented to.
        presentations: Their number.
        way: How Lava runs it.
        inputs: Input compartments; None: inputs need no writing.
        biases: Biases of each presentation, int32 (n, neurons), of which the network has the first; None: they stay.
        clock: As in `play`.
    Raises:
        BackendUnavailableError: a part of the network would run on the CPU instead of the board.
    """
    spec, clock, waiting = network.network, clock or RunTimes({}), 0
    config = begin(process, way)

    def run(steps: int) -> int:
        process.run(condition=RunSteps(num_steps=steps), run_cfg=config)
        return 0

    for following in range(1, presentations + 1):
        began = time.monotonic()
        waiting += spec.steps
        if inputs is not None:
            waiting = run(waiting)
            inputs.write(min(following, presentations - 1))
        waiting += spec.silent_steps
        if biases is not None or following == presentations:
            waiting = run(waiting)
        if biases is not None and following < presentations:
            network.write_bias(biases[following], way.floating)
        clock.add(1, began)
        report(1)
    clock.look()
    process.stop()


def across(source: OutPort, target: InPort, adapter: str | None) -> None:
    """Connect two ports, through a spike adapter between processor and chip if one is named."""
    if adapter is None:
        source.connect(target)
        return
    # Intel's closed lava-loihi brings this module into Lava's own name space.
    from lava.proc.embedded_io import spike

    between = getattr(spike, adapter)(shape=source.shape)
    source.connect(between.inp)
    between.out.connect(target)


def input_spikes(rates: NDArray[np.uint16], keys: NDArray[np.uint64], steps: int) -> NDArray[np.int64]:
    """The number of spikes that each bias input sends in all presentations, by its definition; int64 (inputs,).

    For input compartments on a board, whose spikes do not leave it.
    """
    sent = (bias_input_spikes(shown, int(key), steps).sum(axis=0) for shown, key in zip(rates, keys, strict=True))
    return sum(sent, np.zeros(rates.shape[1], np.int64))


def _source(
    spec: FixedNetwork, rates: NDArray[np.uint16], keys: NDArray[np.uint64], emitted: Emitted | None
) -> BiasInputs | EncoderProcess:
    """What sends the network its input spikes."""
    injected = RegularEncoder if spec.regular else PoissonEncoder
    kind: type[BiasInputs | EncoderProcess] = BiasInputs if spec.bias_input else injected
    return kind(rates=rates, keys=keys, steps=spec.steps, silent_steps=spec.silent_steps, emitted=emitted)


def _wired(arrays: Arrays, options: dict[str, Any], library: bool) -> Arrays:
    """Inputs, network and counters; on a board, with the vendor's adapters between them."""
    spec, biases, clock = network_of(arrays, options), _presented_biases(arrays), RunTimes(options)
    network = PlaceNetwork(network=spec, bias=biases[:1] if library and biases is not None else biases)
    way = Way(str(options.get("tag", FIXED_TAG)), library, bool(options.get("board")))
    if way.board:
        need(spec.decay < 1 << DECAY_BITS, "decay", spec.decay, f"in 0..{(1 << DECAY_BITS) - 1} on a board")
    interval, board, record = spec.interval, way.board, bool(options.get("record"))
    rates, keys = np.ascontiguousarray(arrays["rates"], np.uint16), np.asarray(arrays["keys"], np.uint64)
    n, sent = len(rates), shared_array((spec.inputs,), np.int64)
    if n == 0:
        silent = np.zeros(spec.inhibitory, np.int64)
        return {"counts": np.zeros((0, spec.neurons), np.int32), "input_spikes": sent, "inh_spikes": silent}
    source = _source(spec, rates, keys, None if library and spec.bias_input else sent)
    written = source if library and isinstance(source, BiasInputs) else None
    inputs: OutPort = source.s_out
    across(inputs, network.s_in, "PyToNxAdapter" if board and not written else None)
    ports = {"exc": network.s_out, "inh": network.s_out_inh}
    if record or (written and not board):
        ports["inputs"] = inputs
    counts = {name: shared_array((n, *port.shape), np.int32) for name, port in ports.items()}
    result = {name: shared_array((n, interval, *port.shape), np.uint8) for name, port in ports.items() if record}
    for name, port in ports.items():
        counter = SpikeCounter(
            shape=port.shape, presentations=n, interval=interval, counts=counts[name], raster=result.get(name)
        )
        across(port, counter.s_in, "NxToPyAdapter" if board and (written or name != "inputs") else None)
    if library and (written is not None or biases is not None):
        play_written(source, network, n, way, inputs=written, biases=biases, clock=clock)
    else:
        play(source, n, interval, way, n, clock=clock)
    if written is not None:
        counted = counts["inputs"].sum(axis=0) if "inputs" in counts else input_spikes(rates, keys, spec.steps)
        sent = counted.astype(np.int64)
    fired = counts["inh"].sum(axis=0, dtype=np.int64)
    return {"counts": counts["exc"], "input_spikes": sent, "inh_spikes": fired, **result, **clock.arrays()}


def composed(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """The network composed of this project's Processes."""
    return _wired(arrays, options, library=False)


def library(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """The same with Lava's library in their place."""
    return _wired(arrays, options, library=True)


def fused(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """The network as one Process; integers only.

    Option ``batch`` (64): images of one Lava step; one if each is timed. Returns ``counts``, ``events`` int64 in the
    order of `EVENTS`, and with ``record`` the raster ``exc``: it has no other populations of its own.
    """
    spec = network_of(arrays, options)
    rates, keys = np.ascontiguousarray(arrays["rates"], np.uint16), np.asarray(arrays["keys"], np.uint64)
    n, interval = len(rates), spec.interval
    result: Arrays = {
        "counts": shared_array((n, spec.neurons), np.int32),
        "events": shared_array((len(EVENTS),), np.int64),
    }
    if options.get("record"):
        result["exc"] = shared_array((n, interval, spec.neurons), np.uint8)
    clock = RunTimes(options)
    if n:
        batch = 1 if clock.single else int(options.get("batch", 64))
        network = FusedPlaceNetwork(
            network=spec,
            rates=rates,
            keys=keys,
            bias=_presented_biases(arrays),
            batch=batch,
            counts=result["counts"],
            raster=result.get("exc"),
            events=result["events"],
            ahead=not clock.single,
        )
        play(network, network.batches, 1, Way(str(options.get("tag", FIXED_TAG))), n, batch, clock=clock)
    return result | clock.arrays()
