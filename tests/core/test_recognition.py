"""Queries through a model: equal counts however they are run, and answers that belong to their queries."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from support.common.small_models import encoded, paper_model, small_model

from lava_vpr.backends import registry as backends, rivals
from lava_vpr.backends.asking import Asking
from lava_vpr.backends.interface import Presentations
from lava_vpr.configfile import update
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.inference import counting, fixed
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.engine.rates import query_rates
from lava_vpr.errors import BackendUnavailableError, ConfigError, InputError
from lava_vpr.matching import decoders, sequences
from lava_vpr.matching.decoders import DECODERS, best, confidence
from lava_vpr.matching.evaluation import evaluate
from lava_vpr.model import Model, decode, prepare
from lava_vpr.recognition import Comparison, as_json, count_query_spikes, recognise
from lava_vpr.report.build import report_data
from lava_vpr.training.loop import train
from lava_vpr.training.templates import template_of

PLACES = 8
TRUTH = np.eye(PLACES, dtype=bool)
QUICK = settings(deadline=None, derandomize=True, max_examples=15)


def taken(traverse: EncodedTraverse, order: NDArray[np.int64] | list[int]) -> EncodedTraverse:
    """Some images of a traverse, numbered from 0, as a folder of them alone would be."""
    return dataclasses.replace(traverse.take(np.asarray(order, np.int64)), indices=np.arange(len(order)))


@lru_cache(maxsize=2)
def case(kind: str) -> tuple[Model, EncodedTraverse, NDArray[np.int32], dict[str, int]]:
    """A model, queries, and what they give when run in one batch on one thread."""
    learned = small_model(PLACES) if kind == "loihi" else paper_model()
    queries = encoded(PLACES, inputs=1568 if kind == "loihi" else 784, noise=0.3)
    counts, events = count_query_spikes(learned, queries)
    assert counts.any(axis=1).all()
    return learned, queries, counts, events


@pytest.mark.parametrize("kind", ["loihi", "paper"])
@pytest.mark.parametrize("threads", [2, 3, 64])
def test_threads_do_not_matter(kind: str, threads: int) -> None:
    learned, queries, counts, events = case(kind)
    again, same = count_query_spikes(learned, queries, threads=threads)
    np.testing.assert_array_equal(again, counts)
    assert same == events


@pytest.mark.parametrize("kind", ["loihi", "paper"])
def test_batches_do_not_matter(kind: str) -> None:
    learned, queries, counts, events = case(kind)
    singles = [count_query_spikes(learned, taken(queries, [k])) for k in range(PLACES)]
    np.testing.assert_array_equal(np.concatenate([rows for rows, _ in singles]), counts)
    assert {name: sum(part[name] for _, part in singles) for name in events} == events
    many = taken(queries, np.arange(64) % PLACES)
    rows, _ = count_query_spikes(learned, many, threads=2)
    np.testing.assert_array_equal(rows, counts[np.arange(64) % PLACES])


@QUICK
@given(order=st.permutations(range(PLACES)), kept=st.integers(1, PLACES))
def test_shuffled_queries_give_shuffled_answers(order: list[int], kept: int) -> None:
    """A query's spikes, scores and answer depend on it alone, wherever it stands and whoever stands beside it."""
    learned, queries, counts, _ = case("loihi")
    chosen = order[:kept]
    whole = recognise(learned, queries, TRUTH)
    part = recognise(learned, taken(queries, chosen), TRUTH[chosen])
    np.testing.assert_array_equal(part.counts, counts[chosen])
    np.testing.assert_array_equal(part.matches, whole.matches[chosen])
    np.testing.assert_array_equal(part.confidence, whole.confidence[chosen])
    assert set(part.scores) == set(whole.scores)
    for name, scores in part.scores.items():
        np.testing.assert_array_equal(scores, whole.scores[name][chosen], err_msg=name)


