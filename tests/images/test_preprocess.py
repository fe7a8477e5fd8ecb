"""Preprocessing against literal, pixel-by-pixel versions."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from support.common.imagefiles import smooth_picture, write_images

from lava_vpr.config import EncoderConfig
from lava_vpr.encoding import Keep, encode_traverse, encode_views, encoded_batches
from lava_vpr.errors import ConfigError
from lava_vpr.inputs.orientation import orientation_channels
from lava_vpr.inputs.patches import averaged, hog, on_off, patch_normalised, window_z_score
from lava_vpr.inputs.views import STRAIGHT, View, ViewsConfig, seen_as
from lava_vpr.traverse import open_traverse


def picture(seed: int, height: int = 32, width: int = 64, colour: bool = True) -> NDArray[np.uint8]:
    rng = np.random.default_rng(seed)
    small = rng.integers(0, 256, (6, 9, 3) if colour else (6, 9)).astype(np.uint8)
    noise = rng.integers(0, 20, (height, width, 3) if colour else (height, width))
    return np.clip(cv2.resize(small, (width, height)) + noise, 0, 255).astype(np.uint8)


def literal_patch_normalised(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """The released code's steps, one window at a time: NaN-padded, NaN-mean and NaN-standard-deviation."""
    small = cv2.resize(image, (28, 28))
    grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY).astype(float)
    padded = np.pad(grey, 3, constant_values=np.nan)
    result = np.zeros((28, 28))
    for row in range(28):
        for column in range(28):
            window = padded[row : row + 7, column : column + 7]
            spread = np.nanstd(window)
            z = (grey[row, column] - np.nanmean(window)) / spread if spread > 0 else 0.0
            result[row, column] = 255 * (1 + min(1.0, max(-1.0, z))) / 2
    return result


@settings(max_examples=8, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.integers(8, 90), st.integers(8, 90))
def test_patch_normalisation_equals_the_literal_version(seed: int, height: int, width: int) -> None:
    image = picture(seed, height, width)
    ours, literal = patch_normalised(image).astype(float), literal_patch_normalised(image)
    # Truncation may fall either way only where the exact value is an integer and rounding noise decides.
    differs = ours != np.floor(literal)
    assert np.all(np.abs(literal[differs] - np.round(literal[differs])) < 1e-9)
    assert differs.mean() < 0.01


def test_patch_normalisation_of_a_blank_image_is_mid_grey() -> None:
    assert np.all(patch_normalised(np.full((40, 60, 3), 200, np.uint8)) == 127)


def test_window_z_score_is_exact_at_its_extremes() -> None:
    image = np.zeros((28, 28), np.uint8)
    image[10, 10] = 255
    z = window_z_score(image)
    assert z[10, 10] == pytest.approx(math.sqrt(48))
    assert z[0, 0] == 0
    assert np.isfinite(window_z_score(np.full((28, 28), 255, np.uint8))).all()


def mean_in_chunks(values: NDArray[np.float32]) -> np.float32:
    """The mean, 8,192 values at a time: later versions of NumPy cut longer arrays otherwise."""
    flat = values.ravel()
    total = sum((chunk.sum() for chunk in np.split(flat, range(8192, flat.size, 8192))), np.float32(0))
    return np.float32(np.float64(total) / flat.size)


