"""A forward filter over places: the query before says where this one may be, at any speed, either way or at a stop.

A belief is a probability for every place, and one for being off the map. Before a query it moves: by up to three places
(`MOTIONS`), or by as many metres as an odometer says; a little of it may be anywhere (a robot that is carried, a loop),
and a little leaves the map or comes back. What moves over an end of the route is off the map. Then the query's scores s
speak: a place r is ``FLAT + p s_r^2 / sum s^2`` times as likely as an image off the map would make it, p being `PEAK`
(of maps below 200 places less: `SHARE` of their number, so that scores alike say "off the map"). A robot that stands
still shows the same image again, which is no news: its belief stays.

The filter is causal. `smooth` looks at later queries, too (forward-backward; Rabiner, Proc. IEEE 1989).

FLAT, PEAK, SHARE, the steps and the rates below were chosen on Nordland 0:200 (three maps, drives at 0.5 to 2 times the
speed, with stops, backwards, carried off, off the map); ``python -m benchmarks robot.day`` prints what they reach.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError, InputError
from lava_vpr.matching.equations import Scores

FLAT, PEAK, SHARE = 0.1, 60.0, 0.3
ANYWHERE, LEAVING, COMING = 0.01, 0.01, 0.01
"""Share of a belief that may be at any place by the next query, that leaves the map, and that comes back to it."""
RADIUS = 1
"""The probability of an answer is that of its place and of so many on either side."""

MOTIONS: dict[str, tuple[int, tuple[float, ...]]] = {
    "any": (-3, (0.5, 1.0, 1.5, 1.0, 1.5, 1.0, 0.5)),
    "forward": (0, (1.0, 1.5, 1.0, 0.5)),
}
"""By how many places a robot may move from one query to the next: the least, and the weight of each from there on."""
NONE = "none"
"""No motion is assumed: each query is answered alone."""
_SPREAD = 0.1
"""An odometer is trusted to this share of what it says, and to one place."""


@dataclass(frozen=True, eq=False)
class Belief:
    """Where the robot may be.

    Attributes:
        places: Probability of each place, float64 (places,).
        off_map: Probability of being off the map; all together 1.
    """

    places: NDArray[np.float64] = field(repr=False)
    off_map: float

    @classmethod
    def unknown(cls, n_places: int) -> Belief:
        """The belief of who knows nothing: half off the map, half at any of ``n_places``."""
        return cls(np.full(n_places, 0.5 / n_places), 0.5)

    def near(self, place: int, radius: int = RADIUS) -> float:
        """The probability of ``place`` and of ``radius`` places on either side."""
        return float(self.places[max(0, place - radius) : place + radius + 1].sum())


def check_motion(motion: str) -> None:
    """Refuse a motion that is neither `NONE` nor one of `MOTIONS`.

    Raises:
        ConfigError: naming those that there are.
    """
    if motion != NONE and motion not in MOTIONS:
        raise ConfigError(f"there is no motion {motion!r}; choose from {', '.join((*MOTIONS, NONE))}")


@dataclass(frozen=True, eq=False)
class ForwardFilter:
    """The belief after some queries; state goes in and out: ``state = state.update(scores)``.

    Attributes:
        belief: The belief after the last query.
        motion: One of `MOTIONS`.
        along: Metres along the route of each place, float64 (places,), rising, for odometry; None: unknown.
        begun: Whether a query was seen: before the first, the belief does not move.
    """

    belief: Belief
    motion: str = "any"
    along: NDArray[np.float64] | None = field(default=None, repr=False)
    begun: bool = False

    def __post_init__(self) -> None:
        if self.motion not in MOTIONS:
            raise ConfigError(f"there is no motion {self.motion!r}; choose from {', '.join(MOTIONS)}")

    @cached_property
    def _steps(self) -> tuple[tuple[int, float], ...]:
        """Every step in places, and its share."""
        least, weights = MOTIONS[self.motion]
        return tuple((least + k, weight / math.fsum(weights)) for k, weight in enumerate(weights))

    def update(self, scores: NDArray[Any], *, moving: bool = True, odometry: float | None = None) -> ForwardFilter:
        """Take the scores of the next query.

        Args:
            scores: Scores of the places, at least 0, (places,); all 0 say nothing.
            moving: Whether it shows something else than the last one; if not, it is no news.
            odometry: Metres since the last query, either sign; None: unknown.
        Raises:
            InputError: the scores are not those of as many places; odometry without positions, or no finite number.
        """
        if scores.shape != self.belief.places.shape:
            raise InputError(
                f"scores of shape {scores.shape} for {len(self.belief.places)} places; use one model throughout"
            )
        if odometry is not None:
            self._check_odometry(odometry)
        if not moving:
            return self
        before = self.moved(self.belief, odometry) if self.begun else self.belief
        return replace(self, belief=seen(before, evidence(scores)), begun=True)

    def moved(self, belief: Belief, odometry: float | None = None) -> Belief:
        """``belief`` before the next query is seen."""
        carried = self._carried(belief.places, odometry)
        stays = 1.0 - ANYWHERE - LEAVING
        total, arrived = belief.places.sum(), carried.sum()
        places = stays * carried + (ANYWHERE * total + COMING * belief.off_map) / len(carried)
        off_map = (1.0 - COMING) * belief.off_map + LEAVING * total + stays * (total - arrived)
        return Belief(places, float(off_map))

    def _carried(self, places: NDArray[np.float64], odometry: float | None) -> NDArray[np.float64]:
        """Where steps or metres take the probabilities ``places``; what goes over an end is gone."""
        if odometry is not None:
            return self._driven(places, odometry)
        carried = np.zeros_like(places)
        for step, share in self._steps:
            target, source = _overlap(len(places), step)
            carried[target] += share * places[source]
        return carried

    def _check_odometry(self, metres: float) -> NDArray[np.float64]:
        """Metres along the route of each place, where ``metres`` can be used with them."""
        if self.along is None:
            raise InputError("odometry needs a map with positions; train it with --positions, or leave odometry out")
        if not np.isfinite(metres):
            raise InputError(f"odometry is {metres}, but must be a finite number of metres; leave it out where unknown")
        return self.along

    def _driven(self, places: NDArray[np.float64], metres: float) -> NDArray[np.float64]:
        """Where ``metres`` along the route take the probabilities ``places``."""
        along = self._check_odometry(metres)
        ways = (metres,) if self.motion == "forward" else (metres, -metres)
        carried = np.zeros_like(places)
        for way in ways:
            for off, share in ((-1.0, 0.25), (0.0, 0.5), (1.0, 0.25)):
                _land(carried, along, along + way * (1.0 + off * _SPREAD), places * (share / len(ways)))
        blurred = 0.5 * carried
        for step in (-1, 1):
            target, source = _overlap(len(places), step)
            blurred[target] += 0.25 * carried[source]
        return blurred

    def backward(self, later: Belief) -> Belief:
        """What later queries say (likelihoods, not probabilities) of each state one motion before; by steps alone."""
        stays, mean = 1.0 - ANYWHERE - LEAVING, float(later.places.mean())
        reached = np.zeros_like(later.places)
        for step, share in self._steps:
            source, target = _overlap(len(reached), -step)
            gone = np.ones(len(reached), np.bool_)
            gone[source] = False
            reached[source] += share * later.places[target]
            reached[gone] += share * later.off_map
        places = stays * reached + ANYWHERE * mean + LEAVING * later.off_map
        return Belief(places, COMING * mean + (1.0 - COMING) * later.off_map)


def _overlap(length: int, step: int) -> tuple[slice, slice]:
    """Where a row of ``length`` lands, and which part of it does, when it is shifted by ``step``."""
    step = max(-length, min(length, step))
    return slice(max(step, 0), length + min(step, 0)), slice(max(-step, 0), length - max(step, 0))


def _land(
    carried: NDArray[np.float64], along: NDArray[np.float64], targets: NDArray[np.float64], mass: NDArray[np.float64]
) -> None:
    """Add ``mass`` to the two places next to each of the ``targets`` in metres, the nearer the more."""
    inside = (targets >= along[0]) & (targets <= along[-1])
    where = np.interp(targets[inside], along, np.arange(len(along), dtype=np.float64))
    below = np.minimum(where.astype(np.int64), len(along) - 2)
    upper = where - below
    np.add.at(carried, below, mass[inside] * (1.0 - upper))
    np.add.at(carried, below + 1, mass[inside] * upper)


def evidence(scores: Scores) -> NDArray[np.float64]:
    """How many times as likely as off the map each place makes the scores (..., places); 1 where all are 0."""
    squares = np.square(np.asarray(scores, np.float64))
    total = squares.sum(axis=-1, keepdims=True)
    share = np.divide(squares, total, out=np.zeros_like(squares), where=total > 0)
    return np.where(total > 0, FLAT + min(PEAK, SHARE * squares.shape[-1]) * share, 1.0)


def seen(belief: Belief, likelihood: NDArray[np.float64]) -> Belief:
    """``belief`` once a query with this likelihood (places,), off the map 1, is seen."""
    places = belief.places * likelihood
    total = float(places.sum()) + belief.off_map
    return Belief(places / total, belief.off_map / total)


@dataclass(frozen=True, eq=False)
class Beliefs:
    """The beliefs of a traverse, query after query.

    Attributes:
        places: float64 (n, places).
        off_map: float64 (n,).
    """

    places: NDArray[np.float64] = field(repr=False)
    off_map: NDArray[np.float64] = field(repr=False)

    def best(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The most probable place of each query, int64 (n,), and the probability of being there, float64 (n,)."""
        places = self.places.argmax(axis=1)
        near = [Belief(row, 0.0).near(int(place)) for row, place in zip(self.places, places, strict=True)]
        return places, np.array(near)