def test_a_query_never_draws_the_noise_of_its_own_place() -> None:
    """The references as queries: other input spikes than those that S^R was counted from."""
    learned, references = small_model(PLACES), encoded(PLACES)
    rates = query_rates(references.activity, learned.config)

    def run(k: int, role: str, seed: int = learned.config.seed) -> tuple[NDArray[np.int32], int]:
        counts, events = backends.get("host").count_spikes(learned, Presentations(rates[[k]], seed, role))
        return counts[0], events["input_spikes"]

    response = [run(k, "response") for k in range(PLACES)]
    np.testing.assert_array_equal([counts for counts, _ in response], learned.responses.T)
    query, reseeded = ([run(k, "query", seed)[1] for k in range(PLACES)] for seed in (learned.config.seed, 1000))
    own = [spikes for _, spikes in response]
    for one, other in ((query, own), (reseeded, own), (reseeded, query)):
        assert sum(a == b for a, b in zip(one, other, strict=True)) <= 1
    singles = [count_query_spikes(learned, taken(references, [k]))[1]["input_spikes"] for k in range(PLACES)]
    assert singles == query


def test_the_seed_is_the_models_unless_given() -> None:
    learned, queries, counts, _ = case("loihi")
    np.testing.assert_array_equal(count_query_spikes(learned, queries, seed=learned.config.seed)[0], counts)
    assert (count_query_spikes(learned, queries, seed=learned.config.seed + 1)[0] != counts).any()


def test_backends_that_cannot_run_say_so() -> None:
    learned, queries, _, _ = case("loihi")
    with pytest.raises(BackendUnavailableError, match=r"^there is no backend 'gpu'; choose from host"):
        count_query_spikes(learned, queries, backend="gpu")
    assert next(iter(backends.BACKENDS)) == "host"
    for name in backends.BACKENDS:
        reason = backends.BACKENDS[name].unavailable()
        if reason is None:
            assert callable(backends.get(name).count_spikes)
        else:
            with pytest.raises(BackendUnavailableError) as caught:
                backends.get(name)
            assert str(caught.value) == reason