def literal_orientation(
    image: NDArray[np.uint8], side: int, cell: int, orientations: int, window: int, blur: float
) -> NDArray[np.float32]:
    """Step by step, by OpenCV and NumPy."""
    small = cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA)
    seen = (small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)).astype(np.float32)
    seen = cv2.GaussianBlur(seen, (0, 0), blur) if blur > 0 else seen
    gx, gy = (cv2.Sobel(seen, cv2.CV_32F, across, 1 - across, ksize=1) for across in (1, 0))
    magnitude = np.sqrt(gx * gx + gy * gy)
    pool = cv2.blur(magnitude, (window, window)) + np.float32(0.3) * mean_in_chunks(magnitude) + np.float32(1e-3)
    energy = np.maximum(np.minimum(magnitude / pool, np.float32(4)) - np.float32(0.3), np.float32(0))
    angle = np.arctan2(gy.astype(np.float64), gx.astype(np.float64))
    position = np.where(angle >= 0, angle, angle + math.pi) * (orientations / math.pi)
    below = position.astype(np.int64)
    upper = energy * (position - below).astype(np.float32)
    result = np.zeros((orientations, side // cell, side // cell), np.float32)
    rows, columns = np.indices((side, side)) // cell
    np.maximum.at(result, (below % orientations, rows, columns), energy - upper)
    np.maximum.at(result, ((below + 1) % orientations, rows, columns), upper)
    return result.reshape(-1)


FUSES = cv2.checkHardwareSupport(12)
"""Whether OpenCV fuses a product and a sum here, as our kernels do everywhere: CV_CPU_FMA3."""


def assert_same(ours: NDArray[np.float32], literal: NDArray[np.float32]) -> None:
    """The same bits but for one in 5,000, where the last bit of an arctangent may reach that of a share."""
    np.testing.assert_allclose(ours, literal, atol=1e-6 if FUSES else 2e-5, rtol=0)
    assert not FUSES or np.count_nonzero(ours != literal) <= len(ours) / 5000


@pytest.mark.parametrize(
    ("side", "cell", "orientations", "window", "blur"),
    [
        (64, 4, 8, 17, 0.7),
        (56, 4, 8, 15, 0.0),
        (28, 2, 4, 7, 1.5),
        (128, 8, 6, 5, 0.5),
        (45, 5, 9, 3, 0.3),
        (25, 5, 2, 63, 0.5),
        (8, 1, 16, 255, 3.0),
        (100, 5, 8, 17, 0.05),
    ],
)
def test_orientation_channels_equal_the_literal_version(
    side: int, cell: int, orientations: int, window: int, blur: float
) -> None:
    for seed, (height, width) in enumerate([(32, 64), (270, 480), (side, side), (33, 301)]):
        image = picture(seed, height, width, colour=seed != 3)
        ours = orientation_channels(image, side, cell, orientations, window, 0.3, blur)
        assert_same(ours, literal_orientation(image, side, cell, orientations, window, blur))
        assert ours.max() > 0.5


@pytest.mark.data
@pytest.mark.parametrize("folder", ["nordland/winter", "gardens/query", "lens_example/query"])
def test_real_images_have_the_channels_of_the_literal_version(data_root: Path, folder: str) -> None:
    for _, image in zip(range(12), open_traverse(data_root / "data" / folder).images(), strict=False):
        for side in (64, 28):
            ours = orientation_channels(image, side, 4, 8, 17, 0.3, 0.7)
            assert_same(ours, literal_orientation(image, side, 4, 8, 17, 0.7))


@pytest.mark.parametrize("kind", ["noise", "halves", "slope"])
@pytest.mark.parametrize("shape", [(108, 192, 3), (41, 97), (130, 65, 3), (392, 392), (64, 48, 3), (30, 640)])
def test_images_become_smaller_as_opencv_makes_them(shape: tuple[int, ...], kind: str) -> None:
    """Halves lie between two levels: they are rounded as OpenCV's order of sums has it."""
    noise = np.random.default_rng(len(shape)).integers(0, 2 if kind == "halves" else 256, shape)
    image = (noise if kind != "slope" else np.indices(shape).sum(axis=0) % 256).astype(np.uint8)
    for size in ((64, 48), (8, 8), (28, 28)):
        np.testing.assert_array_equal(averaged(image, *size), cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def test_channels_see_the_direction_of_an_edge_and_not_its_sign() -> None:
    image = np.zeros((56, 56), np.uint8)
    image[:, 28:] = 200
    vertical = orientation_channels(image).reshape(8, 14, 14)
    assert vertical[0].max() > 1
    assert not vertical[4].any()
    assert np.allclose(vertical, orientation_channels(255 - image).reshape(8, 14, 14), atol=1e-4)
    horizontal = orientation_channels(np.ascontiguousarray(image.T)).reshape(8, 14, 14)
    assert np.allclose(horizontal[4], vertical[0].T, atol=1e-4)


def test_brightness_and_contrast_hardly_matter() -> None:
    image = picture(3, 56, 56, colour=False) // 2
    bright = np.clip(image.astype(int) + 60, 0, 255).astype(np.uint8)
    assert np.allclose(orientation_channels(image), orientation_channels(bright), atol=1e-3)
    assert np.array_equal(orientation_channels(image, blur=0.0), orientation_channels(bright, blur=0.0))


def test_a_blank_image_has_no_edges_and_grey_equals_equal_colours() -> None:
    assert not orientation_channels(np.full((64, 64, 3), 9, np.uint8)).any()
    grey = picture(1, colour=False)
    assert np.array_equal(orientation_channels(grey), orientation_channels(np.repeat(grey[:, :, None], 3, axis=2)))


def test_on_off_channels_split_the_sign() -> None:
    patches = np.array([[[0, 127], [128, 255]]], np.uint8).repeat(1, axis=0)
    channels = on_off(patches)
    assert channels.shape == (1, 8)
    assert np.allclose(channels[0, :4] - channels[0, 4:], patches.reshape(-1) - 127.5)
    assert np.all(np.minimum(channels[0, :4], channels[0, 4:]) == 0)


def test_hog_is_opencvs_with_the_settings_that_it_comes_with() -> None:
    image, its = picture(3, 64, 64), cv2.HOGDescriptor()
    own = cv2.HOGDescriptor((64, 64), its.blockSize, its.blockStride, its.cellSize, its.nbins)
    assert (own.L2HysThreshold, own.derivAperture) == (its.L2HysThreshold, its.derivAperture)
    expected = own.compute(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)).ravel()
    np.testing.assert_array_equal(hog(image), np.rint(255 * expected))


def test_hog_of_edges() -> None:
    """Nothing without contrast; the bins of an edge's direction alone, however strong its contrast."""
    assert not hog(np.full((30, 40, 3), 90, np.uint8)).any()
    step = np.zeros((64, 64), np.uint8)
    step[:, 32:] = 200
    across, down = hog(step).reshape(-1, 9), hog(np.ascontiguousarray(step.T)).reshape(-1, 9)
    assert across.shape == (196, 9)
    assert set(np.flatnonzero(across.any(axis=0))) == {0, 8}  # gradients at 0 degrees lie between two bins
    assert set(np.flatnonzero(down.any(axis=0))) == {4}
    np.testing.assert_allclose(hog(step // 2).astype(int), hog(step), atol=2)
    colour = np.repeat(step[:, :, None], 3, axis=2)
    np.testing.assert_array_equal(hog(colour), hog(step))


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
