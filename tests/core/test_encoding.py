"""Images to activity: what is kept is what was asked for, and batches are the whole."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from support.common.small_models import encoded, small_config, small_model

from lava_vpr import readers
from lava_vpr.config import EncoderConfig
from lava_vpr.encoding import EncodedTraverse, Keep, encode_traverse, encoded_batches
from lava_vpr.errors import InputError
from lava_vpr.images.videos import video_samples
from lava_vpr.inputs.patches import patch_normalised
from lava_vpr.inputs.views import STRAIGHT
from lava_vpr.recognition import Comparison, recognise
from lava_vpr.report.build import report_data
from lava_vpr.training import train
from lava_vpr.traverse import Traverse, open_traverse

IMAGES = 7


@pytest.fixture(scope="module")
def traverse(tmp_path_factory: pytest.TempPathFactory) -> Traverse:
    """Images with numbers from 3 on, colour and grey."""
    folder, rng = tmp_path_factory.mktemp("images"), np.random.default_rng(0)
    for k in range(IMAGES + 3):
        shape = (24, 32, 3) if k % 2 else (30, 40)
        cv2.imwrite(str(folder / f"{k}.png"), rng.integers(0, 256, shape).astype(np.uint8))
    return open_traverse(folder, places=(3, IMAGES + 3))


def plain(images: EncodedTraverse) -> EncodedTraverse:
    """The images with nothing kept beside their activity."""
    return EncodedTraverse(images.names, images.indices, images.activity)


@pytest.mark.parametrize("kind", ["orientation", "pixels"])
@pytest.mark.parametrize("keep", [Keep.NOTHING, Keep.PATCHES, Keep.THUMBNAILS, Keep.ALL])
def test_what_is_kept_is_what_was_asked_for(traverse: Traverse, kind: str, keep: Keep) -> None:
    images = encode_traverse(traverse, EncoderConfig(kind=kind), keep)
    assert (images.patches is not None) == (keep in (Keep.PATCHES, Keep.ALL))
    assert (images.thumbnails is not None) == (keep in (Keep.THUMBNAILS, Keep.ALL))
    np.testing.assert_array_equal(images.activity, encode_traverse(traverse, EncoderConfig(kind=kind)).activity)
    for number, image in enumerate(traverse.images()):
        if images.patches is not None:
            np.testing.assert_array_equal(images.patches[number], patch_normalised(image))
        if images.thumbnails is not None:
            colour = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
            small = cv2.resize(colour, (64, 48), interpolation=cv2.INTER_AREA)
            np.testing.assert_array_equal(images.thumbnails[number], small)


@pytest.mark.parametrize("size", [1, 2, 3, IMAGES - 1, IMAGES, IMAGES + 1, 100])
def test_batches_are_the_whole(traverse: Traverse, size: int) -> None:
    whole = encode_traverse(traverse, EncoderConfig())
    batches = [batch for (batch,) in encoded_batches(traverse, EncoderConfig(), (STRAIGHT,), size)]
    assert [len(batch) for batch in batches] == [min(size, IMAGES - start) for start in range(0, IMAGES, size)]
    assert sum((batch.names for batch in batches), ()) == whole.names
    np.testing.assert_array_equal(np.concatenate([batch.indices for batch in batches]), np.arange(3, IMAGES + 3))
    np.testing.assert_array_equal(np.concatenate([batch.activity for batch in batches]), whole.activity)


def test_batches_of_a_video_are_decoded_in_one_pass(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = cv2.VideoWriter(str(tmp_path / "drive.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (64, 48))
    for picture in np.random.default_rng(0).integers(0, 256, (11, 6, 8, 3)).astype(np.uint8):
        writer.write(cv2.resize(picture, (64, 48)))
    writer.release()
    passes: list[object] = []
    monkeypatch.setattr(readers, "video_samples", lambda *given: passes.append(given) or video_samples(*given))
    video = open_traverse(tmp_path / "drive.avi", every=0.1).between(2, 11)
    whole = encode_traverse(video, EncoderConfig())
    passes.clear()
    batches = [batch for (batch,) in encoded_batches(video, EncoderConfig(), (STRAIGHT,), 4)]
    assert [batch.names for batch in batches] == [whole.names[:4], whole.names[4:8], whole.names[8:]]
    np.testing.assert_array_equal(np.concatenate([batch.activity for batch in batches]), whole.activity)
    assert len(np.unique(whole.activity, axis=0)) == 9
    assert len(passes) == 1


def test_a_batch_is_encoded_when_it_is_asked_for(traverse: Traverse) -> None:
    missing = Traverse("list", traverse.indices, (*traverse.paths[:4], "missing.png", *traverse.paths[5:]))
    batches = encoded_batches(missing, EncoderConfig(), (STRAIGHT,), 2)
    assert [next(batches)[0].names, next(batches)[0].names] == [traverse.names[:2], traverse.names[2:4]]
    with pytest.raises(InputError, match=r"missing\.png"):
        next(batches)


def test_what_was_not_kept_is_refused_to_who_needs_it() -> None:
    model, queries, truth = small_model(), plain(encoded()), np.eye(8, dtype=bool)
    with pytest.raises(InputError, match=r"^SAD: needs the images' patches.*Keep\.PATCHES$"):
        recognise(model, queries, truth)
    result = recognise(model, queries, truth, Comparison(rivals=("cosine",)))
    with pytest.raises(InputError, match=r"^the report: needs the images' thumbnails.*Keep\.THUMBNAILS$"):
        report_data(model, queries, result, "", 1, None)
    with pytest.raises(InputError, match=r"^training: needs the images' patches"):
        train([queries], small_config())
