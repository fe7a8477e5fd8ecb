"""The literal model of the forward filter: a hidden Markov model over tracks, one matrix, a query at a time.

Used by matching.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.matching.probability import Calibration

AHEAD = [1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 20, 24, 28, 32]
QUARTERS = {"forward": AHEAD, "any": [-speed for speed in AHEAD[::-1]] + AHEAD}
"""Speeds of tracks, in quarters of a place."""


def priors(quarters: list[int]) -> list[float]:
    """How often each speed is: as far as it is from those beside it, and the less the faster."""
    often = []
    for k, speed in enumerate(quarters):
        beside = quarters[max(k - 1, 0) : k + 2]
        often.append((beside[-1] - beside[0]) / (len(beside) - 1) / (1 + (speed / 4) ** 2 / 4))
    return [one / sum(often) for one in often]


def transitions(n: int, motion: str) -> NDArray[np.float64]:
    """How each state goes on, (states, states): tracks by speed and position, places without a track, off the map.

    What is not followed any more, or not yet, is in the last column.
    """
    quarters, length = QUARTERS[motion], 4 * n
    prior, count = priors(quarters), len(QUARTERS[motion])
    moves = np.zeros((count * length + n + 1, count * length + n + 1))
    for speed in range(count):
        shares = np.zeros(count)
        shares[speed] += 0.9
        shares[max(speed - 1, 0)] += 0.04
        shares[min(speed + 1, count - 1)] += 0.04
        shares += 0.02 * np.array(prior)
        for at in range(length):
            row = moves[speed * length + at]
            row[-1] += 0.01
            for new, share in enumerate(shares):
                to = at + quarters[new]
                row[new * length + to if 0 <= to < length else -1] += 0.99 * share
    for place in range(n):
        row = moves[count * length + place]
        row[-1] += 0.9
        for new, share in enumerate(prior):
            to = 4 * place + quarters[new]
            row[new * length + to if 0 <= to < length else -1] += 0.1 * share
    moves[-1, -1] = 1.0
    return moves


def between(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values of places at all quarters of places."""
    after = np.append(values[1:], values[-1])
    return np.array([(1 - k / 4) * values[r] + k / 4 * after[r] for r in range(len(values)) for k in range(4)])


class Literal(NamedTuple):
    """A hidden Markov model: of each query the state, what it said of states, and where who is not followed is."""

    moves: NDArray[np.float64]
    states: list[NDArray[np.float64]]
    likely: list[NDArray[np.float64]]
    single: list[NDArray[np.float64]]
    hidden: list[float]

    def places(self, number: int, state: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Tracks at places, places without a track, and off the map."""
        n = len(self.single[0])
        tracks = state[: -n - 1].reshape(-1, 4 * n).sum(axis=0)
        said, found = self.likely[number], np.zeros(n)
        for place in range(n):
            for k in range(4):
                here = (1 - k / 4) * said[place]
                there = k / 4 * said[place + 1] if place + 1 < n else 0.0
                found[place] += tracks[4 * place + k] * here / (here + there)
                if place + 1 < n:
                    found[place + 1] += tracks[4 * place + k] * there / (here + there)
        return found, state[-n - 1 : -1], float(state[-1])


def literal(scores: NDArray[np.float64], motion: str, known: Calibration) -> Literal:
    """The model as it is described, a query at a time."""
    n = scores.shape[1]
    moves = transitions(n, motion)
    tracks = len(moves) - n - 1
    made = Literal(moves, [], [], [], [])
    state, hidden, chances = np.zeros(len(moves)), 0.0, known.probabilities(scores)
    for number, row in enumerate(scores):
        if number:
            begun = 0.1 * state[tracks:-1].sum()
            old = 0.99 * state[:tracks].sum()
            hidden = (0.9 * hidden + 0.003 * (1 - hidden)) * old / (old + begun)
            state = state @ moves
            state[-1] = 1.0 - state[:tracks].sum()
        else:
            state[-1] = 1.0
        if row.any():
            share = row**2 / (row**2).sum()
            visible = 0.2 + min(30.0, 0.3 * n) * share
            faint = 2 * (1 - chances[number]) * (0.95 + 0.05 * np.minimum(n * share, 10.0))
            single = share * min(0.5 * (1 - chances[number]) / (1 - share.max()), chances[number] / share.max())
            single[share.argmax()] = chances[number]
        else:
            visible = faint = np.ones(n)
            single = made.single[-1]
        said = (1 - hidden) * visible + hidden * faint
        at = state[:tracks].reshape(-1, 4 * n).sum(axis=0)
        told = (1 - hidden) * (at * between(visible)).sum(), hidden * (at * between(faint)).sum()
        hidden = told[1] / sum(told) if sum(told) else 0.0
        state[:tracks] *= np.tile(between(said), tracks // (4 * n))
        lost = state[-1]
        state[tracks:-1], state[-1] = lost * single, lost * (1 - single.sum())
        state = state / state.sum()
        for kept, value in zip(made[1:], (state, said, single, hidden), strict=True):
            kept.append(value)
    return made
