"""Baselines: against loops, several images of a place, files that cannot be used, and the figures on real images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from support.fuzz.changes import stored as npy

from lava_vpr.backends.rivals import descriptor_similarities
from lava_vpr.errors import InputError
from lava_vpr.inputs.patches import hog, patch_normalised
from lava_vpr.matching import baselines
from lava_vpr.matching.baselines import cosine_similarities, sad_distances
from lava_vpr.matching.decoders import confidence
from lava_vpr.matching.evaluation import Metrics, evaluate
from lava_vpr.matching.sequences import sequence_scores, sequence_truth
from lava_vpr.vectors.files import load_descriptors


def images(seed: int, n: int, side: int = 5) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (n, side, side), dtype=np.uint8)


def labels_for(seed: int, n: int, places: int) -> NDArray[np.int64]:
    """``n`` labels in random order, every one of ``places`` at least once."""
    rng = np.random.default_rng(seed)
    return rng.permutation(np.concatenate([np.arange(places), rng.integers(0, places, n - places)]))


def literal_sad(references: Any, queries: Any, labels: Any) -> list[list[float]]:
    def distance(a: Any, b: Any) -> float:
        return float(np.mean([abs(int(x) - int(y)) for x, y in zip(a.flat, b.flat, strict=True)]))

    return [
        [min(distance(r, q) for r, place in zip(references, labels, strict=True) if place == m)
         for m in range(max(labels) + 1)]
        for q in queries
    ]  # fmt: skip


def literal_cosine(references: Any, queries: Any, labels: Any) -> list[list[float]]:
    def similarity(a: Any, b: Any) -> float:
        lengths = float(a @ a) ** 0.5 * float(b @ b) ** 0.5
        return float(a @ b) / lengths if lengths else 0.0

    return [
        [max(similarity(r, q) for r, place in zip(references, labels, strict=True) if place == m)
         for m in range(max(labels) + 1)]
        for q in queries
    ]  # fmt: skip


@given(seed=st.integers(0, 1000), places=st.integers(1, 5), extra=st.integers(0, 6), rows=st.integers(1, 4))
@settings(deadline=None, max_examples=40, derandomize=True)
def test_matchers_equal_the_loops_in_blocks_of_any_size(seed: int, places: int, extra: int, rows: int) -> None:
    references, queries, labels = (
        images(seed, places + extra),
        images(seed + 1, 3),
        labels_for(seed, places + extra, places),
    )
    vectors = [np.random.default_rng(seed + k).normal(size=(n, 6)) for k, n in enumerate((places + extra, 3))]
    vectors[0][0] = vectors[1][0] = 0
    before = baselines.BLOCK_ROWS
    try:
        baselines.BLOCK_ROWS = rows
        distances = sad_distances(references, queries, labels)
        similarities = cosine_similarities(*vectors, labels)
    finally:
        baselines.BLOCK_ROWS = before
    np.testing.assert_allclose(distances, literal_sad(references, queries, labels), rtol=1e-14)
    np.testing.assert_allclose(similarities, literal_cosine(*vectors, labels), atol=1e-12)


def test_without_labels_every_image_is_a_place() -> None:
    references, queries = images(0, 7), images(1, 4)
    distances = sad_distances(references, queries)
    np.testing.assert_array_equal(distances, sad_distances(references, queries, np.arange(7)))
    assert distances.shape == (4, 7)
    assert (np.diag(sad_distances(references, references)) == 0).all()


def test_distances_use_the_full_range() -> None:
    black, white = np.zeros((1, 28, 28), np.uint8), np.full((1, 28, 28), 255, np.uint8)
    assert sad_distances(black, white).tolist() == sad_distances(white, black).tolist() == [[255.0]]


def test_integer_rates_give_the_same_bits_alone_and_in_a_batch() -> None:
    rng = np.random.default_rng(0)
    references, queries = (rng.integers(0, 65536, (n, 784)).astype(np.uint16) for n in (150, 60))
    whole = cosine_similarities(references, queries)
    np.testing.assert_array_equal(cosine_similarities(references, queries[7:8])[0], whole[7])
    np.testing.assert_array_equal(cosine_similarities(references[20:21], queries)[:, 0], whole[:, 20])
    exact = (queries[7].astype(object) @ references[20].astype(object)) / np.sqrt(
        float(queries[7].astype(object) @ queries[7].astype(object))
    )
    expected = exact / np.sqrt(float(references[20].astype(object) @ references[20].astype(object)))
    assert whole[7, 20] == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        (np.array([0, 1]), "labels: shape (2,), must be one place number for each of 3 references"),
        (np.array([0.0, 1.0, 2.0]), "must be one place number for each of 3 references"),
        (np.array([0, 2, 2]), "labels: place 1 has no reference image; number the places 0, 1, 2"),
        (np.array([1, 2, 3]), "labels: place 0 has no reference image"),
        (np.array([-1, 0, 1]), "labels: -1 is negative"),
        (np.array([0, 1, 2**60]), "labels: place 2 has no reference image"),
    ],
)
def test_labels_with_gaps_are_refused(labels: Any, message: str) -> None:
    for call in (lambda: sad_distances(images(0, 3), images(1, 1), labels),
                 lambda: cosine_similarities(np.ones((3, 2)), np.ones((1, 2)), labels)):  # fmt: skip
        with pytest.raises(InputError) as error:
            call()
        assert message in str(error.value)


def test_images_that_do_not_compare_are_refused() -> None:
    with pytest.raises(InputError, match="reference and query images are 5x5 and 4x4 pixels; preprocess both alike"):
        sad_distances(images(0, 3), images(0, 3, side=4))
    with pytest.raises(InputError, match=r"query images: float64 of shape \(2, 5, 5\), must be uint8"):
        sad_distances(images(0, 3), np.ones((2, 5, 5)))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"vectors have 2 \(reference\) and 3 \(query\) elements; encode both alike"):
        cosine_similarities(np.ones((1, 2)), np.ones((1, 3)))
    with pytest.raises(InputError, match=r"reference vectors: shape \(2,\), must be"):
        cosine_similarities(np.ones(2), np.ones((1, 2)))


# Descriptors from files.


def test_descriptors_are_compared_by_cosine(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    references, queries = rng.normal(size=(6, 9)).astype(np.float16), rng.normal(size=(4, 9)).astype(np.float32)
    np.save(tmp_path / "r.npy", references)
    np.save(tmp_path / "q.npy", np.asfortranarray(queries))
    found = descriptor_similarities(tmp_path / "r.npy", tmp_path / "q.npy", n_references=6, n_queries=4)
    expected = literal_cosine(references.astype(float), queries.astype(float), range(6))
    np.testing.assert_allclose(found, expected, atol=1e-12)
    labels = np.array([0, 0, 1, 1, 2, 2])
    grouped = descriptor_similarities(tmp_path / "r.npy", tmp_path / "q.npy", labels=labels)
    np.testing.assert_allclose(grouped, np.maximum(found[:, ::2], found[:, 1::2]))


@given(place=st.integers(0, 127), value=st.integers(0, 255))
@settings(deadline=None, max_examples=150, derandomize=True)
def test_a_damaged_header_is_an_error_of_the_input(tmp_path_factory: Any, place: int, value: int) -> None:
    content = bytearray(npy(np.ones((2, 3))))
    content[place] = value
    path = tmp_path_factory.getbasetemp() / "damaged.npy"
    path.write_bytes(content)
    try:
        found = f"{path}: {load_descriptors(path).ndim}"
    except InputError as error:
        found = str(error)
    assert found.startswith(f"{path}: ")


def test_descriptors_of_two_networks_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "r.npy", np.ones((2, 3)))
    np.save(tmp_path / "q.npy", np.ones((2, 4)))
    with pytest.raises(InputError, match=r"q\.npy: descriptors of 4 dimensions, but .*r\.npy has 3; compute both"):
        descriptor_similarities(tmp_path / "r.npy", tmp_path / "q.npy")


# Real images: Nordland, summer as reference, winter as query.


@pytest.fixture(scope="module")
def nordland_distances(data_root: Path) -> NDArray[np.float64]:
    patches = []
    for season in ("summer", "winter"):
        paths = sorted((data_root / "data" / "nordland" / season).glob("*.png"))[:500]
        patches.append(np.stack([patch_normalised(cv2.imread(str(path))) for path in paths]))  # type: ignore[arg-type]
    return sad_distances(*patches)


def sad_metrics(distances: NDArray[np.float64]) -> Metrics:
    return evaluate(-distances, confidence("sad", -distances), np.eye(len(distances), dtype=bool))


@pytest.mark.data
def test_sad_on_sections_of_nordland(nordland_distances: NDArray[np.float64]) -> None:
    sections = [sad_metrics(nordland_distances[k : k + 100, k : k + 100]) for k in range(0, 500, 100)]
    assert np.mean([m.recall_at_1 for m in sections]) == pytest.approx(0.578, abs=5e-4)
    assert np.mean([m.recall_at_100_precision for m in sections]) == pytest.approx(0.154, abs=5e-4)
    assert np.mean([m.auc for m in sections]) == pytest.approx(0.487, abs=5e-4)


@pytest.mark.data
def test_hog_on_sections_of_nordland(data_root: Path) -> None:
    """OpenCV's HOG of 64x64 pixels with its own settings, and no better with values that are not rounded."""
    found, unrounded = [], []
    for season in ("summer", "winter"):
        paths = sorted((data_root / "data" / "nordland" / season).glob("*.png"))[:500]
        pictures = [cv2.imread(str(path)) for path in paths]
        found.append(np.stack([hog(picture) for picture in pictures]))
        small = [cv2.cvtColor(cv2.resize(picture, (64, 64)), cv2.COLOR_BGR2GRAY) for picture in pictures]
        descriptor = cv2.HOGDescriptor((64, 64), (16, 16), (8, 8), (8, 8), 9)
        unrounded.append(np.stack([descriptor.compute(one).ravel() for one in small]))
    for summer, winter in (found, unrounded):
        sections = []
        for k in range(0, 500, 100):
            scores = cosine_similarities(summer[k : k + 100], winter[k : k + 100])
            sections.append(evaluate(scores, confidence("hog", scores), np.eye(100, dtype=bool)))
        assert np.mean([m.recall_at_1 for m in sections]) == pytest.approx(0.880, abs=3e-3)
        assert np.mean([m.recall_at_100_precision for m in sections]) == pytest.approx(0.726, abs=2e-2)
        assert np.mean([m.auc for m in sections]) == pytest.approx(0.873, abs=3e-3)


@pytest.mark.data
def test_sad_on_nordland_in_one_list(nordland_distances: NDArray[np.float64]) -> None:
    metrics = sad_metrics(nordland_distances)
    assert metrics.recall_at_1 == pytest.approx(0.422, abs=5e-4)
    assert metrics.recall_at_100_precision == pytest.approx(0.008, abs=5e-4)
    assert metrics.auc == pytest.approx(0.298, abs=5e-4)


@pytest.mark.data
@pytest.mark.parametrize(("length", "recall"), [(5, 0.837), (10, 0.949)])
def test_sequences_of_sad_on_nordland(nordland_distances: NDArray[np.float64], length: int, recall: float) -> None:
    scores = sequence_scores(-nordland_distances, length)
    truth = sequence_truth(np.eye(500, dtype=bool), length)
    metrics = evaluate(scores, confidence("sequence", scores), truth)
    assert metrics.recall_at_1 == pytest.approx(recall, abs=5e-4)
