"""The drawing of a spiking front end's layers: what it shows are the spikes of the general simulator."""

from __future__ import annotations

import re

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray
from support.literal import front_end as literal

from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_settings import FRONT_END
from lava_vpr.report import layers
from lava_vpr.report.layers import Layers
from lava_vpr.show.svg import THEME
from lava_vpr.synthetic.world import World, render


def grating(degrees: float, rows: int = 32, columns: int = 64) -> NDArray[np.uint8]:
    """Waves whose gradient runs at so many degrees, in pixels that are twice as high as they are wide."""
    angle = np.radians(degrees)
    y, x = np.mgrid[:rows, :columns]
    wave = np.sin((x * np.cos(angle) + 2 * y * np.sin(angle)) * 2 * np.pi / 16)
    return np.repeat((128 + 100 * wave).astype(np.uint8)[..., None], 3, axis=2)


def images_of(figure: Figure, shape: tuple[int, ...]) -> list[NDArray[np.float64]]:
    """The images of a figure that have a shape."""
    found = [np.asarray(image.get_array()) for axes in figure.axes for image in axes.images]
    return [image for image in found if image.shape == shape]


@pytest.mark.parametrize("window", [0, 3])
def test_what_is_drawn_are_the_spikes_of_the_general_simulator(window: int) -> None:
    spec = FrontEnd(16, window=window, white=5 * window or 255)
    image = np.random.default_rng(window).integers(0, 256 if not window else 4, (40, 60, 3)).astype(np.uint8)
    found = Layers.of(spec, image, "a.png")
    films = {name: film[0] for name, film in literal.trains(spec, spec.seen(image)[None]).items()}
    assert {name: film.tolist() for name, film in found.trains.items() if name != "events"} == {
        name: film.tolist() for name, film in films.items()
    }
    figure = layers._figure(found)
    (steps,) = images_of(figure, (spec.height, spec.width))
    assert np.array_equal(films["pixels"].argmax(axis=0), steps.ravel())
    tinted = images_of(figure, (spec.grid, spec.grid, 4))
    counts = np.array([cells[..., 3] for cells in tinted[: spec.orientations]]) * spec.most
    assert np.array_equal(films["cells"].sum(axis=0), np.rint(counts).ravel())
    strokes = sum(len(patch.get_path().codes) // 2 for patch in figure.axes[3].patches)
    pairs = films["pairs"].reshape(spec.steps, -1, spec.directions)
    assert strokes == pairs.any(axis=(0, 2)).sum() > 0
    words = [text.get_text() for text in figure.axes[-1].texts]
    for name, film in films.items():
        assert words[words.index(f"{film.shape[1]:,} {name}") + 1] == f"{film.sum():,}"
    assert ("events arrive" in words) == bool(window)


@pytest.mark.parametrize("k", range(8))
def test_strokes_run_along_the_edges(k: int) -> None:
    axes = Figure().add_subplot()
    layers._edges(axes, Layers.of(FRONT_END, grating(22.5 * k), "a.png"))
    paths = [patch.get_path() for patch in axes.patches]
    strokes = [(path.vertices[1] - path.vertices[0], len(path.codes)) for path in paths]
    along, _ = max(strokes, key=lambda stroke: stroke[1])
    gradient = np.radians(22.5 * k)
    assert abs(along @ (np.cos(gradient), np.sin(gradient))) < 1e-6 * np.hypot(*along)


def test_rows_of_the_raster_are_spikes_of_their_direction() -> None:
    found = Layers.of(FRONT_END, grating(45), "a.png")
    film, directions = found.by_direction("pairs")
    assert film.sum() == found.trains["pairs"].sum()
    by_channel = film.reshape(len(film), directions, -1).sum(axis=(0, 2))
    sums = found.trains["pairs"].reshape(-1, 2, FRONT_END.orientations).sum(axis=(0, 1))
    assert by_channel.tolist() == sums.tolist()
    (band,) = images_of(layers._figure(found), (2 * 72, 4 * FRONT_END.steps, 4))[:1]
    spiking = np.flatnonzero(film.any(axis=1))
    shown = np.flatnonzero(band[..., 3].any(axis=0))
    assert sorted({*(shown // 4)}) == spiking.tolist()
    assert 3 not in shown % 4


def test_a_page_has_them_in_little_and_a_picture_is_of_paper() -> None:
    image = render(World(0), 3, "winter")
    found = Layers.of(FRONT_END, image[::8, ::8], "<a>.png", FRONT_END.seen(image))
    html = layers.section(found).html()
    assert "&lt;a&gt;.png" in html
    assert 30_000 < len(html) < 200_000
    assert len(re.findall(r"var\(--muted\)", html)) > 10
    assert layers.section(None).html() == ""
    before = dict(THEME)
    picture = layers.picture(found, 40)
    assert picture[:4] == b"\x89PNG"
    assert picture == layers.picture(found, 40)
    assert before == THEME
    assert html == layers.section(found).html()
