"""Random networks for the oracles: within what a simulator's arithmetic shares with ours, and beyond it.

A network is *common* when none of the simulator's rules (`benchmarks.oracles.rules`) changes a spike or a membrane of
it, by our own plain arithmetic and before the simulator is asked. There the simulator has to agree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.oracles.problems import (
    EXCITATORY,
    INHIBITORY,
    INPUTS,
    MIXED,
    DenseConnection,
    OraclePopulation,
    Problem,
    Result,
    edge_problem,
    engine_result,
)
from benchmarks.oracles.rules import CURRENT_UNBOUNDED, MEMBRANE_UNBOUNDED, RULES, literal
from lava_vpr.engine.general.lif import NO_FLOOR, bias_of
from lava_vpr.errors import InputError
from lava_vpr.loihi import INPUT_SHIFT, THRESHOLD_LIMIT

Whole = NDArray[np.int64]


@dataclass(frozen=True)
class Dialect:
    """What networks a simulator can hold.

    Attributes:
        bits: Widths of a weight.
        lowest: Lowest weight exponent (the highest is 7).
        bias: Whether it has biases, floors, and a threshold for each neuron.
    """

    bits: tuple[int, ...]
    lowest: int
    bias: bool


DIALECTS = {
    "brian2-loihi": Dialect((1, 2, 3, 4, 5, 6, 7, 8), -8, False),
    "nengo-loihi": Dialect((1, 2, 3, 4, 5, 6, 8), -7, True),
}
WIRINGS: tuple[tuple[tuple[int, int], ...], ...] = (
    ((INPUTS, 0),),
    ((INPUTS, 0), (0, 0)),
    ((INPUTS, 0), (0, 1)),
    ((INPUTS, 0), (0, 1), (1, 0)),
    ((INPUTS, 0), (INPUTS, 0), (0, 0)),
)
"""(source, target) of each connection: alone, recurrent, in a row, in a loop, two synapse groups."""


@dataclass(frozen=True)
class NetworkStyle:
    """``rough`` weights have bits that get lost; ``strong`` ones reach the ends of the registers."""

    rough: bool
    strong: bool


def _weights(rng: np.random.Generator, shape: tuple[int, int], c: DenseConnection, style: NetworkStyle) -> Whole:
    """Whole weights that suit the connection's sign; whole in its units, too, unless ``rough``."""
    size = rng.integers(0, 256, shape) * (rng.random(shape) < rng.uniform(0.3, 1.0))
    if style.strong:
        size[rng.random(shape) < 0.1] = 255
    if not style.rough:
        drop = 8 - c.bits + (1 if c.sign == MIXED else 0)
        unit = 1 << min(7, max(drop, -c.exponent))
        size = size // unit * unit
    if c.sign == EXCITATORY:
        return size
    if c.sign == INHIBITORY:
        return -size
    signed = np.where(rng.random(shape) < 0.4, -size, np.minimum(size, 254))
    if style.rough and style.strong:
        signed[rng.random(shape) < 0.1] = -256
    return signed


def _connection(
    rng: np.random.Generator, source: int, target: int, dialect: Dialect, style: NetworkStyle
) -> DenseConnection:
    """A connection without weights yet."""
    sign = rng.choice([EXCITATORY, MIXED] if source < target else [INHIBITORY, MIXED])
    low, high = (3, 8) if style.strong else (dialect.lowest, 3)
    return DenseConnection(
        source,
        target,
        np.zeros((0, 0), np.int64),
        int(rng.choice(dialect.bits)),
        int(rng.integers(low, high)),
        int(sign),
    )


def _population(rng: np.random.Generator, dialect: Dialect, style: NetworkStyle) -> OraclePopulation:
    """Neurons whose threshold is still to be found."""
    size = int(rng.integers(3, 13))
    du = rng.choice([4095, rng.integers(0, 4095), rng.integers(0, 300)])
    dv = rng.choice([0, 4096, 137, rng.integers(1, 4096), rng.integers(1, 300)])
    bias, floor = np.zeros(size, np.int64), NO_FLOOR
    if dialect.bias:
        exponent = rng.integers(0, 8 if style.strong else 4, size)
        bias = bias_of(rng.integers(-4096, 4096, size) * (rng.random(size) < 0.5), exponent)
        floor = NO_FLOOR if rng.random() < 0.7 else -int(rng.integers(0, 1 << 15)) << INPUT_SHIFT
    hold = int(rng.integers(1, 6)) if rng.random() < 0.4 else 0
    return OraclePopulation(int(du), int(dv), np.ones(size, np.int64), bias, floor, hold)


