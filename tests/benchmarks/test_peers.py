"""Peers: each answers as its slow definition does, and what is absent is said."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from support.common.helpers import encoded, small_model, tiny_paper

from lava_vpr.bench import peers, vprtempo
from lava_vpr.encoding import query_rates
from lava_vpr.engine.conductance.model import initial_state
from lava_vpr.errors import BackendUnavailableError, InputError
from lava_vpr.matching import baselines
from lava_vpr.model import Model
from lava_vpr.recognition import recognise


def two_images_a_place() -> Model:
    """The small model with each place seen twice, in no order."""
    model, more = small_model(), encoded(8, seed=5)
    order = np.random.default_rng(1).permutation(16)
    return dataclasses.replace(
        model,
        labels=np.tile(np.arange(8), 2)[order],
        patches=np.concatenate([model.patches, more.patches])[order],
        activity=np.concatenate([model.activity, more.activity])[order],
    )


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
    monkeypatch.setattr(peers, "interpreter", lambda: None)
    model, queries, truth = small_model(), encoded(noise=0.1), np.eye(8, dtype=bool)
    told: list[str] = []
    own, sad, cosine, tempo, brian = peers.run_peers(
        model, queries, truth, threads=2, rounds=2, fill=0.0, advance=told.append
    )
    known = recognise(model, queries, truth)
    assert [one.name for one in (own, sad, cosine, tempo, brian)] == list(peers.WHATS)
    assert own.metrics == known.metrics[known.default]
    assert (sad.metrics, cosine.metrics) == (known.metrics["sad"], known.metrics["cosine"])
    for one in (own, sad, cosine, tempo):
        assert one.queries_per_second is not None
        assert one.queries_per_second > 0
        assert (one.threads, one.queries, one.absent) == (2, 8, "")
    assert own.bytes == model.network.weights.nbytes + model.responses.nbytes
    assert tempo.bytes == 4 * (1568 * 784 + 8 * 1568)
    assert tempo.metrics is not None
    assert tempo.metrics.queries == 8
    assert brian.metrics is None
    assert brian.queries_per_second is None
    assert "make peers" in brian.absent
    assert told[-1] == "the reference network in Brian2"


def test_what_is_timed_is_what_recall_counts() -> None:
    model, queries, truth = small_model(), encoded(noise=0.1), np.eye(8, dtype=bool)
    known = recognise(model, queries, truth)
    matchers = peers._matchers(model, queries, truth, known, model.config.seed, lambda text: None)
    first = {one.name: one.answer(slice(0, 8)) for one in matchers}
    np.testing.assert_array_equal(first["lava-vpr"], known.matches)
    for one in matchers:
        correct = float((first[one.name] == np.arange(8)).mean())
        assert correct == one.metrics.recall_at_1, one.name


def test_modules_of_vprtempo_share_the_places(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peers, "MODULE", 3)
    model = two_images_a_place()
    modules = peers.train_modules(model)
    assert [module.output.weights.shape[0] for module in modules] == [3, 3, 2]
    last = model.labels >= 6
    alone = vprtempo.train(vprtempo.input_spikes(model.patches[last]), model.labels[last] - 6)
    np.testing.assert_array_equal(modules[2].output.weights, alone.output.weights)


def test_wrong_queries_are_refused() -> None:
    model, queries = small_model(), encoded()
    with pytest.raises(InputError, match=r"8 queries, 8 places, but ground truth of shape \(8, 7\)"):
        peers.run_peers(model, queries, np.zeros((8, 7), bool))
    with pytest.raises(InputError, match="0 queries"):
        peers.run_peers(model, encoded(0), np.zeros((0, 8), bool))


def test_which_python_has_brian2(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(peers.PYTHON, "/there/python")
    assert peers.interpreter() == "/there/python"
    monkeypatch.delenv(peers.PYTHON)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: object() if name == "brian2" else None)
    assert peers.interpreter() == sys.executable


def fake(folder: Path, body: str) -> str:
    """A Python that does ``body`` instead; $3 is the folder of the exchange."""
    path = folder / "python"
    path.write_text(f"#!/bin/sh\n{body}\n", encoding="utf-8")
    path.chmod(0o755)
    return str(path)


def test_what_brian2_tells_is_taken_over(tmp_path: Path) -> None:
    found = {"version": "2.9.0", "seconds": [4.0, 2.0, 1.0], "spikes": [5, 6, 7]}
    command = f"test -f $3/given.npz && test -f $3/config.json && echo '{json.dumps(found)}' > $3/found.json"
    peer = peers.brian2_peer(small_model(), encoded(), 3, fake(tmp_path, command))
    assert (peer.queries_per_second, peer.queries, peer.threads, peer.absent) == (0.5, 3, 1, "")
    assert "recall not computed" in peer.what
    assert "2.9.0" in peer.what
    assert peer.metrics is None


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("echo 'No module named brian2' >&2; exit 1", r"did not run \(No module named brian2\); pip install"),
        ("exit 0", "did not run \\(it says nothing\\)"),
        ("sleep 5", "took more than 0 s"),
    ],
)
def test_why_brian2_did_not_run(tmp_path: Path, body: str, reason: str) -> None:
    config = tiny_paper()
    state, rate_hz = initial_state(config, 784), np.zeros((1, 784))
    timeout = 0.3 if body.startswith("sleep") else 10.0
    with pytest.raises(BackendUnavailableError, match=reason):
        peers.in_brian2(config, state, rate_hz, fake(tmp_path, f"exec {body}" if "sleep" in body else body), timeout)


def test_a_python_that_is_not_there(tmp_path: Path) -> None:
    peer = peers.brian2_peer(small_model(), encoded(), 3, str(tmp_path / "none"))
    assert "none: cannot be started" in peer.absent
    assert peers.PYTHON in peer.absent


@pytest.mark.slow
def test_the_reference_network_runs_in_brian2() -> None:
    python = peers.interpreter()
    if python is None:
        pytest.skip("needs Brian2: make peers")
    config = tiny_paper()
    state = initial_state(config, 784)
    rate_hz = np.random.default_rng(0).random((2, 784)) * 60
    found = peers.in_brian2(config, state, rate_hz, python)
    assert len(found["seconds"]) == 2
    assert min(found["spikes"]) > 0
