"""Training presentations in Lava, as a job for `lava_vpr.isolated.runner`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.learning.integer import IntegerLearning, WeightRule
from lava_vpr.engine.learning.lava_order import FoldedPhase, FoldedTrainer
from lava_vpr.engine.learning.stdp import PlasticState
from lava_vpr.isolated.worker import report
from lava_vpr.processes.base.magma import Loihi2SimCfg, RunSteps
from lava_vpr.processes.base.shared_memory import shared_array
from lava_vpr.processes.encoders.process import PoissonEncoder, RegularEncoder
from lava_vpr.processes.networks.process import LearningPlaceNetwork
from lava_vpr.processes.spike_counter.process import SpikeCounter

LEARNING, LIBRARY, FOLDED = (f"lava_vpr.processes.jobs.learning:{name}" for name in ("learning", "library", "folded"))
"""The targets of `learning`, `library` and `folded`."""


def learning_of(options: Mapping[str, Any]) -> IntegerLearning:
    """The phase of learning that `dataclasses.asdict` wrote."""
    rule = dict(options["rule"], products=tuple((int(m), int(e)) for m, e in options["rule"]["products"]))
    return IntegerLearning(**{**options, "rule": WeightRule(**rule), "neurons": LifParameters(**options["neurons"])})


class _Runtime:
    """`LearningPlaceNetwork` between an encoder and a counter, run presentation by presentation; stopped at its end.

    Attributes:
        network: The network.
        raster: Every spike of its neurons, uint8 (presentations, interval, neurons).
    """

    def __init__(
        self,
        phase: IntegerLearning,
        state: PlasticState,
        rates: NDArray[np.uint16],
        keys: NDArray[np.uint64],
        run: Loihi2SimCfg,
        /,
        **options: Any,
    ) -> None:
        """Wire the network of ``phase`` that begins with ``state``; ``options`` are more arguments of it."""
        self.network, self.run = LearningPlaceNetwork(learning=phase, state=state, **{"keys": keys, **options}), run
        shape, interval = state.theta.shape, phase.interval
        self.raster = shared_array((len(rates), interval, *shape), np.uint8)
        counter = SpikeCounter(shape=shape, presentations=len(rates), interval=interval, raster=self.raster)
        kind = RegularEncoder if phase.regular else PoissonEncoder
        encoder = kind(rates=rates, keys=keys, steps=phase.steps, silent_steps=phase.silent_steps)
        encoder.s_out.connect(self.network.s_in)
        self.network.s_out.connect(counter.s_in)

    def present(self) -> None:
        """Run one presentation."""
        self.network.run(condition=RunSteps(num_steps=self.network.interval), run_cfg=self.run)

    def __enter__(self) -> _Runtime:
        return self

    def __exit__(self, *_: object) -> None:
        self.network.stop()


def learning(arrays: Mapping[str, NDArray[Any]], options: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Show images to `LearningPlaceNetwork`, one presentation after another in one runtime of Lava.

    The run pauses after each presentation: thresholds are read, and with ``late_theta`` raised; a unit of progress is
    reported.

    Args:
        arrays: ``weights`` uint8 (inputs, neurons) and ``theta`` int32 (neurons,), the state at the start; ``rates``
            uint16 (n, inputs); ``keys`` uint64 (n,).
        options: ``learning``: the phase by `dataclasses.asdict`; optionally ``tag``: ``floating_pt`` instead of
            ``fixed_pt``.
    Returns:
        After each presentation ``weights`` (n, inputs, neurons) and ``traces`` (n, inputs), uint8 or float64, and
        ``theta`` (n, neurons), int64 or float64; ``raster`` uint8 (n, interval, neurons).
    """
    phase, tag = learning_of(options["learning"]), options.get("tag", "fixed_pt")
    state, rates, keys = PlasticState(arrays["weights"], arrays["theta"]), arrays["rates"], arrays["keys"]
    n, (inputs, neurons) = len(rates), state.weights.shape
    kind = np.uint8 if tag == "fixed_pt" else np.float64
    weights, traces = shared_array((n, neurons, inputs), kind), shared_array((n, inputs), kind)
    theta = np.zeros((n, neurons), np.int64 if tag == "fixed_pt" else np.float64)
    records = {"record_weights": weights, "record_traces": traces}
    with _Runtime(phase, state, rates, keys, Loihi2SimCfg(select_tag=tag), **records) as runtime:
        for k in range(n):
            runtime.present()
            if phase.late_theta:
                runtime.network.raise_thresholds(runtime.raster[k].sum(axis=0, dtype=np.int32))
            theta[k] = runtime.network.vth.get()
            report(1)
    return {"weights": weights.transpose(0, 2, 1), "theta": theta, "traces": traces, "raster": runtime.raster}