def _lively(problem: Problem, result: Result) -> bool:
    """Whether every population spikes, and no more than in 40 % of its steps."""
    ends = np.cumsum([p.size for p in problem.populations])
    films = np.split(result.spikes, ends[:-1], axis=2)
    return all(film.sum() >= 5 and film.mean() <= 0.4 for film in films)


def _candidate(
    rng: np.random.Generator, name: str, dialect: Dialect, style: NetworkStyle
) -> tuple[Problem, Result] | None:
    """A network with thresholds at which it is lively, or None if a few tries find none."""
    wiring = WIRINGS[int(rng.integers(len(WIRINGS)))]
    inputs, steps = int(rng.integers(6, 41)), int(rng.integers(60, 151))
    spikes = rng.random((1, steps, inputs)) < rng.uniform(0.02, 0.4)
    populations = [_population(rng, dialect, style) for _ in range(1 + max(target for _, target in wiring))]
    connections = []
    for source, target in wiring:
        bare = _connection(rng, source, target, dialect, style)
        pre = inputs if source == INPUTS else populations[source].size
        weights = _weights(rng, (pre, populations[target].size), bare, style)
        connections.append(replace(bare, weights=weights.astype(np.int64)))
    for _ in range(12):
        tuned = []
        for p in populations:
            middle = THRESHOLD_LIMIT ** rng.uniform(0.2, 1.0)
            thresholds = middle * rng.uniform(0.7, 1.3, p.size) if dialect.bias else np.full(p.size, middle)
            tuned.append(replace(p, threshold=thresholds.astype(np.int64).clip(0, THRESHOLD_LIMIT - 1)))
        problem = Problem(name, spikes, tuple(tuned), tuple(connections))
        result = engine_result(problem)
        if _lively(problem, result):
            return problem, result
    return None


def is_common(problem: Problem, expected: Result, simulator: str) -> bool:
    """Whether none of the simulator's rules changes anything in ``problem``."""
    return not literal(problem, RULES[simulator]).differs(expected)


def reaches_limits(problem: Problem, expected: Result) -> bool:
    """Whether a current wraps or a membrane is clipped."""
    return literal(problem, (CURRENT_UNBOUNDED, MEMBRANE_UNBOUNDED)).differs(expected)


def random_networks(
    simulator: str, count: int, *, common: bool, limits: bool = False, seed: int = 0
) -> list[tuple[Problem, Result]]:
    """``count`` lively random networks with what our engine makes of them.

    Args:
        simulator: Key of `DIALECTS`.
        count: How many networks.
        common: Within what the simulator shares with us, or beyond it.
        limits: Only networks in which a current wraps or a membrane is clipped.
        seed: The seed of everything drawn.
    Raises:
        InputError: no such networks are found.
    """
    rng = np.random.default_rng([seed, list(DIALECTS).index(simulator), common, limits])
    networks: list[tuple[Problem, Result]] = []
    for trial in range(200 * (count + 1)):
        if len(networks) == count:
            return networks
        style = NetworkStyle(not common and trial % 3 != 0, limits or (not common and trial % 3 != 1))
        name = f"random {'common' if common else 'beyond'}{' limits' if limits else ''} {len(networks)}"
        made = _candidate(rng, name, DIALECTS[simulator], style)
        if made is None or is_common(*made, simulator) != common or (limits and not reaches_limits(*made)):
            continue
        networks.append(made)
    raise InputError(f"{simulator}: only {len(networks)} of {count} random networks found; ask for fewer")


def edge_networks() -> list[tuple[Problem, Result]]:
    """Networks whose currents reach exactly +-2^23."""
    problems = [edge_problem("current of 2^23", 1), edge_problem("current of -2^23", -1)]
    return [(problem, engine_result(problem)) for problem in problems]
