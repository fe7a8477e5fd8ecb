"""Peers: each answers as its slow definition does, and what is timed is what recall counts."""

from __future__ import annotations

import numpy as np
import pytest
from support.common.small_models import encoded, small_model, two_images_a_place

from lava_vpr.bench import peers
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.encoding import query_rates
from lava_vpr.errors import InputError
from lava_vpr.matching import baselines
from lava_vpr.recognition import recognise


@pytest.mark.parametrize("twice", [False, True])
def test_fast_forms_find_the_same_places_as_the_baselines(twice: bool) -> None:
    model, queries = two_images_a_place() if twice else small_model(), encoded(200, seed=7)
    sad, sad_bytes = peers.sad_answer(model, queries.patches)
    expected = baselines.sad_distances(model.patches, queries.patches, model.labels)
    np.testing.assert_array_equal(sad(slice(None)), expected.argmin(axis=1))
    np.testing.assert_array_equal(sad(slice(3, 9)), expected[3:9].argmin(axis=1))
    rates = query_rates(queries.activity, model.config)
    cosine, cosine_bytes = peers.cosine_answer(model, rates)
    own = query_rates(model.activity, model.config)
    similar = baselines.cosine_similarities(own, rates, model.labels)
    np.testing.assert_array_equal(cosine(slice(None)), similar.argmax(axis=1))
    images = len(model.labels)
    assert (sad_bytes, cosine_bytes) == (784 * images, 4 * rates.shape[1] * images)


def test_a_blank_query_matches_no_place_better_than_another() -> None:
    model, rates = small_model(), np.zeros((2, 1568), np.uint16)
    assert peers.cosine_answer(model, rates)[0](slice(None)).tolist() == [0, 0]


def test_all_in_one_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peers, "BATCH", 20)
    model, queries, truth = small_model(), encoded(noise=0.1), np.eye(8, dtype=bool)
    known = recognise(model, queries, truth)
    sizes: list[int] = []

    def answer(part: slice) -> peers.Places:
        sizes.append(len(range(24)[part]))
        return np.zeros(sizes[-1], np.int64)

    other = peers.TimedMatcher("other", "one that always answers 0", 5, answer, known.metrics["sad"])
    told: list[str] = []
    found = peers.run_peers(
        QuerySet.of(model, queries), truth, threads=2, rounds=2, fill=0.0, others=[other], advance=told.append
    )
    ours, sad, cosine, hog, template, last = found
    assert [one.name for one in found] == ["lava-vpr", "sad", "cosine", "hog", "template", "other"]
    assert ours.metrics == known.metrics[known.default]
    assert (sad.metrics, cosine.metrics) == (known.metrics["sad"], known.metrics["cosine"])
    assert (hog.metrics, template.metrics) == (known.metrics["hog"], known.metrics["template"])
    assert hog.bytes == 4 * 1764 * 8
    assert (last.what, last.bytes, last.metrics) == (other.what, 5, other.metrics)
    for one in found:
        assert one.queries_per_second is not None
        assert one.queries_per_second > 0
        assert (one.threads, one.queries, one.absent) == (2, 8, "")
    assert ours.bytes == model.network.weights.nbytes + model.responses.nbytes
    assert sum(sizes) == 2 + 3 * 24  # once to begin with, once to know how long it takes, and two rounds
    assert told[-1] == "speed of each"


def test_what_is_timed_is_what_recall_counts() -> None:
    model, queries, truth = small_model(), encoded(noise=0.1), np.eye(8, dtype=bool)
    known = recognise(model, queries, truth)
    matchers = peers._matchers(QuerySet.of(model, queries), known)
    first = {one.name: one.answer(slice(0, 8)) for one in matchers}
    np.testing.assert_array_equal(first["lava-vpr"], known.matches)
    for one in matchers:
        correct = float((first[one.name] == np.arange(8)).mean())
        assert correct == one.metrics.recall_at_1, one.name


def test_wrong_queries_are_refused() -> None:
    model, queries = small_model(), encoded()
    with pytest.raises(InputError, match=r"8 queries, 8 places, but ground truth of shape \(8, 7\)"):
        peers.run_peers(QuerySet.of(model, queries), np.zeros((8, 7), bool))
    with pytest.raises(InputError, match="0 queries"):
        peers.run_peers(QuerySet.of(model, encoded(0)), np.zeros((0, 8), bool))
