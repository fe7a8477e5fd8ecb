"""What a processor does for a query by itself: what is timed is the work that is told, a query at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.common.small_models import encoded, paper_model, small_model

from lava_vpr.bench.measure import alone
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.encoding import draw_spikes
from lava_vpr.engine.inference.biases import bias_input_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import ConfigError
from lava_vpr.model import as_integer


def queries() -> QuerySet:
    return QuerySet.of(small_model(), encoded(noise=0.1))


def network(**changes: Any) -> FixedNetwork:
    found = as_integer(small_model())
    assert found is not None
    return replace(found.network, **changes)


def recorded(monkeypatch: pytest.MonkeyPatch, name: str) -> list[Any]:
    """What the function ``name`` of the module returns, call by call."""
    original: Callable[..., Any] = getattr(alone, name)
    results: list[Any] = []

    def call(*arguments: Any) -> Any:
        results.append(original(*arguments))
        return results[-1]

    monkeypatch.setattr(alone, name, call)
    return results


@pytest.mark.parametrize(
    ("regular", "name", "spikes_of"), [(True, "schedule", bias_input_spikes), (False, "poisson_spikes", draw_spikes)]
)
def test_what_is_drawn_are_the_spikes_that_a_board_is_sent(
    regular: bool, name: str, spikes_of: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown, lists = queries().shown, recorded(monkeypatch, name)
    made = network(regular=regular)
    alone._draw(made, shown.rates[0], shown.keys[0])
    ((starts, members),) = lists
    spikes = spikes_of(shown.rates[0], int(shown.keys[0]), made.steps)
    assert np.diff(starts).tolist() == spikes.sum(axis=1).tolist()
    assert len(members) == spikes.sum() > 100


def test_inputs_that_integrate_a_bias_are_set(monkeypatch: pytest.MonkeyPatch) -> None:
    shown, lists = queries().shown, recorded(monkeypatch, "schedule")
    starts, slopes = recorded(monkeypatch, "start_membranes"), recorded(monkeypatch, "biases")
    alone._draw(network(regular=True, bias_input=True), shown.rates[0], shown.keys[0])
    assert (len(starts), len(slopes), len(lists)) == (1, 1, 0)


def test_queries_are_asked_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alone, "SINGLES", 10)
    chosen: list[int] = []
    assert alone._median(chosen.append, 4) >= 0
    assert chosen == [0, *range(4), *range(4), 0, 1]


@pytest.mark.parametrize(
    ("maker", "timed"), [("cosine_answer", alone.cosine), ("sad_answer", alone.sad), ("hog_answer", alone.hog)]
)
def test_matchers_that_are_timed_find_the_places(
    maker: str, timed: Callable[[QuerySet], float], monkeypatch: pytest.MonkeyPatch
) -> None:
    made, found = getattr(alone, maker), []

    def make(*arguments: Any) -> tuple[Callable[[slice], Any], int]:
        answer, size = made(*arguments)
        return lambda part: found.append(answer(part)), size

    monkeypatch.setattr(alone, "SINGLES", 8)
    monkeypatch.setattr(alone, maker, make)
    assert 0 < timed(queries()) < 1000
    assert np.concatenate(found).tolist() == [0, *range(8)]


def test_the_host_engine_that_is_timed_answers_every_query(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, made, found = queries(), alone.host_answer, []
    expected = made(asked.model, asked.shown.seed)(asked.shown.rates)

    def make(*arguments: Any) -> Callable[[Any], Any]:
        answer = made(*arguments)
        return lambda rates: found.append(answer(rates))

    monkeypatch.setattr(alone, "SINGLES", 8)
    monkeypatch.setattr(alone, "host_answer", make)
    assert 0 < alone.host(asked) < 1000
    assert np.concatenate(found[1:]).tolist() == expected.tolist()


def test_beside_a_board_spikes_are_drawn_and_counts_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, decoded = queries(), []
    match = alone.decoder_of(asked.model)
    monkeypatch.setattr(alone, "SINGLES", 8)
    monkeypatch.setattr(alone, "decoder_of", lambda model: lambda counts: decoded.append(match(counts)))
    drawn = recorded(monkeypatch, "_draw")
    assert 0 < alone.beside_board(asked) < 1000
    assert len(drawn) == len(decoded) == 9
    assert np.concatenate(decoded).tolist() == [0] * 9  # the counts of the first query: all take as long


def test_a_float_model_has_nothing_beside_a_board() -> None:
    model = paper_model(2)
    with pytest.raises(ConfigError, match="needs an integer network"):
        alone.beside_board(QuerySet.of(model, encoded(2, 784)))
