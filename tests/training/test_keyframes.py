"""Which images become places."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.common.imagefiles import QUICK, blocky_picture, refused
from support.common.small_models import small_config

from lava_vpr.config import preset
from lava_vpr.encoding import encode_traverse
from lava_vpr.images.sampling import changed, spaced
from lava_vpr.positions.frames import LAT_LON, XY, Positions
from lava_vpr.training.preparing import choose_places, nearest
from lava_vpr.traverse import Traverse, open_traverse

ENCODER = small_config().encoder


@QUICK
@given(st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=1, max_size=40), st.floats(0.1, 60))
def test_places_are_spaced(points: list[tuple[float, float]], spacing: float) -> None:
    array = np.array(points)
    kept = spaced(array, spacing).tolist()
    assert kept[0] == 0
    for last, end in zip(kept, [*kept[1:], len(points)], strict=True):
        away = np.hypot(*(array[last:end] - array[last]).T)
        assert (away < spacing).all()
        assert end == len(points) or np.hypot(*(array[end] - array[last])) >= spacing


def test_a_red_light_is_one_place() -> None:
    rng = np.random.default_rng(0)
    drive = np.concatenate([np.arange(0, 100, 5.0), np.full(200, 100.0), np.arange(105, 200, 5.0)])
    points = np.stack([drive, np.zeros_like(drive)], axis=1) + rng.uniform(-1.5, 1.5, (len(drive), 2))
    kept = spaced(points, 20.0)
    waiting = (drive[kept] == 100).sum()
    assert waiting <= 1
    assert 7 <= len(kept) <= 10


def test_change_is_measured_from_the_place_before() -> None:
    angles = np.radians([0, 5, 10, 15, 20, 25, 30, 60, 61, 90])
    activities = np.stack([np.cos(angles), np.sin(angles)], axis=1).astype(np.float32)
    assert changed(activities, 1 - np.cos(np.radians(19))).tolist() == [0, 4, 7, 9]
    brighter = activities * np.linspace(1, 50, len(angles), dtype=np.float32)[:, None]
    assert changed(brighter, 1 - np.cos(np.radians(19))).tolist() == [0, 4, 7, 9]  # proportions count, not strength
    assert changed(activities, 0.0).tolist() == list(range(10))


def test_blank_images_change_nothing_but_what_is_not_blank() -> None:
    blank, seen = np.zeros(3, np.float32), np.ones(3, np.float32)
    assert changed([blank, blank, seen, seen, blank, blank], 0.5).tolist() == [0, 2, 4]


def made(folder: Path, pictures: list[int], positions: Positions | None = None) -> Traverse:
    folder.mkdir()
    for k, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"{k:02d}.png"), blocky_picture(picture))
    paths = tuple(str(path) for path in sorted(folder.iterdir()))
    return Traverse(str(folder), np.arange(len(paths)), paths, positions=positions)


def along(*metres: float) -> Positions:
    return Positions(np.array([(x, 0.0) for x in metres]), XY)


def test_unchanging_images_are_one_place(tmp_path: Path) -> None:
    drive = made(tmp_path / "a", [1, 1, 1, 2, 2, 3, 1])
    read: list[int] = []
    (places,) = choose_places([drive], ENCODER, change=0.05, progress=read.append)
    assert places.indices.tolist() == [0, 3, 5, 6]
    assert read == [1] * 7
    activity = encode_traverse(drive, ENCODER).activity.astype(np.float64)
    unit = activity / np.linalg.norm(activity, axis=1)[:, None]
    assert 1 - unit[0] @ unit[3] > 0.05  # as it is defined


def test_other_traverses_keep_to_the_places_of_the_first(tmp_path: Path) -> None:
    first = made(tmp_path / "a", [1] * 5, along(0, 10, 20, 30, 40))
    slow = made(tmp_path / "b", [1] * 9, along(*range(-1, 44, 5)))
    blind = made(tmp_path / "c", [1] * 5)
    places, by_position, by_number = choose_places([first, slow, blind], ENCODER, spacing=20)
    assert places.indices.tolist() == by_number.indices.tolist() == [0, 2, 4]
    assert by_position.indices.tolist() == [0, 4, 8]
    whole = choose_places([first, slow], ENCODER)
    assert [len(traverse) for traverse in whole] == [5, 5]  # lengths differ: by position, too
    assert whole[1].indices.tolist() == [0, 2, 4, 6, 8]
    same = made(tmp_path / "d", [1] * 5, along(40, 30, 20, 10, 0))
    assert choose_places([first, same], ENCODER)[1] is same  # equally many: image i shows place i


def test_what_cannot_be_thinned_is_refused(tmp_path: Path) -> None:
    first, blind = made(tmp_path / "a", [1] * 3, along(0, 10, 20)), made(tmp_path / "b", [1] * 2)
    refused(lambda: choose_places([blind], ENCODER, spacing=5), "b: --spacing needs positions of its images; give --po")
    refused(lambda: choose_places([first], ENCODER, spacing=50), "a: with this --spacing all 3 images are one place")
    refused(lambda: choose_places([first], ENCODER, change=0.5), "a: with this --keyframes all 3 images are one place")
    refused(
        lambda: choose_places([first, blind], ENCODER, spacing=5), "b: has 2 images,", "nothing tells which of them"
    )
    far = made(tmp_path / "c", [1] * 4, along(300, 400, 500, 600))
    refused(lambda: choose_places([first, far], ENCODER), "c: no image was taken within 25 m of", "choose the part")
    globe = made(tmp_path / "d", [1] * 4, Positions(np.zeros((4, 2)), LAT_LON))
    refused(lambda: choose_places([first, globe], ENCODER), "d: positions in x,y and in lat,lon cannot be compared")


def test_the_nearest_image_is_found_in_any_frame() -> None:
    places = Positions(np.array([[59.9, 10.7], [59.91, 10.7]]), LAT_LON)
    images = Positions(np.array([[59.9101, 10.7], [59.5, 10.7], [59.9, 10.7001]]), LAT_LON).to("UTM 32N")
    found, metres = nearest(places, images)
    assert found.tolist() == [2, 0]
    np.testing.assert_allclose(metres, [5.6, 11.1], atol=0.2)


@pytest.mark.parametrize("spacing", [1e-9, 10.0])
def test_without_moving_far_enough_every_image_is_a_place(tmp_path: Path, spacing: float) -> None:
    first = made(tmp_path / "a", [1] * 3, along(0, 10, 20))
    assert choose_places([first], ENCODER, spacing=spacing)[0].indices.tolist() == [0, 1, 2]


@pytest.mark.data
def test_a_real_drive_that_waits(data_root: Path, tmp_path: Path) -> None:
    """Thirty places of Nordland, at one of which a camera with noise waits for twenty images: 30 places."""
    rng = np.random.default_rng(1)
    drive = open_traverse(data_root / "data" / "nordland" / "summer", places=(0, 30))
    for k, image in enumerate(drive.images()):
        for copy in range(21 if k == 12 else 1):
            noisy = image + rng.normal(0, 3, image.shape)
            cv2.imwrite(str(tmp_path / f"{k:02d}-{copy:02d}.png"), np.clip(noisy, 0, 255).astype(np.uint8))
    (places,) = choose_places([open_traverse(tmp_path)], preset("loihi").encoder, change=0.15)
    shown = [name[:2] for name in places.names]
    assert shown == [f"{k:02d}" for k in range(30)]
