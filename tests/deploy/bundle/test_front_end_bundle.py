"""The front end in a bundle: played from its files alone, and refused where it is another's."""

from __future__ import annotations

import json
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lava_vpr.backends import deployed
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2, Board
from lava_vpr.deploy.bundle.folder import ReadBundle, array_bytes
from lava_vpr.deploy.bundle.front_end import check_front_end, front_end_files, front_end_player, held_sentence
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.errors import BundleError
from lava_vpr.inputs.front_end import FrontEnd

SPEC = FrontEnd(width=8, levels=8, race=6, budget=20)
TABLE = "front_end/host/cells.npy"


def model(spec: FrontEnd | None = SPEC) -> Any:
    """What is looked at of a model: the front end of its settings."""
    return SimpleNamespace(config=SimpleNamespace(encoder=SimpleNamespace(front_end=spec, direct=None)))


@pytest.fixture(scope="module")
def bundle() -> ReadBundle:
    files, facts = front_end_files(SPEC, KAPOHO_BAY, ())
    return ReadBundle(Path("b"), {"target": "kapoho-bay", "front_end": json.loads(json.dumps(facts))}, files)


def test_backend_bundle_plays_what_a_bundle_holds(bundle: ReadBundle, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = []

    @contextmanager
    def in_place_of_a_file(model: object) -> Any:
        opened.append(model)
        yield bundle

    monkeypatch.setattr(deployed, "bundle_of", in_place_of_a_file)
    grey = np.random.default_rng(1).integers(0, 256, (2, SPEC.height, SPEC.width)).astype(np.uint8)
    done, run = [], BACKENDS["bundle"].front_end
    assert run is not None
    found, expected = list(run(model(), PixelBlock(grey).in_parts(1), done.append)), SPEC.trains(grey)
    assert (done, len(opened)) == ([1, 1], 1)
    assert [list(films) for films in found] == [list(expected)] * 2
    for name, film in expected.items():
        assert np.array_equal(np.concatenate([films[name] for films in found]), film), name
        assert film.any()


SMALL = replace(KAPOHO_BAY, cores=2)


@pytest.mark.parametrize(
    ("spec", "board", "holds", "reason"),
    [
        (FrontEnd(width=8, window=8), KAPOHO_BAY, True, "no public source shows how events of a camera come to axons"),
        (SPEC, SMALL, True, "7 cores and 0 of the network, but Kapoho Bay (two Loihi 1 chips) has 4"),
        (SPEC, LOIHI_2, False, "a bundle for Loihi 2 has no files for it"),
    ],
)
def test_what_a_bundle_cannot_hold_is_left_out_and_it_says_why(
    spec: FrontEnd, board: Board, holds: bool, reason: str
) -> None:
    files, facts = front_end_files(spec, board, (), holds=holds)
    assert files == {}
    assert facts is not None
    assert held_sentence(facts).startswith(f"The bundle holds no spiking front end: {reason}")
    left_out = ReadBundle(Path("b"), {"target": board.name, "front_end": facts}, {})
    assert front_end_player(left_out) is None
    if board is not SMALL:
        check_front_end(left_out, model(spec), holds=holds)
    with pytest.raises(BundleError, match=r"is not what its settings make"):
        check_front_end(left_out, model(None), holds=holds)


def test_a_model_without_a_front_end_has_none_to_leave_out() -> None:
    assert front_end_files(None, KAPOHO_BAY, ()) == ({}, None)


def test_a_bundle_without_a_front_end_plays_none() -> None:
    empty = ReadBundle(Path("b"), {"target": "kapoho-bay"}, {})
    check_front_end(empty, model())
    assert front_end_player(empty) is None


def test_a_front_end_as_it_was_written_is_taken(bundle: ReadBundle) -> None:
    check_front_end(bundle, model())


@pytest.mark.parametrize(
    ("facts", "files", "spec", "words"),
    [
        ({"steps": SPEC.steps + 1}, {}, SPEC, r"manifest.json: what it says of a front end is not what its settings"),
        ({}, {}, None, r"manifest.json: what it says of a front end is not what its settings"),
        ({}, {"front_end/more.npy": b""}, SPEC, r"front_end/more.npy: is no part of the front end; "),
        ({}, {TABLE: array_bytes(np.zeros((8 * 4, 3), np.int32))}, SPEC, rf"{TABLE}: contradicts the rest"),
    ],
)
def test_another_front_end_is_refused(
    bundle: ReadBundle, facts: dict[str, int], files: dict[str, bytes], spec: FrontEnd | None, words: str
) -> None:
    said = {**bundle.manifest, "front_end": {**bundle.manifest["front_end"], **facts}}
    with pytest.raises(BundleError, match=rf"^b/{words}"):
        check_front_end(replace(bundle, manifest=said, files={**bundle.files, **files}), model(spec))


def test_files_of_a_front_end_that_the_manifest_does_not_tell_are_refused(bundle: ReadBundle) -> None:
    with pytest.raises(BundleError, match=r"^b/manifest.json: what it says of a front end"):
        check_front_end(replace(bundle, manifest={"target": "kapoho-bay"}), model())
