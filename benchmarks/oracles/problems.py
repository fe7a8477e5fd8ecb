"""Networks of LIF neurons and dense synapses in integers, what our engine makes of them, and the files they travel in.

A `Problem` says everything about a network and its input; `engine_result` runs it with the kernels of
``engine.general.lif``. Files are ``.npz`` without pickle, so that simulators in environments of their own can read
them with numpy alone (``benchmarks/oracles/*.py``)::

    spikes       bool (presentations, steps, inputs); every presentation starts from zero
    populations  int64 (populations, 5): size, du, dv, floor in units of v, hold_steps
    threshold_P, bias_P      int64 (size,) of population P; threshold in units of v >> 6, bias in units of v
    connections  int64 (connections, 5): source (-1: the inputs), target, bits, exponent, sign (1 mixed, 2 exc, 3 inh)
    weights_C    int64 (pre, post) of connection C, as given: what the low bits become is the simulator's business

and results hold spikes_P bool and v_P int32, both (presentations, steps, size).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.general.lif import NO_FLOOR, LifParameters, SignMode, dense_step, lif_step, stored_weights
from lava_vpr.errors import InputError
from lava_vpr.loihi import INPUT_SHIFT, THRESHOLD_LIMIT

SIGNS: dict[int, SignMode] = {1: "mixed", 2: "excitatory", 3: "inhibitory"}
MIXED, EXCITATORY, INHIBITORY = SIGNS
INPUTS = -1
"""Source of a connection from the inputs."""


@dataclass(frozen=True)
class OraclePopulation:
    """LIF neurons: ``threshold`` and ``bias`` int64 (size,); ``floor`` in units of v (`NO_FLOOR`: none)."""

    du: int
    dv: int
    threshold: NDArray[np.int64]
    bias: NDArray[np.int64]
    floor: int = NO_FLOOR
    hold_steps: int = 0

    @property
    def size(self) -> int:
        """The number of neurons in this population."""
        return len(self.threshold)


@dataclass(frozen=True)
class DenseConnection:
    """Dense synapses, ``weights`` int64 (pre, post) before their low bits are dropped."""

    source: int
    target: int
    weights: NDArray[np.int64]
    bits: int = 8
    exponent: int = 0
    sign: int = EXCITATORY


@dataclass(frozen=True)
class Problem:
    """A network and its input, bool (presentations, steps, inputs)."""

    name: str
    spikes: NDArray[np.bool_]
    populations: tuple[OraclePopulation, ...]
    connections: tuple[DenseConnection, ...]

    @property
    def neurons(self) -> int:
        """The number of neurons in all populations."""
        return sum(population.size for population in self.populations)


@dataclass(frozen=True)
class Result:
    """Spikes bool and membranes int32 of all populations side by side, (presentations, steps, neurons)."""

    spikes: NDArray[np.bool_]
    v: NDArray[np.int32]

    def differs(self, other: Result) -> bool:
        """Whether any spike or membrane of ``other`` is not the same as here."""
        return not (np.array_equal(self.spikes, other.spikes) and np.array_equal(self.v, other.v))


def engine_result(problem: Problem) -> Result:
    """What the kernels of ``lava_vpr.engine.general.lif`` make of ``problem``, each connection buffering one step."""
    presentations, steps, _ = problem.spikes.shape
    shape = (presentations, steps, problem.neurons)
    result = Result(np.zeros(shape, bool), np.zeros(shape, np.int32))
    rows = [stored_weights(c.weights, c.bits, SIGNS[c.sign]) for c in problem.connections]
    constants = [
        LifParameters(p.du, p.dv, None if p.floor == NO_FLOOR else p.floor >> INPUT_SHIFT, p.hold_steps).constants
        for p in problem.populations
    ]
    ends = np.cumsum([p.size for p in problem.populations])
    for spikes_in, film, film_v in zip(problem.spikes, result.spikes, result.v, strict=True):
        u, v, held = (np.zeros(problem.neurons, np.int32) for _ in range(3))
        drive, fired = np.zeros(problem.neurons, np.int64), np.zeros(problem.neurons, bool)
        parts = [slice(end - p.size, end) for p, end in zip(problem.populations, ends, strict=True)]
        before = np.zeros(spikes_in.shape[1], bool)
        for step in range(steps):
            drive[:] = 0
            for c, stored in zip(problem.connections, rows, strict=True):
                sums = np.zeros(stored.shape[1], np.int64)
                source = before if c.source == INPUTS else fired[parts[c.source]].copy()
                dense_step(stored, source, c.exponent, sums, np.zeros(len(sums), np.int32))
                drive[parts[c.target]] += sums
            for p, part, setting in zip(problem.populations, parts, constants, strict=True):
                threshold = p.threshold.astype(np.int32)
                lif_step(u[part], v[part], threshold, held[part], drive[part], p.bias, setting, fired[part])
            film[step], film_v[step] = fired, v
            before = spikes_in[step]
    return result


def write_problem(path: Path, problem: Problem) -> None:
    """Write ``problem`` as the module's docstring says."""
    arrays: dict[str, Any] = {
        "spikes": problem.spikes,
        "populations": np.array([[p.size, p.du, p.dv, p.floor, p.hold_steps] for p in problem.populations], np.int64),
        "connections": np.array(
            [[c.source, c.target, c.bits, c.exponent, c.sign] for c in problem.connections], np.int64
        ),
    }
    for i, p in enumerate(problem.populations):
        arrays |= {f"threshold_{i}": p.threshold, f"bias_{i}": p.bias}
    arrays |= {f"weights_{i}": c.weights for i, c in enumerate(problem.connections)}
    np.savez_compressed(path, **arrays)


