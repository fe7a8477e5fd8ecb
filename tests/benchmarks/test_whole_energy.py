"""The benchmark of all the energy of a query: what it prints, on real images."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmarks.energy import whole
from benchmarks.program import turns


def test_all_take_turns_and_the_first_round_does_not_count() -> None:
    values, order = iter(range(6)), list[str]()

    def timed(name: str) -> int:
        order.append(name)
        return next(values)

    assert turns({"a": lambda: timed("a"), "b": lambda: timed("b")}, 2) == {"a": [2, 5], "b": [3, 4]}
    assert order == ["b", "a", "a", "b", "b", "a"]


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
