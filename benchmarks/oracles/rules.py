"""This project's arithmetic written out plainly, with each rule in which another simulator differs as a switch.

`literal` without rules says what ``engine.general.lif`` says; with the rules of a simulator it has to say what that
simulator says, spike for spike and membrane for membrane. So a difference counts as explained only by the rules that
reproduce it exactly (`explain`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import chain, combinations

import numpy as np
from numpy.typing import NDArray

from benchmarks.oracles.problems import INHIBITORY, INPUTS, MIXED, DenseConnection, OraclePopulation, Problem, Result

Whole = NDArray[np.int64]
TOP = 1 << 23

# Of brian2-loihi 0.5.2.
CURRENT_UNBOUNDED = "the current is not wrapped into 24 bits"
MEMBRANE_UNBOUNDED = "the membrane is not clipped to 24 bits"
MIXED_TOWARDS_ZERO = "mixed weights lose low bits towards 0 (ours: downwards)"
EACH_WEIGHT_SHIFTED = "each weight is shifted down by the exponent (ours: their sum)"
WEIGHT_LIMITED = "one weight brings at most 2^21 - 2^6"

# Of nengo-loihi 1.1.0's emulator.
ACCUMULATOR = "the inputs of a step add up in 22 bits and wrap at 2^21"
COMPLEMENT = "+-2^23 wraps to -2^23 (ours: both to +2^23)"
BIAS_WRAPS = "current + bias wraps at 24 bits (ours: the membrane is clipped)"
WEIGHTS_ROUNDED = "low bits of weights are rounded, symmetrically (ours: cut off)"
EACH_WEIGHT_ROUNDED = "each weight is shifted down and rounded (ours: their sum is shifted)"

RULES: dict[str, tuple[str, ...]] = {
    "brian2-loihi": (
        CURRENT_UNBOUNDED,
        MEMBRANE_UNBOUNDED,
        MIXED_TOWARDS_ZERO,
        EACH_WEIGHT_SHIFTED,
        WEIGHT_LIMITED,
    ),
    "nengo-loihi": (ACCUMULATOR, COMPLEMENT, BIAS_WRAPS, WEIGHTS_ROUNDED, EACH_WEIGHT_ROUNDED),
}
"""Simulator -> everything in which its arithmetic differs from ours."""


def truncated(x: Whole, factor: int) -> Whole:
    """x times ``factor`` / 2^12, towards zero."""
    return np.sign(x) * (np.abs(x) * factor // 4096)


def complement(x: Whole, bits: int) -> Whole:
    """x wrapped into ``bits`` bits and sign, as two's complement."""
    return (x + (1 << bits)) % (2 << bits) - (1 << bits)


