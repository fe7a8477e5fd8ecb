"""Bars at the edges of images: found, cropped or masked, steady; images without any are left alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.commands import fails, matches, run

from lava_vpr import Localizer, train
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.encoding import encode_arrays, image_traverse
from lava_vpr.framing import HELD, OfQueries, of_references
from lava_vpr.images.borders import Border, border_of
from lava_vpr.model import Model
from lava_vpr.synthetic.world import CONDITIONS, World, render

Image = NDArray[np.uint8]
PLACES = 24
WHOLE = World(0, width=160, height=80)


def squeezed(image: Image, bars: Border, level: int = 0) -> Image:
    """An image squeezed between bars."""
    between = bars.inside(image).shape[1::-1]
    small = cv2.resize(image, between, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.copyMakeBorder(small, *bars, cv2.BORDER_CONSTANT, value=[level] * 3), np.uint8)


def painted(image: Image, bars: Border, level: int = 0) -> Image:
    """Bars painted over an image."""
    inside = bars.inside(image)
    return np.asarray(cv2.copyMakeBorder(inside, *bars, cv2.BORDER_CONSTANT, value=[level] * 3), np.uint8)


@pytest.fixture(scope="module")
def summer() -> list[Image]:
    return [render(WHOLE, place, "summer") for place in range(PLACES)]


@pytest.fixture(scope="module")
def winter() -> list[Image]:
    return [render(WHOLE, place, "winter") for place in range(PLACES)]


@pytest.fixture(scope="module")
def route(summer: list[Image]) -> Model:
    return train(summer, config=update(preset("loihi"), {"learning": {"rule": "template", "epochs": 1}}))


def framing(route: Model) -> OfQueries:
    return OfQueries(route.activity, route.config.encoder)


BARS = {"letter": Border(10, 10), "wide": Border(16, 16), "top": Border(top=16), "sides": Border(left=20, right=20)}


@pytest.mark.parametrize("bars", BARS)
@pytest.mark.parametrize("made", [painted, squeezed])
@pytest.mark.parametrize(("level", "noise"), [(0, 0.0), (0, 6.0), (128, 4.0), (255, 0.0)])
def test_bars_are_found(
    bars: str, made: Callable[[Image, Border, int], Image], level: int, noise: float, summer: list[Image]
) -> None:
    rng = np.random.default_rng(0)
    for image in summer[::6]:
        drawn = made(image, BARS[bars], level) + rng.normal(0, noise, image.shape)
        found = border_of(np.clip(np.rint(drawn), 0, 255).astype(np.uint8))
        assert found.near(BARS[bars], image, 1.01 / 80), found


def unlike_bars() -> dict[str, Image]:
    """Images whose edges could be taken for bars."""
    rng, sky = np.random.default_rng(0), np.full((80, 160), 250, np.uint8)
    trees = sky.copy()
    for x, top in enumerate(rng.integers(20, 40, 160).tolist()):
        trees[top:, x] = 40
    fades = np.repeat(np.minimum(np.arange(80) * 3, 255).astype(np.uint8)[:, None], 160, axis=1)
    lamp = np.zeros((80, 160), np.uint8)
    lamp[30:34, 70:80] = 255
    return {"sky above trees": trees, "blank": sky, "black": 0 * sky, "a slope": fades, "a lamp at night": lamp}


@pytest.mark.parametrize("name", unlike_bars())
def test_what_only_resembles_bars_is_none(name: str) -> None:
    assert border_of(unlike_bars()[name]) == Border()


@pytest.mark.parametrize("season", CONDITIONS)
@pytest.mark.parametrize("light", [1.0, 0.3, 0.05])
def test_images_without_bars_are_left_alone(season: str, light: float, route: Model) -> None:
    images = [np.rint(render(WHOLE, place, season) * light).astype(np.uint8) for place in range(PLACES)]
    frame = framing(route)
    assert all(frame(image)[0] is image for image in images)
    plain, framed = (encode_arrays(images, route.config.encoder, framing=of)[0] for of in (None, framing(route)))
    assert framed.activity.tobytes() == plain.activity.tobytes()


@pytest.mark.parametrize("bars", ["letter", "wide"])
def test_queries_are_cropped_where_squeezed_and_masked_where_painted(
    bars: str, winter: list[Image], route: Model
) -> None:
    layout = route.config.encoder.layout
    plain = encode_arrays(winter, route.config.encoder)[0].activity
    for made in (squeezed, painted):
        images = [made(image, BARS[bars]) for image in winter]
        (seen,) = encode_arrays(images, route.config.encoder, framing=framing(route))
        rows = seen.activity.reshape(PLACES, layout.channels, layout.grid, layout.grid)
        silent = not rows[:, :, 0].any() and not rows[:, :, -1].any()
        assert silent is (made is painted)
        cosines = np.sum(seen.activity * plain, axis=1) / np.linalg.norm(seen.activity, axis=1)
        assert np.mean(cosines / np.linalg.norm(plain, axis=1)) > 0.75


@pytest.mark.parametrize("made", [squeezed, painted])
def test_a_robot_with_bars_is_where_it_is_without(
    made: Callable[[Image, Border], Image], winter: list[Image], route: Model
) -> None:
    images, places = [made(image, BARS["wide"]) for image in winter], np.arange(PLACES)

    def right(crop: str) -> int:
        robot = Localizer(route, "none", crop=crop)
        return int((np.array([robot.update(image).place for image in images]) == places).sum())

    assert right("auto") >= PLACES - 1 > right("none")


def test_a_single_image_moves_no_bars(winter: list[Image], route: Model) -> None:
    images, frame = [painted(image, BARS["wide"]) for image in winter], framing(route)
    before = [frame(image)[1] for image in images[:5]]
    for odd in (np.zeros_like(images[0]), winter[5], painted(winter[5], Border(30, 4))):
        heard = frame(odd)[1]
        assert heard is not None
        np.testing.assert_array_equal(heard, before[-1])
        again = [frame(image)[1] for image in images[6:16]]
        assert all(np.array_equal(one, before[-1]) for one in again)


def test_bars_that_come_and_go_are_followed(winter: list[Image], route: Model) -> None:
    frame = framing(route)
    drive = [*winter[:12], *(squeezed(image, BARS["letter"]) for image in winter), *winter[:12]]
    same = [frame(image)[0] is image for image in drive]
    assert same == [True] * 16 + [False] * 24 + [True] * 8  # four more until most of nine say so
    assert frame(np.zeros((40, 80), np.uint8))[0].shape == (40, 80)


def test_how_bars_are_left_out_is_settled(winter: list[Image], route: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    frame, asked = framing(route), list[int]()
    fit = frame._fit
    monkeypatch.setattr(frame, "_fit", lambda *way: asked.append(1) or fit(*way))
    for image in [*winter, *winter]:
        frame(squeezed(image, BARS["letter"]))
    assert len(asked) == 2 * HELD


def test_references_with_bars_are_cropped_or_masked(summer: list[Image], winter: list[Image]) -> None:
    encoder = preset("loihi").encoder
    told = list[str]()
    for bars, how in (("letter", "cropped"), ("top", "masked")):
        images = [squeezed(image, BARS[bars]) for image in summer]
        frame = of_references(image_traverse(images), encoder, "auto", told.append)
        assert frame is not None
        assert f"top {BARS[bars].top}" in told[-1]
        assert how in told[-1]
        image, heard = frame(images[0])
        assert (heard is None) is (how == "cropped")
        assert image.shape[0] == 80 - (20 if heard is None else 0)
    assert of_references(image_traverse(summer), encoder, "auto", told.append) is None
    assert len(told) == 2


def test_a_map_with_the_same_bars_is_asked_alike(summer: list[Image], winter: list[Image], route: Model) -> None:
    own = {"config": route.config}
    for bars in ("letter", "top"):
        learned = train([painted(image, BARS[bars]) for image in summer], crop="auto", **own)
        robot = Localizer(learned, "none", crop="auto")
        found = [robot.update(painted(image, BARS[bars])).place for image in winter]
        assert np.mean(np.array(found) == np.arange(PLACES)) > 0.7
    plain = train([painted(image, BARS["wide"]) for image in summer], **own)  # bars learned as they are
    frame, seen = framing(plain), painted(winter[0], BARS["wide"])
    assert frame(seen)[0] is seen


def test_places_are_added_as_they_are_learned(summer: list[Image], route: Model, tmp_path: Path) -> None:
    images = [squeezed(image, BARS["letter"]) for image in summer]
    for number, image in enumerate(images[12:]):
        cv2.imwrite(str(tmp_path / f"{number:02d}.png"), image)
    robots = [Localizer(train(images[:12], config=route.config, crop="auto"), crop="auto") for _ in range(2)]
    robots[0].add(images[12:])
    robots[1].add(tmp_path)
    whole = train(images, config=route.config, crop="auto", parts=[12, 12])
    for robot in robots:
        np.testing.assert_array_equal(robot.model.activity, whole.activity)


def test_commands_crop(
    summer: list[Image], winter: list[Image], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, images in (
        ("summer", [squeezed(image, BARS["letter"]) for image in summer]),
        ("winter", winter),
        ("bars", [painted(image, BARS["letter"]) for image in winter]),
    ):
        Path(name).mkdir()
        for number, image in enumerate(images):
            cv2.imwrite(f"{name}/{number:02d}.png", image)
    how = ("--crop", "auto", "--learning", "template")
    told = run("train", "summer", "-o", "m.lvpr", *how).stderr
    assert (
        told == "note: summer: bars at the edges (top 10, bottom 10 pixels) are cropped, as those of squeezed images\n"
    )
    run("train", "summer", "-o", "part.lvpr", *how, "--places", "0:12")
    run("extend", "part.lvpr", "summer", "--places", "12:24", "--crop", "auto")
    for model in ("m.lvpr", "part.lvpr"):
        Path(model).rename("m.lvpr")
        assert matches("winter", "--crop", "auto") == matches("winter")
        rows = matches("bars", "--crop", "auto", "--motion", "any")
        assert sum(row["place"] == row["query"] for row in rows) >= PLACES - 2
    wrong = fails("query", "m.lvpr", "bars", "--crop", "some", code=2)
    assert "'some' is not one of 'none', 'auto'" in wrong


def test_what_has_no_edges_is_refused(tmp_path: Path) -> None:
    vectors = np.random.default_rng(0).normal(size=(8, 16))
    np.save(tmp_path / "v.npy", vectors)
    words = ("train", tmp_path / "v.npy", "-o", tmp_path / "m.lvpr")
    said = "--crop auto is for images, but inputs 'vector' have no edges; leave it out"
    assert fails(*words, "--crop", "auto") == said
    run(*words)
    for command in ("query", "eval", "watch"):
        assert fails(command, tmp_path / "m.lvpr", tmp_path / "v.npy", "--crop", "auto") == said
