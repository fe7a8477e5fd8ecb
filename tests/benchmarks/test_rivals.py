"""Other systems beside ours: VPRTempo takes turns with the matchers, Brian2 answers or it is said why not."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from support.common.small_models import encoded, small_model, tiny_paper, two_images_a_place

from benchmarks.peers import rivals, side_by_side, vprtempo
from lava_vpr.bench.measure import matchers as timed
from lava_vpr.engine.conductance.model import initial_state
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.synthetic.world import write_traverses
from lava_vpr.traverse import open_traverse


def test_all_in_one_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timed, "BATCH", 20)
    monkeypatch.setattr(rivals, "interpreter", lambda: None)
    model, queries, truth = small_model(), encoded(noise=0.1), np.eye(8, dtype=bool)
    found = side_by_side.all_peers(model, queries, truth, threads=2, rounds=2, fill=0.0)
    assert [one.name for one in found] == ["lava-vpr", "sad", "cosine", "hog", "template", "vprtempo", "brian2"]
    tempo, brian = found[-2:]
    assert tempo.queries_per_second > 0
    assert (tempo.threads, tempo.queries, tempo.absent) == (2, 8, "")
    assert tempo.bytes == 4 * (1568 * 784 + 8 * 1568)
    assert tempo.metrics.queries == 8
    assert brian.metrics is None
    assert brian.queries_per_second is None
    assert "make peers" in brian.absent


@pytest.mark.slow
def test_what_is_timed_of_vprtempo_is_what_recall_counts() -> None:
    model, queries, truth = small_model(), encoded(noise=0.1), np.eye(8, dtype=bool)
    rng = np.random.default_rng(4)
    own = rng.integers(0, 256, (8, 56, 56), np.uint8), rng.integers(0, 256, (8, 56, 56), np.uint8)
    matchers = rivals.vprtempo_matchers(model, queries, truth, own)
    assert [matcher.name for matcher in matchers] == ["vprtempo_own", "vprtempo"]
    assert ["56x56" in matcher.what for matcher in matchers] == [True, False]
    assert matchers[0].bytes == 4 * (2 * 3136 * 3136 + 8 * 2 * 3136)
    for matcher in matchers:
        correct = float((matcher.answer(slice(0, 8)) == np.arange(8)).mean())
        assert correct == matcher.metrics.recall_at_1


def test_vprtempo_sees_its_own_images(tmp_path: Path) -> None:
    write_traverses(tmp_path, 3, 0)
    pair = [open_traverse(tmp_path / kind) for kind in ("reference", "query")]
    for images, traverse in zip(rivals.own_images(*pair), pair, strict=True):
        assert images.shape == (3, 56, 56)
        np.testing.assert_array_equal(images[1], vprtempo.preprocess(traverse.load(1), 56, 15))


def test_modules_of_vprtempo_share_the_places(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rivals, "MODULE", 3)
    model = two_images_a_place()
    modules = rivals.train_modules(model.patches, model.labels)
    assert [module.output.weights.shape[0] for module in modules] == [3, 3, 2]
    last = model.labels >= 6
    alone = vprtempo.train(vprtempo.input_spikes(model.patches[last]), model.labels[last] - 6)
    np.testing.assert_array_equal(modules[2].output.weights, alone.output.weights)


def test_which_python_has_brian2(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(rivals.PYTHON, "/there/python")
    assert rivals.interpreter() == "/there/python"
    monkeypatch.delenv(rivals.PYTHON)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: object() if name == "brian2" else None)
    assert rivals.interpreter() == sys.executable


def fake(folder: Path, body: str) -> str:
    """A Python that does ``body`` instead; $2 is the folder of the exchange."""
    path = folder / "python"
    path.write_text(f"#!/bin/sh\n{body}\n", encoding="utf-8")
    path.chmod(0o755)
    return str(path)


def test_what_brian2_tells_is_taken_over(tmp_path: Path) -> None:
    found = {"version": "2.9.0", "seconds": [4.0, 2.0, 1.0], "spikes": [5, 6, 7]}
    command = f"test -f $2/given.npz && test -f $2/config.json && echo '{json.dumps(found)}' > $2/found.json"
    peer = rivals.brian2_peer(small_model(), encoded(), 3, fake(tmp_path, command))
    assert (peer.queries_per_second, peer.queries, peer.threads, peer.absent) == (0.5, 3, 1, "")
    assert "recall not computed" in peer.what
    assert "2.9.0" in peer.what
    assert peer.metrics is None


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("echo 'No module named brian2' >&2; exit 1", r"did not run \(No module named brian2\); run make peers"),
        ("exit 0", "did not run \\(it says nothing\\)"),
        ("sleep 5", "took more than 0 s"),
    ],
)
def test_why_brian2_did_not_run(tmp_path: Path, body: str, reason: str) -> None:
    config = tiny_paper()
    state, rate_hz = initial_state(config, 784), np.zeros((1, 784))
    timeout = 0.3 if body.startswith("sleep") else 10.0
    with pytest.raises(BackendUnavailableError, match=reason):
        rivals.in_brian2(config, state, rate_hz, fake(tmp_path, f"exec {body}" if "sleep" in body else body), timeout)


def test_a_python_that_is_not_there(tmp_path: Path) -> None:
    peer = rivals.brian2_peer(small_model(), encoded(), 3, str(tmp_path / "none"))
    assert "none: cannot be started" in peer.absent
    assert rivals.PYTHON in peer.absent


@pytest.mark.slow
def test_the_reference_network_runs_in_brian2() -> None:
    python = rivals.interpreter()
    if python is None:
        pytest.skip("needs Brian2: make peers")
    config = tiny_paper()
    state = initial_state(config, 784)
    rate_hz = np.random.default_rng(0).random((2, 784)) * 60
    found = rivals.in_brian2(config, state, rate_hz, python)
    assert len(found["seconds"]) == 2
    assert min(found["spikes"]) > 0
