"""Views: what a shift and a scale do to an image, which views settings ask for, and encoded traverses of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.common.imagefiles import smooth_picture, write_images

from lava_vpr.config import EncoderConfig
from lava_vpr.encoding import Keep, encode_traverse, encode_views, encoded_batches
from lava_vpr.errors import ConfigError
from lava_vpr.inputs.views import STRAIGHT, View, ViewsConfig, seen_as
from lava_vpr.traverse import open_traverse


def test_settings_count_views_the_straight_one_first() -> None:
    assert ViewsConfig().views == (STRAIGHT,)
    assert ViewsConfig(shifts=3, shift=0.1).views == (STRAIGHT, View(-0.1), View(0.1))
    many = ViewsConfig(shifts=5, shift=0.05, scales=3, scale=1.2).views
    assert len(many) == len(set(many)) == 15
    assert many[0] == STRAIGHT
    assert {view.scale for view in many} == {1 / 1.2, 1.0, 1.2}
    assert {round(view.shift, 9) for view in many} == {-0.1, -0.05, 0.0, 0.05, 0.1}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"shifts": 2}, "views.shifts is 2, but must be odd"),
        ({"scales": 0}, "views.scales is 0"),
        ({"shift": 0.6}, "views.shift is 0.6"),
        ({"shifts": 9, "shift": 0.3}, "so small that views show the image"),
        ({"scale": 0.5}, "views.scale is 0.5"),
    ],
)
def test_settings_that_make_no_views_are_refused(changes: dict[str, float], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        ViewsConfig(**changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("shape", [(20, 40), (20, 40, 3)])
@pytest.mark.parametrize("columns", [-8, -4, 4, 8])
def test_a_shift_moves_columns_and_repeats_the_edge(shape: tuple[int, ...], columns: int) -> None:
    image = smooth_picture(1, shape)
    seen = seen_as(image, View(columns / 40))
    expected = image[:, np.clip(np.arange(40) - columns, 0, 39)]
    assert seen.dtype == np.uint8
    assert np.array_equal(seen, expected)


def test_a_scale_brings_the_middle_nearer() -> None:
    image = np.zeros((40, 40), np.uint8)
    image[15:25, 15:25] = 200
    near, far = seen_as(image, View(scale=2.0)), seen_as(image, View(scale=0.5))
    assert abs(int((near > 100).sum()) - 400) < 60
    assert abs(int((far > 100).sum()) - 25) < 12
    assert np.array_equal(seen_as(image, STRAIGHT), image)


def test_a_traverse_is_encoded_in_every_view_as_its_shifted_images_are(tmp_path: Path) -> None:
    traverse, encoder = open_traverse(write_images(tmp_path, 5)), EncoderConfig()
    views = ViewsConfig(shifts=3).views
    encoded = encode_views(traverse, encoder, views, Keep.ALL)
    assert len(encoded) == 3
    straight = encode_traverse(traverse, encoder, Keep.ALL)
    assert np.array_equal(encoded[0].activity, straight.activity)
    assert np.array_equal(encoded[0].kept(Keep.PATCHES, "a test"), straight.kept(Keep.PATCHES, "a test"))
    assert all((other.activity != straight.activity).any(axis=1).all() for other in encoded[1:])
    batches = list(encoded_batches(traverse, encoder, views, 2))
    assert [len(batch[0]) for batch in batches] == [2, 2, 1]
    for k in range(3):
        assert np.array_equal(np.concatenate([batch[k].activity for batch in batches]), encoded[k].activity)
        assert sum((batch[k].names for batch in batches), ()) == traverse.names
