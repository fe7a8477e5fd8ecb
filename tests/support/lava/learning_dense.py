"""Runs Lava's LearningDense and our PlasticDense, in a child process.

Used by engine and processes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from lava.magma.core.learning.learning_rule import Loihi2FLearningRule
from lava.proc.dense.models import PyLearningDenseModelBitApproximate
from lava.proc.dense.process import LearningDense
from lava.proc.io.source import RingBuffer
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray

from lava_vpr.engine.learning.integer import WeightRule
from lava_vpr.loihi import TRACE_LIMIT
from lava_vpr.processes.base.magma import Loihi2SimCfg, RunSteps
from lava_vpr.processes.base.shared_memory import shared_array
from lava_vpr.processes.plastic_dense.process import FloatRule, PlasticDense, PyPlasticDenseFixed


class RecordingLearningDense(PyLearningDenseModelBitApproximate):
    """Lava's fixed-point model; keeps weights, traces and sums of every step."""

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.film = proc_params["film"]

    def run_lrn(self) -> None:
        super().run_lrn()
        for name, film in self.film.items():
            film[self.time_step - 1] = getattr(self, name)


class RecordingPlasticDense(PyPlasticDenseFixed):
    """Ours; keeps the same."""

    def __init__(self, proc_params: Any) -> None:
        super().__init__(proc_params)
        self.film = proc_params["film"]

    def run_spk(self) -> None:
        super().run_spk()
        for name, film in self.film.items():
            film[self.time_step - 1] = getattr(self, name)


def compare(arrays: Mapping[str, NDArray[Any]], options: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Start Lava several times, each with one LearningDense and one PlasticDense for every rule.

    Args:
        arrays: ``pre`` (starts, steps, inputs) and ``post`` (starts, steps, neurons) spikes; ``weights`` (starts,
            rules, neurons, inputs).
        options: ``starts``: of each start the ``rules`` (arguments of `WeightRule`), ``seeds`` (rng_seed of each rule)
            and ``weight_exp``.
    Returns:
        For kind ``library`` and ``ours``: kind_weights (starts, rules, steps, neurons, inputs), kind_x1 (.., inputs),
        kind_a_buff (.., neurons), all after each step.
    """
    results = [
        _start(arrays["pre"][k], arrays["post"][k], arrays["weights"][k], options["starts"][k])
        for k in range(len(arrays["pre"]))
    ]
    return {name: np.stack([result[name] for result in results]) for name in results[0]}


def _start(
    pre: NDArray[Any], post: NDArray[Any], weights: NDArray[Any], options: Mapping[str, Any]
) -> dict[str, NDArray[Any]]:
    """One start of Lava."""
    steps, inputs, neurons = len(pre), pre.shape[1], post.shape[1]
    sizes = {"weights": (neurons, inputs), "x1": (inputs,), "a_buff": (neurons,)}
    films: dict[str, NDArray[Any]] = {
        f"{kind}_{name}": shared_array((len(weights), steps, *size), np.int32)
        for kind in ("library", "ours")
        for name, size in sizes.items()
    }
    source, feedback = RingBuffer(data=pre.T.astype(int)), RingBuffer(data=post.T.astype(int))
    for k, (given, seed) in enumerate(zip(options["rules"], options["seeds"], strict=True)):
        rule = WeightRule(tuple(tuple(p) for p in given["products"]), given["target"], given["mu"], given["tau"])
        library_rule = Loihi2FLearningRule(
            dw=rule.microcode(), x1_impulse=TRACE_LIMIT, x1_tau=rule.tau, t_epoch=1, rng_seed=seed
        )
        library = LearningDense(
            weights=weights[k].astype(int),
            learning_rule=library_rule,
            sign_mode=SignMode.EXCITATORY,
            weight_exp=options["weight_exp"],
            film={name: films[f"library_{name}"][k] for name in sizes},
        )
        ours = PlasticDense(
            weights=weights[k],
            rule=rule,
            rng_seed=seed,
            weight_exp=options["weight_exp"],
            film={name: films[f"ours_{name}"][k] for name in sizes},
        )
        for connection, post_port in ((library, library.s_in_bap), (ours, ours.s_in_post)):
            source.s_out.connect(connection.s_in)
            feedback.s_out.connect(post_port)
    models = {LearningDense: RecordingLearningDense, PlasticDense: RecordingPlasticDense}
    try:
        source.run(
            condition=RunSteps(num_steps=steps),
            run_cfg=Loihi2SimCfg(select_tag="fixed_pt", exception_proc_model_map=models),
        )
    finally:
        source.stop()
    return films


def float_rule(arrays: Mapping[str, NDArray[Any]], options: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """A PlasticDense with a `FloatRule`.

    Args:
        arrays: ``pre`` (k, inputs) and ``post`` (k, neurons) spikes of whole presentations; ``weights``; ``keys``.
        options: ``tag``; ``rule``: arguments of `FloatRule`; ``plastic``: further arguments of `PlasticDense`.
    Returns:
        ``weights`` and ``traces`` after each presentation, ``x1`` and ``a_buff`` at the end.
    """
    pre, post, weights, keys = (arrays[name] for name in ("pre", "post", "weights", "keys"))
    records = {
        "record_weights": shared_array((len(keys), *weights.shape), float),
        "record_traces": shared_array((len(keys), weights.shape[1]), float),
    }
    source, feedback = RingBuffer(data=pre.T.astype(int)), RingBuffer(data=post.T.astype(int))
    plastic = PlasticDense(
        weights=weights, rule=FloatRule(**options["rule"]), keys=keys, **options["plastic"], **records
    )
    source.s_out.connect(plastic.s_in)
    feedback.s_out.connect(plastic.s_in_post)
    try:
        source.run(condition=RunSteps(num_steps=len(pre)), run_cfg=Loihi2SimCfg(select_tag=options["tag"]))
        x1, sums = plastic.x1.get(), plastic.a_buff.get()
    finally:
        source.stop()
    return {"weights": records["record_weights"], "traces": records["record_traces"], "x1": x1, "a_buff": sums}