@pytest.mark.parametrize("kind", ["loihi", "paper"])
def test_fewer_steps_are_the_beginning_of_a_presentation(kind: str) -> None:
    learned, queries, counts, _ = case(kind)
    own = learned.config.network.steps

    def run(steps: int) -> NDArray[np.int32]:
        config = update(learned.config, {"network": {"steps": steps}})
        network = learned.network
        if isinstance(network, fixed.FixedNetwork):
            network = dataclasses.replace(network, steps=steps - network.silent_steps)
        return count_query_spikes(dataclasses.replace(learned, config=config, network=network), queries)[0]

    np.testing.assert_array_equal(run(own), counts)
    half, quarter = run(own // 2), run(own // 4)
    assert 0 < quarter.sum() < half.sum() < counts.sum()
    if isinstance(learned.network, fixed.FixedNetwork):
        rates = query_rates(queries.activity, learned.config)
        keys = presentation_keys(learned.config.seed, "query", image_keys(rates))
        _, _, film = counting.count_spikes(learned.network, rates, keys, raster=True)
        # Input of the last step still arrives; what it would have caused later does not.
        last = own // 2 - learned.network.silent_steps
        assert (half >= film[:, : last + 1].sum(axis=1)).all()


def test_queries_of_another_encoding_are_refused() -> None:
    with pytest.raises(InputError, match=r"^queries have 784 inputs, the model 1568; encode them"):
        count_query_spikes(small_model(PLACES), encoded(PLACES, inputs=784))


@pytest.mark.parametrize("kind", ["loihi", "paper"])
def test_a_decoder_means_the_same_with_every_preset(kind: str) -> None:
    """The paper's four are its release, in figures, answers and streams."""
    learned, _, counts, _ = case(kind)
    for name in ("standard", "weighted", "probability", "weighted_probability"):
        expected = decoders.decode(name, learned.responses, counts, variant="vprsnn2022")
        np.testing.assert_array_equal(decode(learned, counts, name), expected)
        config = dataclasses.replace(learned.config, decoder=dataclasses.replace(learned.config.decoder, default=name))
        np.testing.assert_array_equal(prepare(dataclasses.replace(learned, config=config))(counts), expected)
        if name == "probability":
            assert (expected != decoders.decode(name, learned.responses, counts, variant="printed")).any()


@pytest.mark.parametrize("kind", ["loihi", "paper"])
def test_everything_is_computed_from_the_counts(kind: str) -> None:
    learned, queries, counts, events = case(kind)
    result = recognise(learned, queries, TRUTH)
    default = "contrast" if kind == "loihi" else "weighted_probability"
    assert result.default == default
    assert set(result.metrics) == {*DECODERS, *rivals.chosen(learned, None)}
    assert result.events == events
    scores = decode(learned, counts, default)
    np.testing.assert_array_equal(result.matches, best(scores))
    sure = confidence(default, scores)
    np.testing.assert_array_equal(result.confidence, sure)
    assert result.metrics[default] == evaluate(scores, sure, TRUTH)
    values = as_json(learned, result)
    assert list(values["decoders"])[-1] == values["default_decoder"] == default
    assert values["network"]["weight_bits"] == (3 if kind == "loihi" else None)


def test_a_silent_query_matches_no_place() -> None:
    learned, queries, _, _ = case("loihi")
    activity = queries.activity.copy()
    activity[2] = 0
    result = recognise(learned, dataclasses.replace(queries, activity=activity), TRUTH, Comparison(rivals=("cosine",)))
    whole = recognise(learned, queries, TRUTH)
    assert not result.counts[2].any()
    assert result.matches[2] == -1
    assert result.confidence[2] == -np.inf
    others = np.arange(PLACES) != 2
    np.testing.assert_array_equal(result.matches[others], whole.matches[others])
    for name, scores in result.scores.items():
        right = best(whole.scores[name]) == np.arange(PLACES)
        np.testing.assert_array_equal(scores[others], whole.scores[name][others])
        assert result.metrics[name].recall_at_1 == np.count_nonzero(right & others) / PLACES, name


@pytest.mark.parametrize("asking", [Asking(), Asking(views=3), Asking(adapt=4.0)])
def test_the_network_without_learning_is_asked_as_the_model_is(asking: Asking) -> None:
    """The baseline is what the template model answers to the same presentations, adapted, too."""
    learned, queries, _, _ = case("loihi")
    views = [queries] + [encoded(PLACES, seed=view, noise=0.2) for view in range(1, asking.views)]
    comparison = Comparison(asking=asking)
    ours = recognise(learned, queries, TRUTH, comparison, further=views[1:])
    alone = recognise(template_of(learned), queries, TRUTH, comparison, further=views[1:])
    assert ours.metrics["template"] == alone.metrics[alone.default]
    np.testing.assert_array_equal(ours.scores["template"], alone.scores[alone.default])
    if asking.adapt is not None:
        assert ours.adapted["template"] == alone.adapted[alone.default]
        assert ours.adapted["hog"] == alone.adapted["hog"]


def test_baselines_that_a_model_does_not_allow_are_refused() -> None:
    learned, queries, _, _ = case("loihi")
    with pytest.raises(ConfigError, match=r"^baseline hog: the model keeps no HOG descriptors of its references"):
        recognise(dataclasses.replace(learned, hog=None), queries, TRUTH, Comparison(rivals=("sad", "hog")))
    with pytest.raises(InputError, match=r"^HOG: needs the images' HOG descriptors, which were not kept"):
        recognise(learned, dataclasses.replace(queries, hog=None), TRUTH)
    paper, queries, _, _ = case("paper")
    assert set(recognise(paper, queries, TRUTH).metrics) == {*DECODERS, "sad", "cosine", "hog"}
    with pytest.raises(ConfigError, match=r"^baseline template: preset paper is the float conductance model"):
        recognise(paper, queries, TRUTH, Comparison(rivals=("template",)))


def test_only_the_wanted_rivals_and_descriptors(tmp_path: Path) -> None:
    learned, queries, _, _ = case("loihi")
    assert set(recognise(learned, queries, TRUTH, Comparison(rivals=())).metrics) == set(DECODERS)
    assert set(recognise(learned, queries, TRUTH, Comparison(rivals=("sad",))).metrics) == {*DECODERS, "sad"}
    rng = np.random.default_rng(3)
    vectors = rng.normal(size=(PLACES, 32))
    np.save(tmp_path / "r.npy", vectors)
    np.save(tmp_path / "q.npy", 3 * vectors + 0.1 * rng.normal(size=vectors.shape))
    files = (tmp_path / "r.npy", tmp_path / "q.npy")
    result = recognise(learned, queries, TRUTH, Comparison(descriptors=files))
    assert result.metrics["descriptors"].recall_at_1 == 1
    assert list(as_json(learned, result)["baselines"]) == ["sad", "cosine", "hog", "template", "descriptors"]
    two = train([encoded(PLACES), encoded(PLACES, noise=0.1)], learned.config)
    with pytest.raises(InputError, match=r"r\.npy: has 8 rows for 16 images"):
        recognise(two, queries, TRUTH, Comparison(descriptors=files))


@pytest.mark.parametrize("length", [2, 5, 8])
def test_sequences_are_windows_of_the_single_scores(length: int) -> None:
    learned, queries, counts, _ = case("loihi")
    result, single = recognise(learned, queries, TRUTH, Comparison(sequence=length)), recognise(learned, queries, TRUTH)
    windows = PLACES - length + 1
    assert result.truth.shape == (windows, windows)
    np.testing.assert_array_equal(result.counts, counts)
    for name, scores in result.scores.items():
        shares = single.scores[name] / np.abs(single.scores[name]).sum(axis=1, keepdims=True)
        literal = [[sum(shares[q + k, r + k] for k in range(length)) for r in range(windows)] for q in range(windows)]
        np.testing.assert_allclose(scores, literal, rtol=1e-12, err_msg=name)
    causal = sequences.sequence_scores(single.scores[single.default], length)
    np.testing.assert_array_equal(result.scores[result.default], causal)
    np.testing.assert_array_equal(result.confidence, confidence("sequence", causal))


@pytest.mark.parametrize("seed", [None, 7])
def test_rasters_of_the_report_hold_the_counted_spikes(seed: int | None) -> None:
    learned, queries, _, _ = case("loihi")
    truth = np.roll(TRUTH, 4, axis=1)
    truth[: PLACES // 2] = TRUTH[: PLACES // 2]  # so that right and wrong answers exist
    result = recognise(learned, queries, truth, seed=seed)
    data = report_data(learned, queries, result, "lava-vpr eval", 1, seed)
    assert len(data.rasters) == 4
    for raster in data.rasters:
        counted = np.bincount(raster.spike_neurons, minlength=learned.neurons)
        np.testing.assert_array_equal(counted, result.counts[raster.query])
        assert raster.place == result.matches[raster.query]
        assert raster.steps == learned.config.network.steps
        assert raster.input_spikes > 0
    right = [result.truth[r.query, r.place] for r in data.rasters]
    assert sorted(right) == [False, False, True, True]
    # Counts of a run that did not spike like this: nothing false is shown.
    other = dataclasses.replace(result, counts=result.counts + 1)
    assert report_data(learned, queries, other, "lava-vpr eval", 1, seed).rasters == ()
    assert report_data(*_paper_parts()).rasters == ()


def _paper_parts() -> tuple[Model, EncodedTraverse, object, str, int, None]:
    learned, queries, _, _ = case("paper")
    return learned, queries, recognise(learned, queries, TRUTH), "lava-vpr eval", 1, None
