"""One search over settings: each value in turn, all from cheap to dear, or a walk along the front; every trial is told.

A search is an iterator of trials. Whoever chooses takes the last one that is kept, and logs what was tried as it comes.
The walk is seeded, so equal measurements give equal trials.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import LavaVprError

S = TypeVar("S")
R = TypeVar("R")

Settings = dict[str, Any]
Key = tuple[tuple[str, Any], ...]


@dataclass(frozen=True)
class Trial(Generic[R]):
    """What a search tried.

    Attributes:
        settings: The settings.
        result: What they bring; None: they cannot be.
        kept: Whether they are the best so far.
        name: What was changed, in words.
        error: Why they cannot be.
    """

    settings: Settings
    result: R | None
    kept: bool
    name: str = ""
    error: str = ""


def key_of(settings: Mapping[str, Any]) -> Key:
    """Settings as a key, whatever the order of their names."""
    return tuple(sorted(settings.items()))


def descend(
    start: Mapping[str, Any],
    values: Mapping[str, Sequence[Any]],
    measure: Callable[[Settings], R],
    better: Callable[[Trial[R], Trial[R]], bool],
    rounds: int | None = None,
) -> Iterator[Trial[R]]:
    """Coordinate descent: settings take their values in turn, round after round; a value that is better is kept.

    Args:
        start: The settings to start from; they are the first trial.
        values: What each setting takes in turn; names with a comma between them take values together.
        measure: What settings bring; those for which it raises a `LavaVprError` cannot be.
        better: Whether a trial is better than the best so far.
        rounds: Most rounds; None: until one changes nothing.
    """
    best = Trial(dict(start), measure(dict(start)), True, "start")
    yield best
    tried = {key_of(best.settings)}
    for _ in count() if rounds is None else range(rounds):
        before = best
        for names, options in values.items():
            for option in options:
                changed = dict(zip(names.split(", "), option, strict=True)) if ", " in names else {names: option}
                settings = {**best.settings, **changed}
                if key_of(settings) in tried:
                    continue
                tried.add(key_of(settings))
                trial = _tried(f"{names} = {option}", settings, measure)
                if not trial.error and better(trial, best):
                    best = trial = replace(trial, kept=True)
                yield trial
        if best is before:
            return


def _tried(name: str, settings: Settings, measure: Callable[[Settings], R]) -> Trial[R]:
    """A trial of ``settings``, which may not be possible."""
    try:
        return Trial(settings, measure(settings), False, name)
    except LavaVprError as error:
        return Trial(settings, None, False, name, str(error))


def cheapest(
    points: Iterable[S],
    measure: Callable[[S], R],
    cost: Callable[[S, R], tuple[float, ...] | None],
    floor: Callable[[S], float],
) -> Iterator[tuple[S, R, bool]]:
    """Try points until none of the rest can be cheaper than the cheapest that is good enough.

    Args:
        points: The points, from cheap to dear by their ``floor``.
        measure: What a point brings.
        cost: What it costs, the most important figure first; None: it is not good enough.
        floor: What the first figure of its cost is at least.
    Yields:
        A point, its measurement, and whether it is the cheapest so far.
    """
    least: tuple[float, ...] | None = None
    for point in points:
        if least is not None and floor(point) >= least[0]:
            return
        result = measure(point)
        price = cost(point, result)
        kept = price is not None and (least is None or price < least)
        least = price if kept else least
        yield point, result, kept


class _Next(NamedTuple):
    """Settings that are measured next if the front stays as it is.

    Attributes:
        settings: The settings.
        drawn: The state of the random numbers after them.
        misses: Settings drawn so far that had been measured before.
        starts: Settings left to start from.
    """

    settings: Settings
    drawn: Any
    misses: int
    starts: list[Settings]


def wander(
    starts: Sequence[Settings],
    moved: Callable[[Settings, random.Random], Settings],
    measure: Callable[[Sequence[Settings]], Iterable[R]],
    parents: Callable[[Mapping[Key, R]], list[Settings]],
    budget: int,
    ahead: int = 1,
) -> Iterator[tuple[Settings, R]]:
    """Walk from settings that are worth it to settings near them, and so on.

    Args:
        starts: What is measured first.
        moved: Settings near others, drawn with random numbers.
        measure: What some settings bring, in their order.
        parents: The settings worth moving on from, of all that was measured so far.
        budget: Settings that are measured.
        ahead: Settings that are measured at once: those that come next if ``parents`` stay as they are. Where they do
            not, the rest is drawn again, so that this changes no trial.
    """
    found: dict[Key, R] = {}
    known: dict[Key, R] = {}

    def following(now: _Next) -> list[_Next]:
        rng, misses, left = random.Random(), now.misses, list(now.starts)
        rng.setstate(now.drawn)
        origins, taken, coming = parents(found) or list(starts[:1]), set(found), list[_Next]()
        while len(coming) < ahead and len(taken) < budget and misses < 50 * budget:
            settings = left.pop(0) if left else moved(rng.choice(origins), rng)
            if key_of(settings) in taken:
                misses += 1
                continue
            taken.add(key_of(settings))
            coming.append(_Next(settings, rng.getstate(), misses, list(left)))
        return coming

    now = _Next({}, random.Random(0).getstate(), 0, list(starts))
    while coming := following(now):
        new = [one.settings for one in coming if key_of(one.settings) not in known]
        known |= {key_of(settings): result for settings, result in zip(new, measure(new), strict=True)}
        before = parents(found)
        for now in coming:
            found[key_of(now.settings)] = known[key_of(now.settings)]
            yield now.settings, found[key_of(now.settings)]
            if parents(found) != before:
                break  # the rest was drawn from another front


def on_front(objectives: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points no other outdoes: at least as low in every column and lower in one; bool (n,).

    Args:
        objectives: float64 (n, columns), lower is better.
    """
    kept = np.ones(len(objectives), np.bool_)
    for number, point in enumerate(objectives):
        better = (objectives <= point).all(axis=1) & (objectives < point).any(axis=1)
        kept[number] = not better.any()
    return kept
