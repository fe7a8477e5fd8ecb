"""Adaptation: subtracting what stays the same over a traverse, which says nothing about the place.

In another season the mean image differs from that of the references, and so does every neuron's mean drive. An adapted
network subtracts a running mean of its drive over the previous queries instead of the mean over the references, at
which the running mean starts. This is one number per neuron, its bias. It depends on the rates of the queries and on
their order, not on spikes, batches or threads. Each traverse starts from the references again.

A robot that stands still would subtract the place where it stands. So a query does not count if it shares `STANDING` of
its spikes with the last query that counted (`Motion`). Noise can hide that a robot stands still; the mean then
approaches the place itself. So a query does not count, either, if it shares more than `FAMILIAR` of its spikes with the
mean.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.direct import strengths
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.quantise import RATE_UNIT, subtracting
from lava_vpr.loihi import INPUT_SHIFT

STANDING = (4, 5)
"""Share of its spikes, as a fraction, that a query has in common with the last one that counted if the robot has not
moved. Consecutive places of Nordland 0:200, by train, have 0.68 at most."""

FAMILIAR = 0.5
"""Share of its spikes that a query may have in common with the mean of those before and still count. Of the queries of
Nordland 0:200 and Gardens Point 0:50, forward and back, none has more than 0.496 with means of 10 to 100 queries;
standing still in noise, 0.55 and more."""


class RunningMean:
    """The mean of the values of all previous queries, weighted exponentially with a time constant.

    Args:
        start: The means before the first query, float64 (k,).
        tau: Time constant in queries, at least 1.

    Attributes:
        now: The means before the next query, float64 (k,).
    """

    def __init__(self, start: NDArray[np.float64], tau: float) -> None:
        self.now, self._tau = start.astype(np.float64), float(tau)

    def before(self, values: NDArray[np.float64], moving: NDArray[np.bool_]) -> NDArray[np.float64]:
        """The means before each of the next queries, float64 (n, k).

        Args:
            values: What is averaged, float64 (n, k).
            moving: Which of the queries count, bool (n,).
        """
        means = np.empty_like(values)
        for row, value, counts in zip(means, values, moving, strict=True):
            row[:] = self.now
            if counts:
                self.add(value)
        return means

    def add(self, value: NDArray[np.float64]) -> None:
        """Take the values (k,) of the next query."""
        self.now += (value - self.now) / self._tau


class Motion:
    """Whether each query shows something other than the last one that counted."""

    def __init__(self) -> None:
        self._last: NDArray[np.int64] | None = None

    def moving(self, rates: NDArray[Any]) -> NDArray[np.bool_]:
        """Which of the next queries count, bool (n,), given their rates (n, inputs)."""
        counted = np.ones(len(rates), np.bool_)
        share, whole = STANDING
        for i, row in enumerate(rates.astype(np.int64)):
            if self._last is not None:
                common = int(np.minimum(row, self._last).sum())
                counted[i] = whole * common < share * max(int(row.sum()), int(self._last.sum()))
            if counted[i]:
                self._last = row
        return counted


def unseen(inputs: int) -> NDArray[np.float64]:
    """`Adaptation.mean` before any query, float64 (inputs + 1,)."""
    return np.append(np.zeros(inputs), 1.0)


class Adaptation:
    """Biases of a network, query after query of one traverse.

    The state is one mean for each input, whatever the number of neurons, and the share that the start still has in
    them.

    Args:
        network: The network, signed.
        tau: Time constant in queries, at least 1.
        start: `mean` where an earlier traverse ended; None: those of the references.

    Attributes:
        network: The network whose biases are made; its weights may change, its inputs stay.
    """

    def __init__(self, network: FixedNetwork, tau: float, start: NDArray[np.float64] | None = None) -> None:
        self.network, self._motion = network, Motion()
        self._mean = RunningMean(unseen(network.inputs) if start is None else start, tau)

    @property
    def mean(self) -> NDArray[np.float64]:
        """Mean rates before the next query, and the share of the start in them, float64 (inputs + 1,)."""
        return self._mean.now.copy()

    def biases(self, rates: NDArray[np.uint16]) -> NDArray[np.int32]:
        """Biases of the next queries in units of v, int32 (n, neurons), from their rates, uint16 (n, inputs)."""
        return self.taking_off(self.means(rates)[0])

    def means(self, rates: NDArray[np.uint16]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Mean rates before each of the next queries, with the share of the start, float64 (n, inputs + 1); which of
        the queries count, bool (n,)."""
        rates = strengths(rates, self.network.direct)
        values = np.pad(rates, ((0, 0), (0, 1))).astype(np.float64)  # the start is never seen again
        means, counted = np.empty_like(values), self._motion.moving(rates)
        for i, value in enumerate(values):
            means[i] = self._mean.now
            counted[i] &= self._news(value)
            if counted[i]:
                self._mean.add(value)
        return means, counted

    def taking_off(self, means: NDArray[np.float64]) -> NDArray[np.int32]:
        """Biases int32 (n, neurons) that subtract the drive of ``means``."""
        shown, start = np.rint(means[:, :-1]).astype(np.uint16), means[:, -1:]
        own = self.network.bias / (self.network.bias_steps << INPUT_SHIFT)
        return subtracting(self.network, self.network.drives(shown) / RATE_UNIT - start * own)

    def _news(self, value: NDArray[np.float64]) -> bool:
        """Whether a query overlaps by at most `FAMILIAR` with the mean of the previous queries, from which the start is
        left out."""
        seen, value = self._mean.now[:-1], value[:-1] * (1 - self._mean.now[-1])
        return bool(np.minimum(value, seen).sum() <= FAMILIAR * max(value.sum(), seen.sum()))
