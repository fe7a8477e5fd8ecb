"""Training presentations in Lava, as a job for `lava_vpr.isolated.runner`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from lava.magma.core.run_conditions import RunSteps
from lava.magma.core.run_configs import Loihi2SimCfg
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.learning.integer import IntegerLearning, IntegerState, Rule
from lava_vpr.engine.learning.lava_order import FoldedPhase, FoldedTrainer
from lava_vpr.isolated.worker import report
from lava_vpr.processes.base.encoders import EncoderProcess
from lava_vpr.processes.base.shared_memory import shared_array
from lava_vpr.processes.networks.learning_place_network.process import LearningPlaceNetwork
from lava_vpr.processes.poisson_encoder.process import PoissonEncoder
from lava_vpr.processes.regular_encoder.process import RegularEncoder
from lava_vpr.processes.spike_counter.process import SpikeCounter

LEARNING, LIBRARY, FOLDED = (f"lava_vpr.processes.jobs.learning:{name}" for name in ("learning", "library", "folded"))
"""The targets of `learning`, `library` and `folded`."""


def options_of(learning: IntegerLearning) -> dict[str, Any]:
    """A phase of learning as JSON values."""
    return asdict(learning)


def learning_of(options: Mapping[str, Any]) -> IntegerLearning:
    """The phase of learning that `options_of` wrote."""
    rule = dict(options["rule"], products=tuple((int(m), int(e)) for m, e in options["rule"]["products"]))
    return IntegerLearning(**{**options, "rule": Rule(**rule), "neurons": LifParameters(**options["neurons"])})


def _encoder(phase: IntegerLearning, rates: NDArray[np.uint16], keys: NDArray[np.uint64]) -> EncoderProcess:
    """What sends the input spikes of the presentations of ``phase``."""
    kind = RegularEncoder if phase.regular else PoissonEncoder
    return kind(rates=rates, keys=keys, steps=phase.steps, silent_steps=phase.silent_steps)


def learning(arrays: Mapping[str, NDArray[Any]], options: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Show images to `LearningPlaceNetwork`, one presentation after another in one runtime of Lava.

    The run pauses after each presentation: thresholds are read, and with ``late_theta`` raised; a unit of progress is
    reported.

    Args:
        arrays: ``weights`` uint8 (inputs, neurons) and ``theta`` int32 (neurons,), the state at the start; ``rates``
            uint16 (n, inputs); ``keys`` uint64 (n,).
        options: ``learning``: `options_of` the phase; optionally ``tag``: ``floating_pt`` instead of ``fixed_pt``.
    Returns:
        After each presentation ``weights`` (n, inputs, neurons) and ``traces`` (n, inputs), uint8 or float64, and
        ``theta`` (n, neurons), int64 or float64; ``raster`` uint8 (n, interval, neurons).
    """
    phase, tag = learning_of(options["learning"]), options.get("tag", "fixed_pt")
    state = IntegerState(arrays["weights"], arrays["theta"])
    rates, keys = arrays["rates"], arrays["keys"]
    n, (inputs, neurons) = len(rates), state.weights.shape
    kind = np.uint8 if tag == "fixed_pt" else np.float64
    weights, traces = shared_array((n, neurons, inputs), kind), shared_array((n, inputs), kind)
    theta = np.zeros((n, neurons), np.int64 if tag == "fixed_pt" else np.float64)
    encoder = _encoder(phase, rates, keys)
    network = LearningPlaceNetwork(learning=phase, state=state, keys=keys, record_weights=weights, record_traces=traces)
    raster = shared_array((n, network.interval, neurons), np.uint8)
    counter = SpikeCounter(shape=(neurons,), presentations=n, interval=network.interval, raster=raster)
    encoder.s_out.connect(network.s_in)
    network.s_out.connect(counter.s_in)
    config = Loihi2SimCfg(select_tag=tag)
    try:
        for k in range(n):
            network.run(condition=RunSteps(num_steps=network.interval), run_cfg=config)
            if phase.late_theta:
                network.raise_thresholds(raster[k].sum(axis=0, dtype=np.int32))
            theta[k] = network.vth.get()
            report(1)
    finally:
        network.stop()
    return {"weights": weights.transpose(0, 2, 1), "theta": theta, "traces": traces, "raster": raster}


