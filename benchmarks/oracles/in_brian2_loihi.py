"""Runs problems in brian2-loihi: python in_brian2_loihi.py FOLDER (environment: `make oracles`).

Reads every ``*.problem.npz`` (`benchmarks.oracles.problems` has the format) and writes ``*.result.npz`` beside it.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # regular expressions written without r""
    import brian2
    from brian2_loihi import (
        LoihiNetwork,
        LoihiNeuronGroup,
        LoihiSpikeGeneratorGroup,
        LoihiSpikeMonitor,
        LoihiStateMonitor,
        LoihiSynapses,
    )


def neurons(problem: Any, index: int) -> LoihiNeuronGroup:
    """Population ``index`` for brian2-loihi, with one threshold, and with neither bias nor floor."""
    size, du, dv, floor, hold = (int(x) for x in problem["populations"][index])
    thresholds = np.unique(problem[f"threshold_{index}"])
    if len(thresholds) > 1 or problem[f"bias_{index}"].any() or floor != -(1 << 23):
        raise SystemExit("brian2-loihi has one threshold a population, and neither bias nor floor")
    # Its decay of the current has the chip's extra 1 already; a refractory period of 1 step is none.
    return LoihiNeuronGroup(size, refractory=hold + 1, threshold_v_mant=int(thresholds[0]), decay_v=dv, decay_I=du + 1)


def inputs(spikes: np.ndarray) -> LoihiSpikeGeneratorGroup:
    """The input spikes, each one step later: its generators reach neurons without the step that a connection takes."""
    _, steps, size = spikes.shape
    presentation, step, index = np.nonzero(spikes[:, :-1])
    return LoihiSpikeGeneratorGroup(size, index, presentation * steps + step + 1)


def synapses(problem: Any, index: int, generator: Any, groups: list[Any]) -> LoihiSynapses | None:
    """Connection ``index``; none if all its weights are 0."""
    source, target, bits, exponent, sign = (int(x) for x in problem["connections"][index])
    weights = problem[f"weights_{index}"]
    pre, post = np.nonzero(weights)
    if not len(pre):
        return None
    made = LoihiSynapses(
        generator if source < 0 else groups[source],
        groups[target],
        w_exp=exponent,
        sign_mode=sign,
        num_weight_bits=bits,
    )
    made.connect(i=pre, j=post)
    made.w = weights[pre, post]
    return made


def run(problem: Any) -> dict[str, np.ndarray]:
    """Spikes and membranes of every population."""
    spikes = problem["spikes"]
    presentations, steps, _ = spikes.shape
    groups = [neurons(problem, i) for i in range(len(problem["populations"]))]
    generator = inputs(spikes)
    made = [synapses(problem, i, generator, groups) for i in range(len(problem["connections"]))]
    events = [LoihiSpikeMonitor(group) for group in groups]
    states = [LoihiStateMonitor(group, "v") for group in groups]
    network = LoihiNetwork(generator, *groups, *(s for s in made if s is not None), *events, *states)
    for _ in range(presentations):
        for group in groups:
            group.v, group.I = 0, 0
        network.run(steps)
    result = {}
    for i, (group, event, state) in enumerate(zip(groups, events, states)):  # noqa: B905
        shape = (presentations, steps, len(group))
        raster = np.zeros(shape, bool)
        # Its monitors turn seconds into steps by truncation, which loses one here and there.
        time = np.rint(np.asarray(event.t_) * 1000).astype(int)
        raster.reshape(-1, len(group))[time, np.asarray(event.i)] = True
        v = np.asarray(state.v)
        if (v != np.rint(v)).any():
            raise SystemExit("a membrane of brian2-loihi is not a whole number")
        result |= {f"spikes_{i}": raster, f"v_{i}": v.T.astype(np.int64).reshape(shape)}
    return result


def main(folder: str) -> None:
    """Run every problem of ``folder`` and write its result beside it."""
    brian2.prefs.codegen.target = "numpy"  # compiling each network's constants takes longer than running it
    for path in sorted(Path(folder).glob("*.problem.npz")):
        with np.load(path, allow_pickle=False) as problem:
            arrays = run({name: problem[name] for name in problem.files})
        np.savez_compressed(path.with_name(path.name.replace(".problem.", ".result.")), **arrays)


if __name__ == "__main__":
    main(*sys.argv[1:])
