"""The report's drawings and words: strokes along edges, pooled and scaled scores, images, numbers."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from lava_vpr.inputs.orientation import orientation_channels
from lava_vpr.report.images import CELL, contact_sheet, edge_direction, representatives, shrunk, strokes, weight_image
from lava_vpr.report.plots import pooled, scaled
from lava_vpr.report.sections import number
from lava_vpr.show.numbers import counted, fraction
from lava_vpr.show.templates import safe


@pytest.mark.parametrize("degrees", [0, 30, 45, 75, 90, 120, 135, 170])
@pytest.mark.parametrize("orientations", [4, 6])
def test_strokes_run_along_the_edges_that_the_channels_respond_to(degrees: int, orientations: int) -> None:
    # An edge along the direction (cos, sin), y down: bright on one side of the line, dark on the other.
    along = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    y, x = np.mgrid[:168, :168] - 83.5
    image = (127.5 + 100 * np.tanh((x * along[1] - y * along[0]) / 3)).astype(np.uint8)
    channels = orientation_channels(image, orientations=orientations).reshape(orientations, -1).sum(axis=1)
    drawn = np.array(edge_direction(int(channels.argmax()), orientations))
    assert math.isclose(float(np.hypot(*drawn)), 1)
    assert abs(float(drawn @ along)) >= math.cos(math.pi / 2 / orientations + 0.05)


def test_a_stroke_lies_in_its_cell() -> None:
    weights = np.zeros((4, 5, 5))
    weights[2, 1, 3] = 6.0  # a vertical gradient, so a horizontal edge, in the second row and the fourth column
    paths = re.findall(r'd="M(\d+) (\d+)l(-?\d+) (-?\d+)"', strokes(weights.reshape(-1), 4, 5))
    assert len(paths) == 1
    x, y, dx, dy = (int(v) for v in paths[0])
    assert (x + dx / 2, y + dy / 2) == (3.5 * CELL, 1.5 * CELL)
    assert dy == 0
    assert 0.9 * CELL < abs(dx) < 1.2 * CELL
    assert "<path" not in strokes(np.zeros(100), 4, 5)


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.integers(1, 23), st.integers(1, 23), st.integers(1, 9))
def test_pooling_takes_the_best_of_each_block(rows: int, columns: int, largest: int) -> None:
    scores = np.random.default_rng(rows * 31 + columns).normal(size=(rows, columns))
    scores[0, 0] = np.nan
    small, height, width = pooled(scores, largest)
    assert max(small.shape) <= largest
    for i, line in enumerate(small):
        for j, value in enumerate(line):
            block = scores[i * height : (i + 1) * height, j * width : (j + 1) * width]
            known = block[np.isfinite(block)]
            assert value == known.max() if len(known) else np.isnan(value)


def test_scaling_shows_each_querys_best() -> None:
    values = np.array([[1.0, 2.0, 3.0], [10.0, 30.0, 20.0], [5.0, 5.0, 5.0], [np.nan, 1.5, 2.0]])
    each = scaled(values, per_query=True)
    np.testing.assert_allclose(each, [[0, 0.5, 1], [0, 1, 0.5], [0, 0, 0], [np.nan, 0, 1]])
    whole = scaled(values, per_query=False)
    assert whole[1, 1] == 1
    assert np.nanmin(whole) == 0
    assert not scaled(np.full((2, 2), np.nan), per_query=False).any()


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.lists(st.integers(-1, 30), max_size=40), st.integers(1, 24))
def test_representatives_are_different_places_in_route_order(neuron_places: list[int], limit: int) -> None:
    owners = np.array(neuron_places, dtype=np.int64)
    places = owners[representatives(owners, limit)]
    assert len(places) == min(limit, len(set(neuron_places) - {-1}))
    assert np.all(np.diff(places) > 0)
    assert np.all(places >= 0)


def test_images() -> None:
    assert weight_image(np.array([0.0, 2.0, 4.0, 1.0]), 2).tolist() == [[0, 128], [255, 64]]
    assert weight_image(np.array([4.0, 0, 0, 2, 0, 4, 0, 2]), 2).tolist() == [[255, 0], [128, 128]]
    assert shrunk(np.zeros((100, 400, 3), np.uint8), 200).shape == (50, 200, 3)
    sheet = contact_sheet(np.zeros((7, 24, 40, 3), np.uint8))
    assert sheet.uri.startswith("data:image/jpeg;base64,")
    assert sheet.columns * sheet.rows >= 7
    assert re.fullmatch(r"\.a\{.*background-size:300% 300%;aspect-ratio:40/24\}", sheet.style(".a"))


def test_words() -> None:
    assert [fraction(v, 2) for v in (0.125, None, math.nan, 1)] == ["0.12", "–", "–", "1.00"]
    assert [number(v) for v in (88012, 1234.5, 3.14159, 0, math.nan)] == ["88,012", "1,234", "3.14", "0", "–"]
    assert [counted(v, "place") for v in (1, 2, 1000)] == ["1 place", "2 places", "1,000 places"]
    assert safe("<\udcff>") == "&lt;?&gt;"
