"""A forward filter over places and speeds: earlier queries predict the place of the next, for many speeds both ways.

The state is a probability for each **track**, a position (in quarters of a place) with a speed (at most eight places a
query, forward or backward), and the remaining probability that the robot is **not followed**. A robot that is not
followed is where the query by itself places it, with its calibrated probability, or off the map. The first query is
therefore answered as a single one, and so are queries of a robot that is faster than any track, is carried, or drives
in no order.

Before a query all tracks move by their speeds, further if more time than usual passed between two stamps, or by the
metres that an odometer gives. A small share of them changes its speed, and a small share ends; new tracks begin where a
robot that is not followed may be. The query then updates the state: for scores s, the probability of position r, as
compared with that of not being followed, is multiplied by ``FLAT + p s_r^2 / sum s^2``. Here p is the lower of `PEAK`
and `SHARE` times the number of places. Over a stretch where queries are uninformative, tracks must persist, and their
errors must not add up to certainty. Tracks may therefore be **hidden**, and queries have little influence on hidden
ones (`FAINT`). The filter estimates the hidden share of the tracks from the queries; the probability of an answer
leaves it out. If a robot stands still, its image repeats without new information, and the state stays the same.

The filter is causal; `lava_vpr.matching.smoothing` uses later queries, too.

All numbers below were chosen on Nordland 0:200 (three maps; drives at 0.5 to 8 times the speed, with stops, backwards,
in random order, kidnapped, off the map, blurred for 50 places); ``python -m benchmarks robot.day`` prints what they
reach elsewhere.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError, InputError
from lava_vpr.matching.equations import Scores
from lava_vpr.matching.probability import HALF, Calibration

FLAT, PEAK, SHARE = 0.2, 30.0, 0.3
FAINT, MOST, UNSEEN = 0.05, 10.0, 2.0
"""Evidence of a query for hidden tracks: the share of it that depends on the place; the limit of a place's squared
score in it, as a multiple of the mean; and a factor on all of it, beside the probability that the best place of the
query by itself is wrong."""
ENDING, BEGINNING = 0.01, 0.1
"""Share of the tracks that ends before a query; share of `ForwardFilter.alone`, at each place, that becomes tracks."""
HIDING, REVEALING = 0.003, 0.1
"""Share of the visible tracks that the next query finds hidden, and of the hidden ones that it finds visible."""
ELSEWHERE = 0.5
"""Of a query by itself: the largest share of the probability beside its best place that goes to the other places, by
their scores; the rest is off the map."""
POSITIONS = 4
"""Positions per place."""
FASTEST = 8
"""Largest speed of a track, in places a query."""

MOTIONS = ("any", "forward")
"""How a robot may move along the route: in both directions, or only forward."""
NONE = "none"
"""No motion model: each query is answered by itself."""
_SPREAD = 0.1
"""Assumed error of an odometer: this share of its distance, and one place."""
_LONGEST, _USUAL = 8.0, 0.1
"""Limit of the time between two stamps, in usual intervals; weight of a new interval in the usual one."""


class Speeds(NamedTuple):
    """The speeds of tracks.

    Attributes:
        shifts: Positions per query, int64 (speeds,), ascending, none of them 0.
        prior: Prior probability of each, float64 (speeds,); their sum is 1.
    """

    shifts: NDArray[np.int64]
    prior: NDArray[np.float64]


@functools.cache
def speeds_of(motion: str) -> Speeds:
    """The speeds of a motion: every quarter of a place up to 2, every half up to 4, every place up to `FASTEST`."""
    unit = POSITIONS
    ahead = [*range(1, 2 * unit), *range(2 * unit, 4 * unit, unit // 2), *range(4 * unit, FASTEST * unit + 1, unit)]
    shifts = np.array([-shift for shift in reversed(ahead)] + ahead if motion == "any" else ahead)
    often = np.gradient(shifts.astype(np.float64)) / (1.0 + (shifts / unit) ** 2 / 4.0)
    return Speeds(shifts, often / often.sum())


def check_motion(motion: str) -> None:
    """Refuse a motion that is neither `NONE` nor one of `MOTIONS`.

    Raises:
        ConfigError: the motion is unknown; the message lists the known ones.
    """
    if motion != NONE and motion not in MOTIONS:
        raise ConfigError(f"there is no motion {motion!r}; choose from {', '.join((*MOTIONS, NONE))}")


@dataclass(frozen=True, eq=False)
class ForwardFilter:
    """The state after some queries; ``state = state.update(scores)`` makes the next one.

    Attributes:
        tracks: Probability of each track, float64 (speeds, positions).
        positions: Sums of the tracks over speeds, float64 (positions,).
        lost: Probability of not being followed; the sum with all tracks is 1.
        alone: Part of ``lost`` at each place, float64 (places,); the rest is off the map.
        evidence: Likelihood of the last query at each place, as a multiple of its likelihood if the robot is not
            followed, float64 (places,).
        hidden: Share of the tracks that is hidden.
        motion: One of `MOTIONS`.
        calibration: Calibration of the decoder that gives the scores; None: probabilities of single queries are
            estimated from their scores.
        along: Metres along the route of each place, float64 (places,), rising, for odometry; None: unknown.
        off_map: Assumed share of queries off the map.
        begun: Whether a query was seen; before the first one, tracks do not move.
        stamp: When the last query was taken, in seconds; None: unknown.
        interval: Usual time between two queries, in seconds; None: unknown.
    """

    tracks: NDArray[np.float64] = field(repr=False)
    positions: NDArray[np.float64] = field(repr=False)
    lost: float
    alone: NDArray[np.float64] = field(repr=False)
    evidence: NDArray[np.float64] = field(repr=False)
    hidden: float = 0.0
    motion: str = "any"
    calibration: Calibration | None = field(default=None, repr=False)
    along: NDArray[np.float64] | None = field(default=None, repr=False)
    off_map: float = HALF
    begun: bool = False
    stamp: float | None = None
    interval: float | None = None

    @classmethod
    def start(
        cls,
        n_places: int,
        motion: str = "any",
        calibration: Calibration | None = None,
        along: NDArray[np.float64] | None = None,
        off_map: float = HALF,
    ) -> ForwardFilter:
        """The state before the first query on a map of ``n_places``: not followed, all places equally probable.

        Raises:
            ConfigError: the motion is unknown.
        """
        if motion not in MOTIONS:
            raise ConfigError(f"there is no motion {motion!r}; choose from {', '.join(MOTIONS)}")
        length = n_places * POSITIONS
        none, even = np.zeros((len(speeds_of(motion).shifts), length)), np.full(n_places, (1.0 - off_map) / n_places)
        return cls(none, none[0], 1.0, even, np.ones(n_places), 0.0, motion, calibration, along, off_map)

    def update(
        self,
        scores: NDArray[Any],
        *,
        moving: bool = True,
        odometry: float | None = None,
        stamp: float | None = None,
        chance: float | None = None,
    ) -> ForwardFilter:
        """The state after the next query.

        Args:
            scores: Scores of the places, at least 0, (places,); all 0: the query is uninformative.
            moving: Whether its image differs from the last one; if not, only an odometer changes the state.
            odometry: Metres since the last query, either sign; None: unknown.
            stamp: When it was taken, in seconds; None: unknown.
            chance: Its value of `chances`, if that is known already.
        Raises:
            InputError: the number of scores is not that of the places; or odometry is not finite, or the places have no
                positions.
        """
        if scores.shape != self.alone.shape:
            raise InputError(f"scores of shape {scores.shape} for {len(self.alone)} places; use one model throughout")
        if odometry is not None:
            self.check_odometry(odometry)
        pace, timed = self.timed(stamp)
        if not moving and self.begun:
            return replace(timed.moved(odometry), evidence=np.ones(len(scores))) if odometry else timed
        before = timed.moved(odometry, pace) if self.begun else timed
        sure = float(self.chances(scores[None])[0]) if chance is None else chance
        return before._seen(scores, sure)

    def chances(self, scores: Scores) -> NDArray[np.float64]:
        """Probability of the best place of each query by itself, float64 (n,), for scores (n, places)."""
        if self.calibration is not None:
            return self.calibration.probabilities(scores, self.off_map)
        likely = evidence(scores)
        return likely.max(axis=1) / (scores.shape[1] + likely.sum(axis=1))

    def timed(self, stamp: float | None) -> tuple[float, ForwardFilter]:
        """Time since the last query in usual intervals, 1 if unknown; and this state with the new stamp."""
        passed = float("nan") if stamp is None or self.stamp is None else stamp - self.stamp
        if not 0.0 < passed < float("inf"):  # no interval before or after a stamp that goes back or is not finite
            first = stamp if self.stamp is None and stamp is not None and np.isfinite(stamp) else None
            return 1.0, self if first is self.stamp else replace(self, stamp=first)
        usual = passed if self.interval is None else self.interval
        follows = usual + _USUAL * (min(passed, 2.0 * usual) - usual)
        return min(passed / usual, _LONGEST), replace(self, stamp=stamp, interval=follows)

    def check_odometry(self, metres: float) -> NDArray[np.float64]:
        """Metres along the route of each place, float64 (places,), for an odometry of ``metres``.

        Raises:
            InputError: the places have no positions, or ``metres`` is not finite.
        """
        if self.along is None:
            raise InputError("odometry needs a map with positions; train it with --positions, or leave odometry out")
        if not np.isfinite(metres):
            raise InputError(f"odometry is {metres}, but must be a finite number of metres; leave it out where unknown")
        return self.along

    def moved(self, odometry: float | None = None, pace: float = 1.0) -> ForwardFilter:
        """The state before the next query is seen, ``pace`` usual intervals or ``odometry`` metres after the last."""
        from lava_vpr.matching.filter_kernels import move

        shifts, prior = speeds_of(self.motion)
        steps = steps_of(shifts, pace) if odometry is None else np.zeros_like(shifts)
        entering = BEGINNING * self.alone
        tracks, positions = move(self.tracks, self.positions, entering, steps, prior, 1.0 - ENDING)
        if odometry is not None:
            tracks = self._driven(tracks, odometry)
            positions = tracks.sum(axis=0)
        old = (1.0 - ENDING) * float(self.positions.sum())
        known = old / (old + float(entering.sum())) if old > 0.0 else 0.0  # new tracks are visible
        hidden = known * (self.hidden * (1.0 - REVEALING) + (1.0 - self.hidden) * HIDING)
        lost = 1.0 - float(positions.sum())
        return replace(
            self, tracks=tracks, positions=positions, hidden=hidden, lost=lost, alone=self.alone * (lost / self.lost)
        )

    def _driven(self, tracks: NDArray[np.float64], metres: float) -> NDArray[np.float64]:
        """``tracks`` moved by ``metres`` along the route, each in its direction; their speed becomes the one driven."""
        along, shifts = self.check_odometry(metres), speeds_of(self.motion).shifts
        last, driven = (len(along) - 1) * POSITIONS, np.zeros_like(tracks)
        where = np.interp(np.arange(last + 1) / POSITIONS, np.arange(len(along)), along)
        for way in np.unique(np.sign(shifts)):
            rows = np.flatnonzero(np.sign(shifts) == way)
            mass = tracks[rows].sum(axis=0)
            mass[last] += mass[last + 1 :].sum()
            for off, share in ((-1.0, 0.25), (0.0, 0.5), (1.0, 0.25)):
                target = where + float(way) * metres * (1.0 + off * _SPREAD)
                inside = (target >= where[0]) & (target <= where[-1])
                at = np.interp(target[inside], where, np.arange(last + 1.0))
                apart = np.abs(at - np.flatnonzero(inside))
                row = rows[np.abs(np.abs(shifts[rows]) - apart[:, None]).argmin(axis=1)]
                below = np.minimum(at.astype(np.int64), last - 1)
                carried = mass[: last + 1][inside] * share
                np.add.at(driven, (row, below), carried * (1.0 + below - at))
                np.add.at(driven, (row, below + 1), carried * (at - below))
        blurred = 0.5 * driven
        blurred[:, POSITIONS:] += 0.25 * driven[:, :-POSITIONS]
        blurred[:, :-POSITIONS] += 0.25 * driven[:, POSITIONS:]
        return blurred

    def _seen(self, scores: NDArray[Any], chance: float) -> ForwardFilter:
        """The state after a query with these scores, and with this probability of its best place by itself."""
        if not scores.any():
            return replace(self, begun=True, evidence=np.ones(len(scores)))
        share = _shares(scores)
        faint = UNSEEN * (1.0 - chance) * (1.0 - FAINT + FAINT * np.minimum(len(share) * share, MOST))
        visible = evidence(scores)
        told = (1.0 - self.hidden) * float((self.positions * at_positions(visible)).sum())
        hidden = self.hidden * float((self.positions * at_positions(faint)).sum())
        total = told + hidden + self.lost
        likely = (1.0 - self.hidden) * visible + self.hidden * faint
        factor = at_positions(likely) / total
        return replace(
            self,
            tracks=self.tracks * factor,
            positions=self.positions * factor,
            lost=self.lost / total,
            alone=_by_itself(share, chance) * (self.lost / total),
            evidence=likely,
            hidden=hidden / (told + hidden) if told + hidden > 0.0 else 0.0,
            begun=True,
        )

    def remapped(self, source: NDArray[np.int64], along: NDArray[np.float64] | None) -> ForwardFilter:
        """The state for a changed map; the probability of removed places goes to not being followed, off the map.

        Args:
            source: Former index of each place of the map, int64 (places,); -1: a new place.
            along: Metres along the route of each place; None: unknown.
        """
        new = source < 0
        columns = (source[:, None] * POSITIONS + np.arange(POSITIONS)).ravel()
        tracks, alone = self.tracks[:, columns], self.alone[source]
        tracks[:, np.repeat(new, POSITIONS)], alone[new] = 0.0, 0.0
        positions, likely = tracks.sum(axis=0), np.where(new, 1.0, self.evidence[source])
        lost = self.lost + float(self.positions.sum()) - float(positions.sum())
        return replace(self, tracks=tracks, positions=positions, lost=lost, alone=alone, evidence=likely, along=along)


def steps_of(shifts: NDArray[np.int64], pace: float) -> NDArray[np.int64]:
    """Positions by which tracks of each speed move in ``pace`` usual intervals, int64 (speeds,)."""
    return np.rint(shifts * pace).astype(np.int64)


def _shares(scores: Scores) -> NDArray[np.float64]:
    """Each place's share of the sum of squared scores, float64 (..., places); 0 where all scores are 0."""
    squares = np.square(np.asarray(scores, np.float64))
    total = squares.sum(axis=-1, keepdims=True)
    return np.divide(squares, total, out=np.zeros_like(squares), where=total > 0)


def evidence(scores: Scores) -> NDArray[np.float64]:
    """Likelihood of scores (..., places) for a track at each place, as a multiple of that for a robot not followed."""
    return FLAT + min(PEAK, SHARE * scores.shape[-1]) * _shares(scores)


def _by_itself(share: NDArray[np.float64], chance: float) -> NDArray[np.float64]:
    """The probability of each place by a query alone, float64 (places,); the rest is off the map.

    Args:
        share: Each place's share of the squared scores, float64 (places,).
        chance: Probability that the query's best place is right.
    """
    most = float(share.max())
    others = 1.0 - most
    part = ELSEWHERE * (1.0 - chance) / others if others > 1e-9 else 0.0
    single = share * min(part, chance / most)  # no place is likelier than the best one
    single[int(share.argmax())] = chance
    return single


def at_positions(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values of places, float64 (places,), interpolated linearly at all positions, float64 (positions,)."""
    part = np.arange(POSITIONS) / POSITIONS
    following = np.append(places[1:], places[-1])
    return (places[:, None] * (1.0 - part) + following[:, None] * part).ravel()