def library(arrays: Mapping[str, NDArray[Any]], options: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Show one image to `LearningPlaceNetwork` in Lava's library, or in this project's models with its random numbers.

    Args:
        arrays: ``weights`` uint8 (inputs, neurons) and ``theta`` int32 (neurons,); ``rates`` uint16 (1, inputs);
            ``keys`` uint64 (1,).
        options: ``learning``: `options_of` the phase; ``rng_seed``; optionally ``own``: in this project's models.
    Returns:
        ``weights`` (inputs, neurons) and ``traces`` (inputs,) after it; ``raster`` uint8 (interval, neurons).
    """
    phase = learning_of(options["learning"])
    state = IntegerState(arrays["weights"], arrays["theta"])
    encoder = _encoder(phase, arrays["rates"], arrays["keys"])
    network = LearningPlaceNetwork(learning=phase, state=state, keys=arrays["keys"], rng_seed=options["rng_seed"])
    raster = shared_array((1, network.interval, len(state.theta)), np.uint8)
    counter = SpikeCounter(shape=state.theta.shape, presentations=1, interval=network.interval, raster=raster)
    encoder.s_out.connect(network.s_in)
    network.s_out.connect(counter.s_in)
    config = Loihi2SimCfg(select_tag="fixed_pt", select_sub_proc_model=not options.get("own"))
    try:
        network.run(condition=RunSteps(num_steps=network.interval), run_cfg=config)
        weights, traces = network.weights.get(), network.x1.get()
    finally:
        network.stop()
    return {"weights": weights.T, "traces": traces, "raster": raster[0]}


def folded(arrays: Mapping[str, NDArray[Any]], options: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Show one epoch, or its beginning, to `LearningPlaceNetwork` in Lava's library, as a host program does.

    Between presentations `engine.learning.lava_order.FoldedTrainer` normalises and folds; what it gives is written, and
    the traces are cleared. All is one run of Lava.

    Args:
        arrays: ``weights`` uint8 (inputs, neurons) and ``theta`` int32 (neurons,), the host's at the start of the
            epoch; ``rates`` uint16 (n, inputs); ``keys`` uint64 (n,).
        options: ``phases``: of each phase `options_of` its ``chip``, and the other fields of `FoldedPhase`; ``seeds``:
            Lava's ``rng_seed`` of each epoch; ``epoch``.
    Returns:
        Of each presentation the chip's ``weights`` (n, inputs, neurons) and ``traces`` (n, inputs) after it and the
        ``raster`` uint8 (n, interval, neurons); the host's ``host_weights`` and ``host_theta`` at the end.
    """
    phases = [FoldedPhase(**{**part, "chip": learning_of(part["chip"])}) for part in options["phases"]]
    state = IntegerState(arrays["weights"].copy(), arrays["theta"].copy())
    trainer, epoch = FoldedTrainer(phases, state, options["seeds"]), int(options["epoch"])
    trainer.begin_epoch(epoch)
    rates, keys, chip = arrays["rates"], arrays["keys"], trainer.phase.chip
    n, (inputs, neurons) = len(rates), state.weights.shape
    boundary = trainer.begin(int(keys[0]))
    start = IntegerState(boundary.weights, np.full(neurons, trainer.common, np.int32))
    encoder = _encoder(chip, rates, keys)
    network = LearningPlaceNetwork(
        learning=chip, state=start, keys=keys[:1], rng_seed=trainer.seeds[epoch], mantissas=boundary.mantissas
    )
    raster = shared_array((n, network.interval, neurons), np.uint8)
    counter = SpikeCounter(shape=(neurons,), presentations=n, interval=network.interval, raster=raster)
    encoder.s_out.connect(network.s_in)
    network.s_out.connect(counter.s_in)
    config = Loihi2SimCfg(select_tag="fixed_pt", select_sub_proc_model=True)
    weights, traces = np.zeros((n, inputs, neurons), np.uint8), np.zeros((n, inputs), np.uint8)
    try:
        for k in range(n):
            if k:
                boundary = trainer.begin(int(keys[k]))
                network.weights.set(boundary.weights.T.astype(np.int32))
                network.set_laterals(boundary.mantissas)
                network.x1.set(np.zeros(inputs, np.int32))
            network.run(condition=RunSteps(num_steps=network.interval), run_cfg=config)
            weights[k], traces[k] = network.weights.get().T, network.x1.get()
            trainer.end(boundary, weights[k], raster[k].sum(axis=0, dtype=np.int32))
            report(1)
    finally:
        network.stop()
    return {
        "weights": weights,
        "traces": traces,
        "raster": raster,
        "host_weights": state.weights,
        "host_theta": state.theta,
    }