def filtered(
    state: ForwardFilter, scores: Scores, moving: NDArray[np.bool_] | None = None, odometry: float | None = None
) -> tuple[ForwardFilter, Beliefs]:
    """The filter after some queries of a traverse, and the belief after each.

    Args:
        state: The filter before the first of them.
        scores: float64 (n, places), at least 0.
        moving: Whether each query shows something else than the one before, bool (n,); None: all do.
        odometry: Metres before each of them, either sign; None: unknown.
    Raises:
        InputError: as `ForwardFilter.update`.
    """
    beliefs = Beliefs(np.empty(scores.shape), np.empty(len(scores)))
    for number, row in enumerate(scores):
        state = state.update(row, moving=moving is None or bool(moving[number]), odometry=odometry)
        beliefs.places[number], beliefs.off_map[number] = state.belief.places, state.belief.off_map
    return state, beliefs


def smooth(
    state: ForwardFilter, beliefs: Beliefs, scores: Scores, moving: NDArray[np.bool_], later: Belief | None = None
) -> Belief:
    """Make ``beliefs`` those of who has seen all queries, where they stand.

    Args:
        state: As `filtered` was given.
        beliefs: What `filtered` returned.
        scores, moving: As `filtered` was given.
        later: What this function returned for the queries that follow these; None: none do.
    Returns:
        How likely these queries and all later ones are from each place before the first of them, up to a factor.
    """
    seen = later is not None
    later = Belief(np.ones(scores.shape[1]), 1.0) if later is None else later
    for number in range(len(scores) - 1, -1, -1):
        places, off_map = beliefs.places[number], beliefs.off_map
        if seen:
            places *= later.places
            off_map[number] *= later.off_map
            total = float(places.sum()) + float(off_map[number])
            places /= total
            off_map[number] /= total
        seen = True
        if moving[number]:
            later = state.backward(Belief(later.places * evidence(scores[number]), later.off_map))
            most = max(float(later.places.max()), later.off_map)
            later = Belief(later.places / most, later.off_map / most)
    return later
