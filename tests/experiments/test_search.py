"""The search over settings: each value in turn, from cheap to dear, or along the front; every trial is told."""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping, Sequence

import pytest

from lava_vpr.errors import ConfigError
from lava_vpr.experiments.search import Key, Settings, Trial, cheapest, descend, wander


def hill(settings: Settings) -> float:
    if settings["x"] == 9:
        raise ConfigError("x is 9, must be less")
    return -2 * (settings["x"] - 2) ** 2 - (settings["y"] - settings["x"]) ** 2


def higher(trial: Trial[float], best: Trial[float]) -> bool:
    return trial.result is not None and best.result is not None and trial.result > best.result


def test_a_descent_ends_where_no_value_is_better() -> None:
    trials = list(descend({"x": 0, "y": 0}, {"x": (1, 2, 9), "y": (0, 1, 2)}, hill, higher))
    assert [trial.settings for trial in trials if trial.kept][-1] == {"x": 2, "y": 2}
    assert trials[0].name == "start"
    assert {trial.error for trial in trials if trial.result is None} == {"x is 9, must be less"}
    tried = [tuple(trial.settings.values()) for trial in trials]
    assert len(tried) == len(set(tried))


def test_settings_can_move_together_and_rounds_be_limited() -> None:
    trials = list(descend({"x": 0, "y": 0}, {"x, y": ((1, 1), (2, 2))}, hill, higher))
    assert [trial.name for trial in trials if trial.kept] == ["start", "x, y = (1, 1)", "x, y = (2, 2)"]
    once = list(descend({"x": 0, "y": 0}, {"x": (1, 2), "y": (2,)}, hill, higher, rounds=1))
    assert [trial.settings for trial in once if trial.kept][-1] == {"x": 1, "y": 0}


def test_no_point_is_tried_that_cannot_be_cheaper() -> None:
    measured: list[int] = []

    def measure(point: int) -> int:
        measured.append(point)
        return point

    found = list(cheapest(range(1, 9), measure, lambda point, _: (5 - point / 8,) if point > 2 else None, float))
    assert measured == [1, 2, 3, 4]  # 4 costs 4.5, and 5 at least 5
    assert [kept for *_, kept in found] == [False, False, True, True]


def walk(ahead: int) -> tuple[list[Settings], int]:
    """Trials of a walk, and how many settings were measured at once at most."""
    most = 0

    def measure(some: Sequence[Settings]) -> Iterable[float]:
        nonlocal most
        most = max(most, len(some))
        return [hill(settings) for settings in some]

    def moved(settings: Settings, rng: random.Random) -> Settings:
        return {**settings, rng.choice("xy"): rng.randrange(8)}

    def best(found: Mapping[Key, float]) -> list[Settings]:
        top = max(found.values(), default=0.0)
        return [dict(key) for key in sorted(found) if found[key] == top]

    trials = wander([{"x": 7, "y": 0}, {"x": 0, "y": 7}], moved, measure, best, 20, ahead)
    return [settings for settings, _ in trials], most


@pytest.mark.parametrize("ahead", [2, 8])
def test_measuring_ahead_changes_no_trial(ahead: int) -> None:
    alone, together = walk(1), walk(ahead)
    assert alone[0] == together[0]
    assert (alone[1], together[1]) == (1, ahead)
    assert len({tuple(settings.items()) for settings in alone[0]}) == 20
