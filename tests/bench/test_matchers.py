"""Matchers on the processor: each answers as its slow definition does, and is timed doing what recall counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.common.small_models import encoded, paper_model, small_model, two_images_a_place

from lava_vpr.bench.measure import matchers
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.engine.inference.biases import bias_input_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.rates import draw_spikes, query_rates
from lava_vpr.errors import ConfigError
from lava_vpr.matching import baselines
from lava_vpr.model import as_integer
from lava_vpr.recognition import recognise

# By themselves


def queries() -> QuerySet:
    return QuerySet.of(small_model(), encoded(noise=0.1))


def network(**changes: Any) -> FixedNetwork:
    found = as_integer(small_model())
    return replace(found.network, **changes)


def recorded(monkeypatch: pytest.MonkeyPatch, name: str) -> list[Any]:
    """What the function ``name`` of the module returns, call by call."""
    original: Callable[..., Any] = getattr(matchers, name)
    results: list[Any] = []

    def call(*arguments: Any) -> Any:
        results.append(original(*arguments))
        return results[-1]

    monkeypatch.setattr(matchers, name, call)
    return results


@pytest.mark.parametrize(
    ("regular", "name", "spikes_of"), [(True, "schedule", bias_input_spikes), (False, "poisson_spikes", draw_spikes)]
)
def test_what_is_drawn_are_the_spikes_that_a_board_is_sent(
    regular: bool, name: str, spikes_of: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown, lists = queries().shown, recorded(monkeypatch, name)
    made = network(regular=regular)
    matchers._draw(made, shown.rates[0], shown.keys[0])
    ((starts, members),) = lists
    spikes = spikes_of(shown.rates[0], int(shown.keys[0]), made.steps)
    assert np.diff(starts).tolist() == spikes.sum(axis=1).tolist()
    assert len(members) == spikes.sum() > 100


def test_inputs_that_integrate_a_bias_are_set(monkeypatch: pytest.MonkeyPatch) -> None:
    shown, lists = queries().shown, recorded(monkeypatch, "schedule")
    starts, slopes = recorded(monkeypatch, "start_membranes"), recorded(monkeypatch, "biases")
    matchers._draw(network(regular=True, bias_input=True), shown.rates[0], shown.keys[0])
    assert (len(starts), len(slopes), len(lists)) == (1, 1, 0)


def test_queries_are_asked_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matchers, "SINGLES", 10)
    chosen: list[int] = []
    assert matchers._median(chosen.append, 4) >= 0
    assert chosen == [0, *range(4), *range(4), 0, 1]


@pytest.mark.parametrize("name", ["lava-vpr", "cosine", "sad", "hog"])
def test_a_matcher_that_is_timed_finds_the_places(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, made, found = queries(), matchers.answer_of, []
    expected = made(asked, name)[0](slice(None))

    def make(*arguments: Any) -> tuple[Callable[[slice], Any], int]:
        answer, size = made(*arguments)
        return lambda part: found.append(answer(part)), size

    monkeypatch.setattr(matchers, "SINGLES", 8)
    monkeypatch.setattr(matchers, "answer_of", make)
    assert 0 < matchers.alone(asked, name) < 1000
    assert np.concatenate(found).tolist() == [expected[0], *expected]
    assert name == "lava-vpr" or expected.tolist() == [*range(8)]


def test_beside_a_board_spikes_are_drawn_and_counts_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, decoded = queries(), []
    match = matchers.decoder_of(asked.model)
    monkeypatch.setattr(matchers, "SINGLES", 8)
    monkeypatch.setattr(matchers, "decoder_of", lambda model: lambda counts: decoded.append(match(counts)))
    drawn = recorded(monkeypatch, "_draw")
    assert 0 < matchers.beside_board(asked) < 1000
    assert len(drawn) == len(decoded) == 9
    assert np.concatenate(decoded).tolist() == [0] * 9  # the counts of the first query: all take as long


def test_a_float_model_has_nothing_beside_a_board() -> None:
    model = paper_model(2)
    with pytest.raises(ConfigError, match="needs an integer network"):
        matchers.beside_board(QuerySet.of(model, encoded(2, 784)))


# Beside each other


@pytest.mark.parametrize("twice", [False, True])
def test_fast_forms_find_the_same_places_as_the_baselines(twice: bool) -> None:
    model, queries = two_images_a_place() if twice else small_model(), encoded(200, seed=7)
    asked = QuerySet.of(model, queries)
    sad, sad_bytes = matchers.answer_of(asked, "sad")
    expected = baselines.sad_distances(model.patches, queries.patches, model.labels)
    np.testing.assert_array_equal(sad(slice(None)), expected.argmin(axis=1))
    np.testing.assert_array_equal(sad(slice(3, 9)), expected[3:9].argmin(axis=1))
    rates = asked.shown.rates
    cosine, cosine_bytes = matchers.answer_of(asked, "cosine")
    own = query_rates(model.activity, model.config)
    similar = baselines.cosine_similarities(own, rates, model.labels)
    np.testing.assert_array_equal(cosine(slice(None)), similar.argmax(axis=1))
    images = len(model.labels)
    assert (sad_bytes, cosine_bytes) == (784 * images, 4 * rates.shape[1] * images)


def test_a_blank_query_matches_no_place_better_than_another() -> None:
    asked = queries()
    blank = replace(asked.shown, rates=np.zeros((2, 1568), np.uint16))
    assert matchers.answer_of(replace(asked, shown=blank), "cosine")[0](slice(None)).tolist() == [0, 0]


def test_all_in_one_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matchers, "BATCH", 20)
    model, queries, truth = small_model(), encoded(noise=0.1), np.eye(8, dtype=bool)
    known = recognise(model, queries, truth)
    sizes: list[int] = []

    def answer(part: slice) -> matchers.Places:
        sizes.append(len(range(24)[part]))
        return np.zeros(sizes[-1], np.int64)

    other = matchers.TimedMatcher("other", "one that always answers 0", 5, answer, known.metrics["sad"])
    found = matchers.run_peers(QuerySet.of(model, queries), known, threads=2, rounds=2, fill=0.0, others=[other])
    ours, sad, cosine, hog, template, last = found
    assert [one.name for one in found] == ["lava-vpr", "sad", "cosine", "hog", "template", "other"]
    assert ours.metrics == known.metrics[known.default]
    assert (sad.metrics, cosine.metrics) == (known.metrics["sad"], known.metrics["cosine"])
    assert (hog.metrics, template.metrics) == (known.metrics["hog"], known.metrics["template"])
    assert hog.bytes == 4 * 1764 * 8
    assert (last.what, last.bytes, last.metrics) == (other.what, 5, other.metrics)
    for one in found:
        assert one.queries_per_second > 0
        assert (one.threads, one.queries) == (2, 8)
    assert ours.bytes == model.network.weights.nbytes + model.responses.nbytes
    assert sum(sizes) == 2 + 3 * 24  # once to begin with, once to know how long it takes, and two rounds


def test_what_is_timed_is_what_recall_counts() -> None:
    asked, truth = queries(), np.eye(8, dtype=bool)
    known = recognise(asked.model, asked.images, truth)
    assert np.array_equal(matchers.answer_of(asked, "lava-vpr")[0](slice(0, 8)), known.matches)
    for name in ("sad", "cosine", "hog", "template"):
        answer, _ = matchers.answer_of(asked, name, 2)
        assert np.array_equal(answer(slice(0, 8)), answer(slice(8, 16)))
        assert (answer(slice(0, 8)) == np.arange(8)).mean() == known.metrics[name].recall_at_1, name