def library(arrays: Mapping[str, NDArray[Any]], options: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Show one image to `LearningPlaceNetwork` in Lava's library, or in this project's models with its random numbers.

    Args:
        arrays: ``weights`` uint8 (inputs, neurons) and ``theta`` int32 (neurons,); ``rates`` uint16 (1, inputs);
            ``keys`` uint64 (1,).
        options: ``learning``: the phase by `dataclasses.asdict`; ``rng_seed``; optionally ``own``: in this project's
            models.
    Returns:
        ``weights`` (inputs, neurons) and ``traces`` (inputs,) after it; ``raster`` uint8 (interval, neurons).
    """
    phase, state = learning_of(options["learning"]), PlasticState(arrays["weights"], arrays["theta"])
    run = Loihi2SimCfg(select_tag="fixed_pt", select_sub_proc_model=not options.get("own"))
    seed = options["rng_seed"]
    with _Runtime(phase, state, arrays["rates"], arrays["keys"], run, rng_seed=seed) as runtime:
        runtime.present()
        weights, traces = runtime.network.weights.get(), runtime.network.x1.get()
    return {"weights": weights.T, "traces": traces, "raster": runtime.raster[0]}


def folded(arrays: Mapping[str, NDArray[Any]], options: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Show one epoch, or its beginning, to `LearningPlaceNetwork` in Lava's library, as a host program does.

    Between presentations `engine.learning.lava_order.FoldedTrainer` normalises and folds; what it gives is written, and
    the traces are cleared. All is one run of Lava.

    Args:
        arrays: ``weights`` uint8 (inputs, neurons) and ``theta`` int32 (neurons,), the host's at the start of the
            epoch; ``rates`` uint16 (n, inputs); ``keys`` uint64 (n,).
        options: ``phases``: of each phase its ``chip`` by `dataclasses.asdict`, and the other fields of `FoldedPhase`;
            ``seeds``: Lava's ``rng_seed`` of each epoch; ``epoch``.
    Returns:
        Of each presentation the chip's ``weights`` (n, inputs, neurons) and ``traces`` (n, inputs) after it and the
        ``raster`` uint8 (n, interval, neurons); the host's ``host_weights`` and ``host_theta`` at the end.
    """
    phases = [FoldedPhase(**{**part, "chip": learning_of(part["chip"])}) for part in options["phases"]]
    state = PlasticState(arrays["weights"].copy(), arrays["theta"].copy())
    trainer, epoch = FoldedTrainer(phases, state, options["seeds"]), int(options["epoch"])
    trainer.begin_epoch(epoch)
    rates, keys, chip = arrays["rates"], arrays["keys"], trainer.phase.chip
    n, (inputs, neurons) = len(rates), state.weights.shape
    boundary = trainer.begin(int(keys[0]))
    start = PlasticState(boundary.weights, np.full(neurons, trainer.common, np.int32))
    run = Loihi2SimCfg(select_tag="fixed_pt", select_sub_proc_model=True)
    more = {"keys": keys[:1], "rng_seed": trainer.seeds[epoch], "mantissas": boundary.mantissas}
    weights, traces = np.zeros((n, inputs, neurons), np.uint8), np.zeros((n, inputs), np.uint8)
    with _Runtime(chip, start, rates, keys, run, **more) as runtime:
        network, raster = runtime.network, runtime.raster
        for k in range(n):
            if k:
                boundary = trainer.begin(int(keys[k]))
                network.weights.set(boundary.weights.T.astype(np.int32))
                network.set_laterals(boundary.mantissas)
                network.x1.set(np.zeros(inputs, np.int32))
            runtime.present()
            weights[k], traces[k] = network.weights.get().T, network.x1.get()
            trainer.end(boundary, weights[k], raster[k].sum(axis=0, dtype=np.int32))
            report(1)
    return {
        "weights": weights,
        "traces": traces,
        "raster": raster,
        "host_weights": state.weights,
        "host_theta": state.theta,
    }
