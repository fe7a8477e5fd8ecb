"""VPRTempo against a literal version of its equations, cases done by hand, recall on images, and in turns with ours."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.small_models import encoded, small_model, two_images_a_place

from benchmarks.peers import side_by_side, vprtempo
from benchmarks.peers.vprtempo import (
    Layer,
    VprTempo,
    VprTempoConfig,
    feature_step,
    input_spikes,
    output_step,
    preprocess,
)
from lava_vpr.bench.measure import matchers as timed
from lava_vpr.errors import InputError
from lava_vpr.matching.evaluation import Metrics, evaluate
from lava_vpr.synthetic.world import write_traverses
from lava_vpr.traverse import open_traverse

INPUTS, FEATURES, PLACES = 12, 9, 4


def some_layer(neurons: int, inputs: int, seed: int, *, rate: bool) -> Layer:
    """A layer with weights of both signs and gaps."""
    rng = np.random.default_rng(seed)
    layer = vprtempo.new_layer(neurons, inputs, 0.5, 0.6, rng)
    targets = np.linspace(0.2, 0.9, neurons, dtype=np.float32) if rate else np.zeros(0, np.float32)
    threshold, constant = rng.uniform(0, 0.05, (2, neurons)).astype(np.float32)
    return Layer(layer.weights, threshold, constant if rate else np.zeros_like(constant), targets)


def copy_of(layer: Layer) -> Layer:
    """One that can be changed."""
    return Layer(*(array.copy() for array in (layer.weights, layer.threshold, layer.constant, layer.rate)))


def literal_total(layer: Layer, spikes: NDArray[np.float32]) -> list[float]:
    """Net input of each neuron, in float64 and in loops."""
    return [
        float(layer.constant[j]) + sum(float(w) * float(x) for w, x in zip(row, spikes, strict=True))
        for j, row in enumerate(layer.weights)
    ]


def literal_weights(
    layer: Layer, total: list[float], pre: list[float], up: list[float], down: list[float], eta: float
) -> NDArray[np.float64]:
    """Every connection by itself: rule, sign kept, then inhibition balanced."""
    after = layer.weights.astype(np.float64)
    for j in range(after.shape[0]):
        for i in range(after.shape[1]):
            w = after[j, i]
            if w > 0:
                after[j, i] = min(10.0, max(1e-6, w + eta * up[j] * pre[i]))
            elif w < 0:
                w = max(-10.0, min(-1e-6, w + eta * down[j] * pre[i]))
                after[j, i] = max(-10.0, min(-1e-6, w * (1 + 50 * eta * total[j])))
    return after


def literal_feature(layer: Layer, spikes: NDArray[np.float32], share: float) -> tuple[NDArray[np.float64], list[float]]:
    """Weights and thresholds after one image."""
    total = literal_total(layer, spikes)
    post = [min(0.9, max(0.0, total[j] - float(layer.threshold[j]))) for j in range(len(total))]
    up = [0.5 - y if y > 0 else 0.0 for y in post]
    weights = literal_weights(
        layer, total, [1.0 if x > 0 else 0.0 for x in spikes], up, [-x for x in up], 0.005 * share
    )
    threshold = [
        max(0.0, float(layer.threshold[j]) + 0.15 * share * (post[j] - float(layer.rate[j]))) for j in range(len(post))
    ]
    return weights, threshold


def literal_output(
    layer: Layer, features: NDArray[np.float32], rate: NDArray[np.float32], place: int, share: float
) -> NDArray[np.float64]:
    """Weights after one image."""
    total = literal_total(layer, features)
    missing = [(0.5 if j == place else 0.0) - min(0.9, max(0.0, total[j])) for j in range(len(total))]
    pre = [float(x) / float(f) for x, f in zip(features, rate, strict=True)]
    return literal_weights(layer, total, pre, missing, missing, 0.005 * share)


def test_a_feature_step_is_the_literal_one() -> None:
    layer, rng = some_layer(FEATURES, INPUTS, 1, rate=True), np.random.default_rng(2)
    for step in range(30):
        spikes = np.where(rng.random(INPUTS) < 0.3, 0, rng.random(INPUTS)).astype(np.float32)
        before, share = copy_of(layer), 1 - step / 40
        feature_step(layer, spikes, share, VprTempoConfig())
        weights, threshold = literal_feature(before, spikes, share)
        np.testing.assert_allclose(layer.weights, weights, rtol=1e-5, atol=1e-7)
        np.testing.assert_allclose(layer.threshold, threshold, rtol=1e-5, atol=1e-7)
    assert ((layer.weights > 0) == (some_layer(FEATURES, INPUTS, 1, rate=True).weights > 0)).all()


def test_an_output_step_is_the_literal_one() -> None:
    layer, rng = some_layer(PLACES, FEATURES, 3, rate=False), np.random.default_rng(4)
    rate = np.linspace(0.2, 0.9, FEATURES, dtype=np.float32)
    layer.weights[:, 0] = 0  # no connections
    for step in range(30):
        features = np.where(rng.random(FEATURES) < 0.3, 0, 0.9 * rng.random(FEATURES)).astype(np.float32)
        before = copy_of(layer)
        output_step(layer, features, rate, step % PLACES, 0.7, VprTempoConfig())
        expected = literal_output(before, features, rate, step % PLACES, 0.7)
        np.testing.assert_allclose(layer.weights, expected, rtol=1e-5, atol=1e-7)
    assert not layer.weights[:, 0].any()


def test_one_neuron_by_hand() -> None:
    """0.5 - 0.25 = 0.25 comes in: half as much as is wanted, so both connections grow by 0.005 x 0.25."""
    layer = Layer(*(np.array(x, np.float32) for x in ([[0.5, -0.25, 0.0]], [0.0], [0.0], [0.2])))
    feature_step(layer, np.ones(3, np.float32), 1.0, VprTempoConfig())
    inhibition = -(0.25 + 0.00125) * (1 + 50 * 0.005 * 0.25)
    np.testing.assert_allclose(layer.weights, [[0.5 + 0.00125, inhibition, 0.0]], rtol=1e-6)
    np.testing.assert_allclose(layer.threshold, [0.15 * 0.05], rtol=1e-5)
    silent = copy_of(layer)
    feature_step(silent, np.zeros(3, np.float32), 1.0, VprTempoConfig())
    np.testing.assert_array_equal(silent.weights, layer.weights)  # nothing came in, nothing is learned
    assert silent.threshold[0] == 0  # and a silent neuron gets easier to excite


def test_the_wanted_neuron_learns_up_and_others_down() -> None:
    layer = Layer(*(np.array(x, np.float32) for x in ([[0.2], [0.2]], [0, 0], [0, 0], [])))
    output_step(layer, np.ones(1, np.float32), np.full(1, 0.5, np.float32), 1, 1.0, VprTempoConfig())
    np.testing.assert_allclose(layer.weights[:, 0], [0.2 - 0.005 * 0.2 / 0.5, 0.2 + 0.005 * 0.3 / 0.5], rtol=1e-6)


def test_rates_fall_every_hundred_steps() -> None:
    shares = [vprtempo._annealed(t, 400, 100) for t in (0, 100, 101, 200, 201, 301, 399)]
    np.testing.assert_allclose(shares, [1, 1, 0.5625, 0.5625, 0.25, 0.0625, 0.0625])


def test_new_weights() -> None:
    rng = np.random.default_rng(0)
    only = vprtempo.new_layer(40, 500, 0.1, 0.0, rng).weights
    np.testing.assert_allclose(only.sum(axis=1), 1, rtol=1e-5)
    assert (only > 0).mean() == pytest.approx(0.1, abs=0.01)
    both = vprtempo.new_layer(40, 500, 0.1, 0.5, rng).weights
    np.testing.assert_allclose(both.sum(axis=1), 0, atol=1e-5)
    assert (both < 0).mean() == pytest.approx(0.9 * 0.5, abs=0.02)


def test_queries_are_the_literal_ones() -> None:
    feature, output = some_layer(FEATURES, INPUTS, 5, rate=True), some_layer(PLACES, FEATURES, 6, rate=False)
    network = VprTempo(feature, output)
    spikes = np.random.default_rng(7).random((5, INPUTS)).astype(np.float32)
    for query, scores in zip(spikes, network.scores(spikes), strict=True):
        sums = [x - float(feature.constant[j]) for j, x in enumerate(literal_total(feature, query))]
        expected = literal_total(output, np.array(sums, np.float32))
        np.testing.assert_allclose(scores, expected, rtol=1e-4, atol=1e-6)


def literal_preprocess(image: NDArray[np.uint8], side: int, window: int) -> NDArray[np.float64]:
    """Grey levels before truncation, with NaN around the image."""
    blue, green, red = (image[..., k].astype(np.float64) for k in range(3))
    grey = 0.299 * red + 0.587 * green + 0.114 * blue
    grey = np.clip(grey ** (np.log(127.5) / np.log(grey.mean())), 0, 255).astype(np.float32)
    small = cv2.resize(grey, (side, side), interpolation=cv2.INTER_LINEAR).astype(np.float64)
    result, half = np.zeros((side, side)), window // 2
    for y in range(side):
        for x in range(side):
            part = small[max(0, y - half) : y + half + 1, max(0, x - half) : x + half + 1]
            result[y, x] = (small[y, x] - part.mean()) / part.std(ddof=1)
    return 255 * (1 + np.clip(result, -1, 1)) / 2


def test_preprocessing() -> None:
    image = np.random.default_rng(8).integers(0, 120, (40, 70, 3)).astype(np.uint8)
    image[:, :30] //= 3
    for side, window in ((14, 7), (20, 5)):
        made, expected = preprocess(image, side, window), literal_preprocess(image, side, window)
        assert np.abs(made - expected).max() < 1.02  # truncated
        assert (made == np.floor(expected + 1e-3)).mean() > 0.98
    flat = np.full((30, 30), 77, np.uint8)
    assert (preprocess(flat, 10, 5) == 127).all()
    assert preprocess(np.zeros((30, 30, 3), np.uint8), 10, 5).shape == (10, 10)


def scenes(places: int, side: int = 14, seed: int = 0) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Blocky images, and the same ones noisier and darker."""
    rng = np.random.default_rng(seed)
    small = rng.integers(0, 256, (places, side // 2, side // 2))
    first = small.repeat(2, axis=1).repeat(2, axis=2)
    again = np.clip(0.8 * first + rng.normal(0, 25, first.shape), 0, 255)
    return first.astype(np.uint8), again.astype(np.uint8)


def recall(scores: NDArray[np.float32], truth: NDArray[np.bool_] | None = None) -> Metrics:
    """Figures against the diagonal, or ``truth``."""
    values = scores.astype(np.float64)
    return evaluate(values, values.max(axis=1), np.eye(len(values), dtype=bool) if truth is None else truth)


def test_it_recognises_easy_images_and_only_after_learning() -> None:
    first, again = scenes(30)
    trained = vprtempo.train(input_spikes(first))
    assert recall(trained.scores(input_spikes(again))).recall_at_1 >= 0.9
    fresh = vprtempo.train(input_spikes(first), config=VprTempoConfig(learning_rate=0.0))
    assert recall(fresh.scores(input_spikes(again))).recall_at_1 <= 0.2
    assert trained.nbytes == 4 * (392 * 196 + 30 * 392)


def test_equal_seeds_give_equal_networks() -> None:
    spikes = input_spikes(scenes(6)[0])
    a, b, c = (vprtempo.train(spikes, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(a.feature.weights, b.feature.weights)
    np.testing.assert_array_equal(a.output.weights, b.output.weights)
    np.testing.assert_array_equal(a.feature.threshold, b.feature.threshold)
    assert (a.output.weights != c.output.weights).any()


def test_a_place_may_have_several_images() -> None:
    first, again = scenes(12)
    labels = np.tile(np.arange(12), 2)
    both = np.concatenate([first, scenes(12, seed=9)[0]])
    network = vprtempo.train(input_spikes(both), labels)
    assert network.output.weights.shape[0] == 12
    for queries in (again, scenes(12, seed=9)[1]):  # by chance: 0.08
        assert recall(network.scores(input_spikes(queries))).recall_at_1 >= 0.75


def test_what_is_wrong_is_said() -> None:
    spikes = input_spikes(scenes(4)[0])
    wrong: list[tuple[str, Callable[[], object]]] = [
        ("number the places of 4 images", lambda: vprtempo.train(spikes, np.array([0, 1, 3, 3]))),
        ("number the places of 4 images", lambda: vprtempo.train(spikes, np.array([0, 1]))),
        (r"\(images, pixels\) in 0..1", lambda: vprtempo.train(spikes * 2)),
        (r"\(images, pixels\) in 0..1", lambda: vprtempo.train(spikes[:0])),
        ("has 196 inputs", lambda: vprtempo.train(spikes).scores(spikes[:, :100])),
        ("must be uint8", lambda: input_spikes(np.zeros((2, 3, 3)))),  # type: ignore[arg-type]
        ("window must be odd", lambda: preprocess(np.zeros((8, 8), np.uint8), 4, 4)),
    ]
    for text, call in wrong:
        with pytest.raises(InputError, match=text):
            call()


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize(
    ("kind", "seeds", "expected"),
    [("28x28, window 7, as lava-vpr and SAD see them", (0, 1, 2), 38.5), ("56x56, window 15, its own", (0,), 52.0)],
)
def test_recall_is_vprtempo_s(data_root: Path, kind: str, seeds: tuple[int, ...], expected: float) -> None:
    """R@1 of the five sections within 3 points of what was measured for VPRTempo itself there."""
    from benchmarks.peers.vprtempo_recall import IMAGES, section
    from benchmarks.places import SECTIONS

    name = next(one for one in IMAGES if one.startswith(kind))
    found = [section(name, places, seed).recall_at_1 for places in SECTIONS for seed in seeds]
    assert 100 * float(np.mean(found)) == pytest.approx(expected, abs=3)


def test_all_in_one_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timed, "BATCH", 20)
    model, queries, truth = small_model(), encoded(noise=0.1), np.eye(8, dtype=bool)
    found = side_by_side.all_peers(model, queries, truth, threads=2, rounds=2, fill=0.0)
    assert [one.name for one in found] == ["lava-vpr", "sad", "cosine", "hog", "template", "vprtempo"]
    tempo = found[-1]
    assert tempo.queries_per_second > 0
    assert (tempo.threads, tempo.queries) == (2, 8)
    assert tempo.bytes == 4 * (1568 * 784 + 8 * 1568)
    assert tempo.metrics.queries == 8


@pytest.mark.slow
def test_what_is_timed_of_vprtempo_is_what_recall_counts() -> None:
    model, queries, truth = small_model(), encoded(noise=0.1), np.eye(8, dtype=bool)
    rng = np.random.default_rng(4)
    own = rng.integers(0, 256, (8, 56, 56), np.uint8), rng.integers(0, 256, (8, 56, 56), np.uint8)
    matchers = side_by_side.vprtempo_matchers(model, queries, truth, own)
    assert [matcher.name for matcher in matchers] == ["vprtempo_own", "vprtempo"]
    assert ["56x56" in matcher.what for matcher in matchers] == [True, False]
    assert matchers[0].bytes == 4 * (2 * 3136 * 3136 + 8 * 2 * 3136)
    for matcher in matchers:
        correct = float((matcher.answer(slice(0, 8)) == np.arange(8)).mean())
        assert correct == matcher.metrics.recall_at_1


def test_vprtempo_sees_its_own_images(tmp_path: Path) -> None:
    write_traverses(tmp_path, 3, 0)
    pair = [open_traverse(tmp_path / kind) for kind in ("reference", "query")]
    for images, traverse in zip(side_by_side.own_images(*pair), pair, strict=True):
        assert images.shape == (3, 56, 56)
        np.testing.assert_array_equal(images[1], vprtempo.preprocess(traverse.load(1), 56, 15))


def test_modules_of_vprtempo_share_the_places(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(side_by_side, "MODULE", 3)
    model = two_images_a_place()
    modules = side_by_side.train_modules(model.patches, model.labels)
    assert [module.output.weights.shape[0] for module in modules] == [3, 3, 2]
    last = model.labels >= 6
    alone = vprtempo.train(vprtempo.input_spikes(model.patches[last]), model.labels[last] - 6)
    np.testing.assert_array_equal(modules[2].output.weights, alone.output.weights)
