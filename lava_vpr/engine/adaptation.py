"""Adaptation: what stays the same over a traverse carries no news, and is taken off.

The season's mean image is not the references', and with it every neuron's mean drive differs. An adapted network takes
off, instead of its mean drive over the references, a running mean over the queries before, starting at that: one number
a neuron, which is its bias. It follows from rates alone, in order, and not from spikes: how queries are batched or
shared among threads changes nothing, but which came before does. A traverse starts anew.

A robot that stands still would unlearn the place where it stands: queries that overlap by `STANDING` with the last one
that counted do not count (`Motion`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.quantise import RATE_UNIT, biases_of
from lava_vpr.loihi import INPUT_SHIFT

STANDING = (4, 5)
"""Share of its spikes, as a fraction, that a query has in common with the last one that counted if the robot has not
moved. Consecutive places of Nordland 0:200, by train, have 0.68 at most."""


class RunningMean:
    """Means of the values before each query, which forget with a time constant.

    Args:
        start: The means before the first query, float64 (k,).
        tau: Time constant in queries, at least 1.
    """

    def __init__(self, start: NDArray[np.float64], tau: float) -> None:
        self._mean, self._tau = start.astype(np.float64), float(tau)

    def before(self, values: NDArray[np.float64], moving: NDArray[np.bool_]) -> NDArray[np.float64]:
        """The means before each of the next queries, float64 (n, k).

        Args:
            values: What is averaged, float64 (n, k).
            moving: Which of the queries count, bool (n,).
        """
        means = np.empty_like(values)
        for row, value, counts in zip(means, values, moving, strict=True):
            row[:] = self._mean
            if counts:
                self._mean += (value - self._mean) / self._tau
        return means


class Motion:
    """Whether each query shows something other than the last one that counted."""

    def __init__(self) -> None:
        self._last: NDArray[np.int64] | None = None

    def moving(self, rates: NDArray[Any]) -> NDArray[np.bool_]:
        """Which of the next queries count, bool (n,), of their rates (n, inputs)."""
        counted = np.ones(len(rates), np.bool_)
        share, whole = STANDING
        for i, row in enumerate(rates.astype(np.int64)):
            if self._last is not None:
                common = int(np.minimum(row, self._last).sum())
                counted[i] = whole * common < share * max(int(row.sum()), int(self._last.sum()))
            if counted[i]:
                self._last = row
        return counted


class Adaptation:
    """Biases of a network, query after query of one traverse.

    Args:
        network: The network, signed.
        tau: Time constant in queries, at least 1.
    """

    def __init__(self, network: FixedNetwork, tau: float) -> None:
        self._weights = network.weights.astype(np.float64)
        self._highest, self._motion = network.safe_bias, Motion()
        self._mean = RunningMean(-network.bias.astype(np.float64) / (1 << INPUT_SHIFT), tau)

    def biases(self, rates: NDArray[np.uint16]) -> NDArray[np.int32]:
        """Biases of the next queries in units of v, int32 (n, neurons), of their rates uint16 (n, inputs)."""
        drives = rates.astype(np.float64) @ self._weights / RATE_UNIT  # whole numbers below 2^53: exact in any order
        means = self._mean.before(drives, self._motion.moving(rates))
        return biases_of(means, self._highest)
