"""The benchmark of all the energy of a query: what it prints, on real images."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmarks.energy import whole


def test_the_quickest_round_counts_and_all_take_turns() -> None:
    times, order = {"a": iter([3.0, 1.0, 2.0]), "b": iter([5.0, 6.0, 4.0])}, []

    def timed(name: str) -> float:
        order.append(name)
        return next(times[name])

    assert whole.quickest({"a": lambda: timed("a"), "b": lambda: timed("b")}, 3) == {"a": 1.0, "b": 4.0}
    assert order == ["a", "b"] * 3


@pytest.mark.data
@pytest.mark.slow
def test_a_column_for_every_preset_and_matcher(data_root: Path) -> None:
    result = CliRunner().invoke(whole.main, ["--rounds", "1"])
    assert result.exit_code == 0, result.output
    for name in whole.INTEGER:
        assert f"{name}, Kapoho Bay" in result.output
        assert f"{name}, no board" in result.output
    first, second = re.findall(r"R@1, percent +│(.*)│", result.output)
    recalls = [float(cell) for cell in f"{first}│{second}".split("│")]
    assert len(recalls) == 2 * len(whole.INTEGER) + 3
    assert min(recalls[:-2]) > 90
    assert recalls[-3:] == [92.6, 88.0, 57.8]  # cosine, HOG and SAD, as docs/results.json has them
