"""A grid of tasks: in the order of its points, kept ones taken, the others computed and kept."""

from __future__ import annotations

from pathlib import Path

import pytest

from lava_vpr.cluster.tasks import Pool
from lava_vpr.errors import InputError
from lava_vpr.experiments.cache import FigureCache
from lava_vpr.experiments.grid import compute

POINTS = (3, 1, 2)


def times(factor: int, point: int) -> int:
    if point > 9:
        raise InputError("too large")
    return factor * point


@pytest.mark.parametrize("jobs", [1, 3])
def test_figures_stand_in_the_order_of_the_points(jobs: int) -> None:
    assert list(compute(times, POINTS, shared=5, pool=Pool(jobs)).items()) == [(3, 15), (1, 5), (2, 10)]
    assert compute(times, POINTS, shared=5, read=lambda point: point + 1) == {3: 20, 1: 10, 2: 15}


def test_what_is_kept_is_not_computed_again(tmp_path: Path) -> None:
    kept: FigureCache[int, int] = FigureCache(tmp_path, str, "key of {}".format, int)
    told: list[tuple[int, str]] = []

    def advance(done: int, note: str) -> None:
        told.append((done, note))

    with pytest.raises(InputError, match="too large"):
        compute(times, (*POINTS, 10), shared=5, cache=kept)
    assert compute(times, (*POINTS, 4), shared=6, cache=kept, kept_only=True) == {3: 15, 1: 5, 2: 10}
    found = compute(times, (*POINTS, 4), shared=6, cache=kept, in_words="point {}".format, advance=advance)
    assert found == {3: 15, 1: 5, 2: 10, 4: 24}
    assert [note for done, note in told if done] == [f"point {k} (kept)" for k in POINTS] + ["point 4"]
    assert compute(times, (4,), cache=kept, kept_only=True) == {4: 24}
