"""Images to activity: what is kept is what was asked for, and batches are the whole."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.common.imagefiles import image_bytes, smooth_picture, written
from support.common.small_models import encoded, small_config, small_model

from lava_vpr import encoding, readers
from lava_vpr.config import EncoderConfig
from lava_vpr.encoding import EncodedTraverse, Keep, encode_traverse, encode_views, encoded_batches
from lava_vpr.errors import InputError
from lava_vpr.images import imagefiles
from lava_vpr.images.imagefiles import side_by_side
from lava_vpr.images.videos import video_samples
from lava_vpr.inputs.patches import patch_normalised
from lava_vpr.inputs.views import STRAIGHT, View
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
    monkeypatch.setattr(encoding, "LARGE", 1)  # threads or not
    batches = [batch for (batch,) in encoded_batches(video, EncoderConfig(), (STRAIGHT,), 4, threads=2)]
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


JPEG, DIM = image_bytes(".jpg", smooth_picture(1, (60, 80))), image_bytes(".png", np.full((9, 9), 200, np.uint16))
ODD = {
    "nothing": b"",
    "cut short": JPEG[:-9],
    "pixels missing": JPEG[: len(JPEG) // 2] + b"\xff\xd9",  # which the codec alone says, on standard error
    "dim": DIM,  # which is noted, and read
    "large": image_bytes(".jpg", smooth_picture(1, (60, 90))),
    "too large": image_bytes(".png", np.zeros((200, 300), np.uint8)),
}


def told(source: Traverse, threads: int, notes: pytest.LogCaptureFixture) -> tuple[list[int], tuple[object, ...]]:
    """How many images are told of at a time; and what encoding gives, and tells."""
    notes.clear()
    parts, done, said = list[bytes](), [0], ""
    views = STRAIGHT, View(0.1)
    try:
        for images in encode_views(source, EncoderConfig(), views, Keep.ALL, done.append, threads=threads):
            parts += [part.tobytes() for part in vars(images).values() if isinstance(part, np.ndarray)]
    except InputError as error:
        said = str(error)
    return done, (parts, sum(done), said, notes.messages)


@pytest.mark.parametrize("odd", ODD)
def test_threads_give_and_tell_the_same(
    odd: str, traverse: Traverse, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    paths = list(traverse.paths * 6)
    if odd != "nothing":
        for place, name, data in ((-20, "odd", ODD[odd]), (-9, "dim", DIM), (-8, "broken", b"no image")):
            paths[place] = str(written(tmp_path / name, data))
    source = Traverse("list", np.arange(len(paths)), tuple(paths))
    for module, name, value in ((encoding, "LARGE", 1), (encoding, "SHARE", 1), (imagefiles, "SIDE_PIXELS", 4800)):
        monkeypatch.setattr(module, name, value)
    monkeypatch.setenv("LAVA_VPR_MAX_IMAGE_PIXELS", "50000")
    caplog.set_level("INFO", "lava_vpr")
    (_, plain), well = told(source, 1, caplog), list[bool]()
    monkeypatch.setattr(encoding, "side_by_side", lambda *work: well.append(side_by_side(*work)) or well[-1])
    for threads in (2, 4):
        steps, same = told(source, threads, caplog)
        assert same == plain
        assert max(steps) == threads  # no more images are in memory
    assert well.count(False) == (0 if odd == "nothing" else 2)  # the rest is read one after the other
    assert well.count(True) >= 3


@pytest.mark.usefixtures("ctrl_c")
def test_threads_end_when_the_program_is_stopped() -> None:
    read: list[int] = []

    def work(number: int) -> None:
        read.append(number)
        if number == 1:
            os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.001)

    with pytest.raises(KeyboardInterrupt):
        side_by_side(work, range(100_000), 2)
    assert len(read) < 50_000


def test_what_was_not_kept_is_refused_to_who_needs_it() -> None:
    model, queries, truth = small_model(), plain(encoded()), np.eye(8, dtype=bool)
    with pytest.raises(InputError, match=r"^SAD: needs the images' patches.*Keep\.PATCHES$"):
        recognise(model, queries, truth)
    result = recognise(model, queries, truth, Comparison(rivals=("cosine",)))
    with pytest.raises(InputError, match=r"^the report: needs the images' thumbnails.*Keep\.THUMBNAILS$"):
        report_data(model, queries, result, "", 1, None)
    with pytest.raises(InputError, match=r"^training: needs the images' patches"):
        train([queries], small_config())