def read_result(path: Path, problem: Problem) -> Result:
    """The result that a simulator wrote for ``problem``.

    Raises:
        InputError: the file is missing or holds arrays of other shapes.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            spikes = [arrays[f"spikes_{i}"] for i in range(len(problem.populations))]
            v = [arrays[f"v_{i}"] for i in range(len(problem.populations))]
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path.name}: no result of {problem.name} ({error}); run the simulator again") from None
    shapes = [(*problem.spikes.shape[:2], p.size) for p in problem.populations]
    if [a.shape for a in spikes] != shapes or [a.shape for a in v] != shapes:
        raise InputError(f"{path.name}: arrays of another shape than {problem.name} has; run the simulator again")
    return Result(np.concatenate(spikes, axis=2).astype(bool), np.concatenate(v, axis=2))


def edge_problem(name: str, sign: int) -> Problem:
    """One neuron whose current climbs to exactly 2^23 (``sign`` 1) or -2^23 (-1), the edge of its register.

    With du = 0, 64 x 4096 m decays to 64 x (4096 m - m); inputs of 4096 j + m bring it to 64 x 4096 (m + j). Inputs 0
    and 1 give 7 and 4 times 4096, the others the m = 7, 14, 21, 28 that decayed. Then the current leaves the edge.
    """
    spikes = np.zeros((1, 14, 6), bool)
    for step in range(5):
        spikes[0, step, [0 if step < 4 else 1, *([step + 1] if step else [])]] = True
    coarse = np.array([[7 << 5], [4 << 5], [0], [0], [0], [0]], np.int64)
    fine = np.array([[0], [0], [7], [14], [21], [28]], np.int64)
    mode = EXCITATORY if sign > 0 else INHIBITORY
    connections = (
        DenseConnection(INPUTS, 0, sign * coarse, 8, 7, mode),
        DenseConnection(INPUTS, 0, sign * fine, 8, 0, mode),
    )
    neuron = OraclePopulation(0, 4096, np.array([THRESHOLD_LIMIT - 2], np.int64), np.zeros(1, np.int64))
    return Problem(name, spikes, (neuron,), connections)
