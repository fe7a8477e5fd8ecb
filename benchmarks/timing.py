"""How everything that is timed beside something else takes turns with it."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Mapping
from typing import TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


def turns(measures: Mapping[K, Callable[[], V]], rounds: int) -> dict[K, list[V]]:
    """What each measures in so many rounds, after one that compiles and does not count; every other goes backwards."""
    found: dict[K, list[V]] = {name: [] for name in measures}
    for turn in range(rounds + 1):
        for name in list(measures)[:: 1 if turn % 2 else -1]:
            value = measures[name]()
            if turn:
                found[name].append(value)
    return found


def elapsed(run: Callable[[], object]) -> Callable[[], float]:
    """A measure of the seconds that a call takes."""

    def seconds() -> float:
        started = time.perf_counter()
        run()
        return time.perf_counter() - started

    return seconds
