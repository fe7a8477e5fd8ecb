"""A training looks at what it is given before it learns: images, sizes and costs; and which images become places."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, strategies as st
from support.common.commands import fails
from support.common.imagefiles import QUICK, blocky_picture, refused
from support.common.small_models import encoded, small_config, small_model, tiny_paper

from lava_vpr import model
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.encoding import encode_traverse
from lava_vpr.errors import ConfigError, InputError
from lava_vpr.images.sampling import changed, spaced
from lava_vpr.positions.frames import LAT_LON, XY, Positions
from lava_vpr.recognition import count_query_spikes
from lava_vpr.storage.limits import variable
from lava_vpr.training.loop import check_size, train
from lava_vpr.training.preparing import choose_places, nearest
from lava_vpr.training.stretches import Progress
from lava_vpr.traverse import Traverse, open_traverse


def never(state: Progress) -> None:
    raise AssertionError("something was learned")


def nan() -> np.ndarray:
    activity = encoded().activity.copy()
    activity[3, 5] = np.nan
    return activity


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"activity": np.ones((8, 784), np.float32)}, "have 784 inputs, the model 1568"),
    ({"activity": np.ones((8, 2000), np.float32)}, "have 2000 inputs, the model 1568"),
    ({"activity": np.ones((7, 1568), np.float32)}, "activity of type float32 and shape"),
    ({"activity": np.ones(1568, np.float32)}, "activity of type float32 and shape"),
    ({"activity": np.ones((8, 1568))}, "activity of type float64"),
    ({"activity": nan()}, "activity that is not in 0"),
    ({"activity": -encoded().activity}, "activity that is not in 0"),
    ({"activity": np.full((8, 1568), np.inf, np.float32)}, "activity that is not in 0"),
    ({"indices": np.arange(7)}, "indices of type int64 and shape"),
    ({"indices": np.arange(8.0)}, "indices of type float64"),
    ({"indices": np.arange(8) - 1}, "indices below 0"),
    ({"patches": np.zeros((8, 28, 27), np.uint8)}, "patches of type uint8 and shape"),
    ({"thumbnails": np.zeros((7, 48, 64, 3), np.uint8)}, "thumbnails of type uint8 and shape"),
]


@pytest.mark.parametrize(("change", "cause"), WRONG)
def test_images_that_were_not_encoded_so_are_refused(change: dict[str, Any], cause: str) -> None:
    for references in ([replace(encoded(), **change)], [encoded(), replace(encoded(), **change)]):
        with pytest.raises(InputError, match=cause) as caught:
            train(references, small_config(), progress=never)
        assert str(caught.value).startswith(f"references of traverse {len(references)} have ")
    with pytest.raises(InputError, match=f"^queries have .*{cause.removeprefix('have ')}"):
        count_query_spikes(small_model(), replace(encoded(), **change))


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"indices": np.array([0, 1, 2, 3, 4, 5, 6, 6])}, "two references have the same index"),
        ({"names": ("a\0b", *"bcdefgh")}, r"the name 'a\\x00b' of place 0; rename"),
        ({"names": ("\ud800", *"bcdefgh")}, "of place 0; rename"),
    ],
)
def test_references_that_no_model_can_keep_are_refused(change: dict[str, Any], cause: str) -> None:
    with pytest.raises(InputError, match=cause):
        train([replace(encoded(), **change)], small_config(), progress=never)


def test_grey_levels_are_grey_levels() -> None:
    bright = replace(encoded(inputs=784), activity=np.full((8, 784), 256, np.float32))
    with pytest.raises(InputError, match=r"activity that is not in 0\.\.255"):
        train([bright], tiny_paper(), progress=never)


def test_the_route_reaches_as_far_as_its_places() -> None:
    assert small_model().route_images == 13  # places 5 to 12
    for wrong in (12, 30.0, 2**60):
        with pytest.raises(InputError, match=f"route_images is {wrong}, but there is a place 12"):
            train([encoded()], small_config(), route_images=wrong, progress=never)


COSTLY: list[tuple[Config, int, str]] = [
    (small_config(), 30_000, "a model of 30,000 places and 30,000 neurons takes .* set LAVA_VPR_MAX_MODEL_BYTES"),
    (
        small_config(network={"steps": 65_536}, encoder={"query_spikes": 1000.0}),
        2_000,
        "a query takes .* operations, .* set LAVA_VPR_MAX_PRESENTATION_OPERATIONS, or lower network.steps",
    ),
    (
        small_config(learning={"steps": 100_000, "epochs": 10_000}),
        20_000,
        "training takes .* set LAVA_VPR_MAX_TRAINING_OPERATIONS, or lower learning.epochs or learning.steps",
    ),
    (
        update(tiny_paper(), {"network": {"delay_max_ms": 100.0, "dt_ms": 0.01, "neurons": 20_000}}),
        8,
        "a query takes .* bytes, .* set LAVA_VPR_MAX_PRESENTATION_BYTES",
    ),
    (
        update(tiny_paper(), {"network": {"steps": 20_000, "neurons": 400}, "encoder": {"max_rate_hz": 1000.0}}),
        8,
        "a training presentation takes .* bytes, .* set LAVA_VPR_MAX_PRESENTATION_BYTES",
    ),
]


@pytest.mark.parametrize(("config", "places", "cause"), COSTLY)
def test_what_costs_too_much_is_refused_before_it_is_learned(config: Config, places: int, cause: str) -> None:
    with pytest.raises(ConfigError, match=cause):
        check_size(places, config)


def test_no_number_of_places_is_too_many_but_for_what_it_costs() -> None:
    for name in ("loihi", "fast"):
        assert sum(part.places for part in check_size(16_384, preset(name))) == 16_384


def test_presentations_that_are_all_silence_are_refused() -> None:
    assert check_size(1024, small_config(network={"steps": 4}))
    with pytest.raises(ConfigError, match=r"network\.steps is 4, but 1,025 neurons need 4 silent ones; raise it"):
        check_size(1025, small_config(network={"steps": 4}))
    assert check_size(1025, small_config(network={"steps": 4, "input_mode": "bias"}))


def test_what_may_be_learned_can_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The size that is seen before training is at least that of the file."""
    model.save(small_model(), tmp_path / "a.lvpr")
    monkeypatch.setenv(variable("model_bytes"), "10000")
    with pytest.raises(ConfigError) as caught:
        check_size(8, small_config())
    words = str(caught.value).replace(",", "").split()
    monkeypatch.setenv(variable("model_bytes"), words[words.index("takes") + 1])
    check_size(8, small_config())
    assert model.load(tmp_path / "a.lvpr").places == 8


def test_the_command_says_so(here: Path) -> None:
    (here / "c.toml").write_text("[network]\nsteps = 65536\nneurons = 100000\n")
    assert fails("train", "reference", "-o", "o.lvpr", "--config", "c.toml").startswith("a query takes ")


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