def synapse_weights(c: DenseConnection, rules: frozenset[str]) -> tuple[Whole, int]:
    """What is added up for a spike (pre, post), and the exponent by which the sum is shifted then."""
    drop = 8 - c.bits + (1 if c.sign == MIXED else 0)
    unit, highest = 1 << drop, (1 << (8 - drop)) - 1
    if WEIGHTS_ROUNDED in rules:
        steps = np.rint(c.weights / unit).astype(np.int64).clip(-highest, highest)
    elif c.sign == INHIBITORY or MIXED_TOWARDS_ZERO in rules:
        steps = np.sign(c.weights) * (np.abs(c.weights) // unit)
    else:
        steps = c.weights // unit
    exponent = c.exponent
    if exponent < 0 and EACH_WEIGHT_SHIFTED in rules:
        steps, unit, exponent = steps * unit >> -exponent, 1, 0
    if exponent < 0 and EACH_WEIGHT_ROUNDED in rules:
        # Bits below the weight's own are rounded, held within its range once more, and shifted out.
        lost = max(-exponent - drop, 0)
        rounded = (np.rint(steps / 2**lost).astype(np.int64) << lost).clip(-highest, highest) if lost else steps
        steps, unit, exponent = rounded * unit >> -exponent, 1, 0
    weights = steps * unit
    if WEIGHT_LIMITED in rules and exponent >= 0:
        limit = (1 << 15) - 1
        weights, exponent = (weights << exponent).clip(-limit, limit), 0
    return weights, exponent


def _current(u: Whole, drive: Whole, p: OraclePopulation, rules: frozenset[str]) -> Whole:
    """The currents of the next step."""
    charge = complement(drive << 6, 21) if ACCUMULATOR in rules else drive << 6
    u = truncated(u, 4096 - (p.du + 1)) + charge
    if CURRENT_UNBOUNDED in rules:
        return u
    if COMPLEMENT in rules:
        return complement(u, 23)
    wrapped = np.where(u > TOP, u - 2 * TOP, u)
    return np.where(wrapped <= -TOP, u + 2 * TOP, wrapped)


def _membrane(v: Whole, u: Whole, held: Whole, p: OraclePopulation, rules: frozenset[str]) -> Whole:
    """The membranes of the next step, before any spike."""
    into = complement(u + p.bias, 23) if BIAS_WRAPS in rules else u + p.bias
    v = truncated(v, 4096 - p.dv) + into
    if MEMBRANE_UNBOUNDED not in rules:
        v = np.maximum(v.clip(1 - TOP, TOP - 1), p.floor)
    return np.where(held > 0, 0, v)


def literal(problem: Problem, rules: Iterable[str] = ()) -> Result:
    """Run ``problem`` with ``rules`` switched on; without any, in this project's own arithmetic."""
    chosen = frozenset(rules)
    presentations, steps, _ = problem.spikes.shape
    weights = [synapse_weights(c, chosen) for c in problem.connections]
    film = [np.zeros((presentations, steps, p.size), bool) for p in problem.populations]
    film_v = [np.zeros((presentations, steps, p.size), np.int64) for p in problem.populations]
    for k in range(presentations):
        u, v, held = ([np.zeros(p.size, np.int64) for p in problem.populations] for _ in range(3))
        for step in range(steps):
            drive = [np.zeros(p.size, np.int64) for p in problem.populations]
            for c, (added, exponent) in zip(problem.connections, weights, strict=True):
                source = problem.spikes if c.source == INPUTS else film[c.source]
                if step > 0:
                    total = added[source[k, step - 1]].sum(axis=0)
                    drive[c.target] += total << exponent if exponent > 0 else total >> -exponent
            for i, p in enumerate(problem.populations):
                u[i] = _current(u[i], drive[i], p, chosen)
                v[i] = _membrane(v[i], u[i], held[i], p, chosen)
                spikes = v[i] > p.threshold << 6
                v[i] = np.where(spikes, 0, v[i])
                held[i] = np.where(spikes, p.hold_steps, np.maximum(held[i] - 1, 0))
                film[i][k, step], film_v[i][k, step] = spikes, v[i]
    return Result(np.concatenate(film, axis=2), np.concatenate(film_v, axis=2))


def explain(problem: Problem, theirs: Result, rules: tuple[str, ...]) -> tuple[str, ...] | None:
    """The fewest ``rules`` with which our arithmetic gives exactly ``theirs``; () if it does without, None if never."""
    ours = literal(problem)
    if not ours.differs(theirs):
        return ()
    wrong = ((ours.spikes != theirs.spikes) | (ours.v != theirs.v)).any(axis=2)
    k, step = (int(x) for x in np.argwhere(wrong)[0])
    # Most sets already fail where the first difference is; only the others are worth a whole run.
    opening = replace(problem, spikes=problem.spikes[k : k + 1, : step + 1])
    first = Result(theirs.spikes[k : k + 1, : step + 1], theirs.v[k : k + 1, : step + 1])
    for chosen in chain.from_iterable(combinations(rules, n) for n in range(1, len(rules) + 1)):
        if not literal(opening, chosen).differs(first) and not literal(problem, chosen).differs(theirs):
            return chosen
    return None
