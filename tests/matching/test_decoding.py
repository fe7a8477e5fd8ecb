"""Decoders: against literal versions in fractions, and their defined answers."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from scipy import sparse

from lava_vpr.errors import ConfigError, InputError
from lava_vpr.matching import decoders, equations
from lava_vpr.matching.decoders import DECODERS, best, confidence

quick = settings(deadline=None, max_examples=60, derandomize=True)


def random_counts(seed: int, neurons: int, places: int, queries: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Sparse responses and spikes, with silent neurons, ties and a silent query among them."""
    rng = np.random.default_rng(seed)
    responses = rng.poisson(0.6, (neurons, places)) * rng.integers(1, 4, (neurons, places))
    responses[rng.random(neurons) < 0.15] = 0
    spikes = rng.poisson(0.8, (queries, neurons))
    spikes[queries // 2] = 0
    return responses, spikes


@st.composite
def counts(draw: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    shape = (draw(st.integers(1, 8)), draw(st.integers(1, 7)), draw(st.integers(1, 4)))
    return random_counts(draw(st.integers(0, 10_000)), *shape)


# The literal version: one query, loops and fractions, straight from the equations.


def literal_label(row: list[int]) -> int:
    return row.index(max(row)) if max(row) > 0 else -1


def literal_pairs(
    responses: list[list[int]], s: list[int], gamma: float, steps: tuple[bool, bool, bool], variant: str
) -> list[list[Fraction]]:
    """The summands of a weighted score, [neuron][label]."""
    neurons, places = len(responses), len(responses[0])
    pairs = [[Fraction(0)] * places for _ in range(neurons)]
    labels = [literal_label(row) for row in responses]
    for place in range(places):
        if variant == "printed":
            learned = [i for i in range(neurons) if responses[i][place] > 0]
        else:
            learned = [i for i in range(neurons) if sum(responses[i]) and responses[i][place] / sum(responses[i]) > 0.1]
            if place not in labels:
                continue
        fired = sum(responses[i][place] for i in learned if s[i] > 0)
        known = sum(responses[i][place] for i in learned)
        for i in learned:
            value = Fraction(s[i])
            omega = sum(1 for count in responses[i] if count > 0)
            many = omega >= gamma * places if variant == "vprsnn" else omega > gamma * places
            if steps[0] and many:
                value /= omega
            if steps[1]:
                value *= Fraction(responses[i][place], sum(responses[i]))
            if steps[2]:
                value *= Fraction(fired, known)
            pairs[i][place] = value
    return pairs


def literal_standard(responses: list[list[int]], s: list[int], variant: str) -> list[Fraction]:
    scores = []
    for place in range(len(responses[0])):
        own = [s[i] for i, row in enumerate(responses) if literal_label(row) == place]
        scores.append(Fraction(sum(own), 1 if variant == "printed" else max(1, len(own))))
    return scores


def literal_min_max(values: list[Fraction], total: Fraction) -> list[Fraction]:
    spread = max(values) - min(values)
    return [(v - min(values)) / spread / total if spread and total else Fraction(0) for v in values]


def literal_decode(name: str, responses: list[list[int]], s: list[int], variant: str, gamma: float) -> list[Fraction]:
    neurons, places = len(responses), len(responses[0])
    pairs = literal_pairs(responses, s, gamma, (True, True, True), variant)
    if name == "contrast":
        pairs = literal_pairs(responses, s, gamma, (False, True, False), "printed")
    if name == "standard" or (name == "probability" and variant != "printed"):
        scores = literal_standard(responses, s, variant)
    elif name == "probability":
        shares = literal_min_max([Fraction(v) for v in s], Fraction(sum(s)))
        labels = [literal_label(row) for row in responses]
        return [sum((shares[i] for i in range(neurons) if labels[i] == m), Fraction(0)) for m in range(places)]
    elif name == "weighted_probability" and variant == "printed":
        flat = [value for row in pairs for value in row]
        shares = literal_min_max(flat, sum(flat, Fraction(0)))
        return [sum((shares[i * places + m] for i in range(neurons)), Fraction(0)) for m in range(places)]
    else:
        scores = [sum((pairs[i][m] for i in range(neurons)), Fraction(0)) for m in range(places)]
    if not name.endswith("probability"):
        return scores
    raised = [v - min(scores) for v in scores]
    return [v / sum(raised) if sum(raised) else Fraction(0) for v in raised]


@pytest.mark.parametrize("variant", equations.VARIANTS)
@pytest.mark.parametrize("name", DECODERS)
@given(data=counts(), gamma=st.sampled_from([0.0, 0.02, 0.3, 0.5, 1.0]))
@quick
def test_decoders_equal_their_equations(name: str, variant: Any, data: Any, gamma: float) -> None:
    responses, spikes = data
    scores = decoders.decode(name, responses, spikes, variant=variant, gamma=gamma)
    assert scores.dtype == np.float64
    assert scores.shape == (len(spikes), responses.shape[1])
    for q, s in enumerate(spikes.tolist()):
        expected = literal_decode(name, responses.tolist(), s, variant, gamma)
        np.testing.assert_allclose(scores[q], [float(v) for v in expected], rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("variant", equations.VARIANTS)
@pytest.mark.parametrize("steps", [(a, b, c) for a in (False, True) for b in (False, True) for c in (False, True)])
@given(data=counts())
@settings(deadline=None, max_examples=15, derandomize=True)
def test_each_step_of_the_weighted_decoder_can_be_switched(
    variant: Any, steps: tuple[bool, bool, bool], data: Any
) -> None:
    responses, spikes = data
    on = dict(zip(("involvement", "strength", "penalty"), steps, strict=True))
    scores = equations.weighted(responses, gamma=0.3, variant=variant, **on)(spikes)
    for q, s in enumerate(spikes.tolist()):
        pairs = literal_pairs(responses.tolist(), s, 0.3, steps, variant)
        expected = [float(sum(column)) for column in zip(*pairs, strict=True)]
        np.testing.assert_allclose(scores[q], expected, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("variant", equations.VARIANTS)
@pytest.mark.parametrize("name", DECODERS)
def test_a_query_alone_and_in_a_batch_has_the_same_bits(
    name: str, variant: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    responses, spikes = random_counts(3, 257, 61, 40)
    scores = decoders.decode(name, responses, spikes, variant=variant)
    scores_of = decoders.prepare(name, responses, variant=variant)  # once; no query changes what is said of the next
    for q in (0, 7, 20, 39):
        np.testing.assert_array_equal(scores_of(spikes[q : q + 1])[0], scores[q])
    order = np.random.default_rng(0).permutation(257)
    mixed = decoders.decode(
        name, np.asfortranarray(responses[order]), np.asfortranarray(spikes[:, order]), variant=variant
    )
    np.testing.assert_array_equal(mixed, scores)
    monkeypatch.setattr(equations, "QUERY_BLOCK", 7)
    np.testing.assert_array_equal(decoders.decode(name, responses, spikes, variant=variant), scores)


@pytest.mark.parametrize("kept", [np.asarray, sparse.csc_matrix])
@pytest.mark.parametrize(("queries", "fired"), [(1, 0.0), (1, 0.2), (1, 1.0), (3, 0.2)])
def test_products_are_sums_over_the_neurons_that_fired(queries: int, fired: float, kept: Any) -> None:
    rng, (neurons, places) = np.random.default_rng(7), (50, 9)
    table = rng.integers(0, 1 << 30, (neurons, places)) * (rng.random((neurons, places)) < 0.5)
    spikes = rng.integers(1, 1 << 17, (queries, neurons)) * (rng.random((queries, neurons)) < fired)
    columns = table.T.tolist()
    sums = [[sum(s * k for s, k in zip(query, column, strict=True)) for column in columns] for query in spikes.tolist()]
    scores = equations._products(spikes, kept(table.astype(np.float64)))
    assert scores.astype(object).tolist() == sums


@pytest.mark.parametrize("dtype", [np.uint8, np.int32, np.uint16])
@pytest.mark.parametrize("name", DECODERS)
def test_narrow_counts_do_not_wrap(name: str, dtype: Any) -> None:
    responses = np.full((90, 4), 50)
    responses[np.arange(90), np.arange(90) % 4] = 200
    spikes = np.random.default_rng(1).integers(0, 200, (5, 90))
    narrow = decoders.decode(name, responses.astype(dtype), spikes.astype(dtype), gamma=0.5)
    np.testing.assert_array_equal(narrow, decoders.decode(name, responses, spikes, gamma=0.5))


def test_assignments_take_the_most_spikes_and_the_lowest_of_equals() -> None:
    responses = np.array([[0, 3, 3], [0, 0, 0], [5, 1, 0]])
    assert equations.assign(responses).tolist() == [1, -1, 0]


@pytest.mark.parametrize("variant", equations.VARIANTS)
@pytest.mark.parametrize("name", DECODERS)
def test_a_silent_query_matches_nothing(name: str, variant: Any) -> None:
    responses, _ = random_counts(2, 10, 5, 2)
    scores = decoders.decode(name, responses, np.zeros((2, 10), int), variant=variant)
    assert not scores.any()
    assert best(scores).tolist() == [-1, -1]
    assert confidence(name, scores).tolist() == [-np.inf, -np.inf]


@pytest.mark.parametrize("variant", equations.VARIANTS)
@pytest.mark.parametrize("name", DECODERS)
def test_a_network_that_learned_nothing_matches_nothing(name: str, variant: Any) -> None:
    scores = decoders.decode(name, np.zeros((4, 3), int), np.ones((2, 4), int), variant=variant)
    assert best(scores).tolist() == [-1, -1]


def test_scores_that_tell_no_places_apart_have_no_probability() -> None:
    scores = equations.probability(np.array([[2.0, 2.0, 2.0], [1.0, 3.0, 1.0]]))
    assert scores.tolist() == [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]


def test_ties_go_to_the_lowest_place_and_show_in_the_confidence() -> None:
    responses = np.array([[0, 2, 0, 2], [1, 0, 0, 0]])
    scores = equations.contrast(responses)(np.array([[6, 0], [2, 1]]))
    assert scores.tolist() == [[0, 3, 0, 3], [1, 1, 0, 1]]
    assert best(scores).tolist() == [1, 0]
    assert confidence("contrast", scores).tolist() == [0, 0]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("standard", [8.0, 3.0]),
        ("weighted_probability", [8.0, 3.0]),
        ("sad", [8.0, 3.0]),
        ("cosine", [5.0, 0.0]),
        ("descriptors", [5.0, 0.0]),
        ("sequence", [5.0, 0.0]),
        ("contrast", [5.0 / 12**0.5, 0.0]),
    ],
)
def test_confidence_of_each_matcher(name: str, expected: list[float]) -> None:
    scores = np.array([[3.0, 8.0, 1.0], [3.0, 0.0, 3.0], [0.0, 0.0, 0.0]])
    assert confidence(name, scores).tolist() == [*expected, -np.inf]


def test_confidence_of_distances_and_of_a_single_place() -> None:
    assert confidence("sad", np.array([[-4.0, -2.0]])).tolist() == [-2.0]
    assert best(np.array([[-4.0, -2.0]])).tolist() == [1]
    assert confidence("contrast", np.array([[8.0]])).tolist() == [8.0 / 3.0]


@pytest.mark.parametrize("name", [*DECODERS, "sequence"])
def test_no_queries_give_no_answers(name: str) -> None:
    scores = np.zeros((0, 4))
    if name in DECODERS:
        scores = decoders.decode(name, np.ones((3, 4), int), np.zeros((0, 3), int))
    assert scores.shape == (0, 4)
    assert confidence(name, scores).shape == best(scores).shape == (0,)


@pytest.mark.parametrize(
    ("responses", "spikes", "message"),
    [
        (np.ones((2, 3)), np.ones((1, 2), int), "responses: float64 of shape (2, 3), must be whole numbers"),
        (np.ones((2, 3), int), np.ones(2, int), "spikes: int64 of shape (2,), must be whole numbers in two dimensions"),
        (np.ones((2, 3), int), -np.ones((1, 2), int), "spikes: holds a negative count"),
        (np.ones((2, 0), int), np.ones((1, 2), int), "responses: shape (2, 0); train on at least one image"),
        (np.ones((0, 2), int), np.ones((1, 0), int), "responses: shape (0, 2); train on at least one image"),
        (np.ones((2, 3), int), np.ones((1, 4), int), "counts of 4 neurons, but responses hold 2; use one model"),
        (np.ones((1, 3), int), np.array([[9_000_000]]), "a query has 9,000,000 spikes, at most 8,388,608; use fewer"),
    ],
)
@pytest.mark.parametrize("name", DECODERS)
def test_unusable_counts_are_refused(name: str, responses: Any, spikes: Any, message: str) -> None:
    with pytest.raises(InputError) as error:
        decoders.decode(name, responses, spikes)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_unknown_names_are_refused() -> None:
    one = np.ones((1, 1), int)
    with pytest.raises(ConfigError, match=r"there is no decoder 'best'; choose from contrast, standard"):
        decoders.decode("best", one, one)
    with pytest.raises(ConfigError, match="decoder variant '2023' is unknown; choose from vprsnn2022, vprsnn, printed"):
        decoders.decode("contrast", one, one, variant="2023")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="there is no matcher 'best'; choose from contrast"):
        confidence("best", np.ones((1, 1)))


@pytest.mark.parametrize("most", [1 << 22, 1 << 24, 1 << 30])
def test_the_penalty_is_exact_whatever_the_counts(most: int) -> None:
    """Sums of counts beyond what a float of 32 bits holds are those of whole numbers, too."""
    rng = np.random.default_rng(most)
    responses = rng.integers(0, most, (6, 4)).astype(np.int32)
    spikes = rng.integers(0, 3, (5, 6)).astype(np.int32)
    with_penalty, without = (
        equations.weighted(responses, penalty=on, variant="printed")(spikes) for on in (True, False)
    )
    for query, (penalised, plain) in enumerate(zip(with_penalty, without, strict=True)):
        for place in range(4):
            heard = sum(int(responses[i, place]) for i in range(6) if spikes[query, i])
            assert penalised[place] == plain[place] * (heard / int(responses[:, place].sum(dtype=np.int64)))


@pytest.mark.parametrize("variant", equations.VARIANTS)
@pytest.mark.parametrize("name", decoders.DECODERS)
def test_long_maps_score_the_same_bits_without_a_table(
    name: str, variant: equations.Variant, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(4)
    responses = np.where(rng.random((90, 70)) < 0.06, rng.integers(1, 60, (90, 70)), 0).astype(np.int32)
    responses[5] = 0  # a neuron that is silent on all references
    spikes = rng.integers(0, 30, (40, 90)).astype(np.int32)
    spikes[3] = 0
    table = decoders.decode(name, responses, spikes, variant=variant)
    monkeypatch.setattr(equations, "_DENSE", 0)
    few = decoders.decode(name, responses, spikes, variant=variant)
    assert np.array_equal(table, few)
    assert table.any()
    with pytest.raises(InputError, match="89 neurons"):
        decoders.decode(name, responses, spikes[:, :89], variant=variant)
