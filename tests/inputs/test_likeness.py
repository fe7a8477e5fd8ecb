"""What an image has in common with all references: turned inputs, missing edges, and causes that a run agrees on."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lava_vpr.encoding import encode_arrays
from lava_vpr.inputs.doubts import BLANK, BORDER, MIRRORED, RUN, UPSIDE_DOWN, Doubts, Sign
from lava_vpr.inputs.encoder import EncoderConfig
from lava_vpr.inputs.likeness import Likeness, turns
from lava_vpr.synthetic.world import World, render

PLACES = 48
CONFIG = EncoderConfig()
Image = NDArray[np.uint8]
TURNED: dict[str, Callable[[Image], Image]] = {
    "mirrored": lambda image: image[:, ::-1],
    "upside down": lambda image: image[::-1, ::-1],
    "both": lambda image: image[::-1],
}
CHANGES: dict[str, tuple[str | None, Callable[[Image], Image]]] = {
    "nothing": (None, lambda image: image),
    "painted": (BORDER, lambda image: bordered(image, painted=True)),
    "squeezed": (BORDER, lambda image: bordered(image, painted=False)),
    "mirrored": (MIRRORED, TURNED["mirrored"]),
    "upside down": (UPSIDE_DOWN, TURNED["upside down"]),
    "black": (BLANK, np.zeros_like),
}


def bordered(image: Image, *, painted: bool) -> Image:
    """An image with a black fifth at its top, over it or beside it."""
    drawn, top = image.copy(), len(image) // 5
    if not painted:
        drawn[top:] = cv2.resize(image, (image.shape[1], len(image) - top), interpolation=cv2.INTER_AREA)
    drawn[:top] = 0
    return drawn


def activity(images: list[Image]) -> NDArray[np.float32]:
    return encode_arrays([np.ascontiguousarray(image) for image in images], CONFIG)[0].activity


def drive(season: str, changed: Callable[[Image], Image] = lambda image: image) -> NDArray[np.float32]:
    return activity([changed(render(World(0), place, season)) for place in range(PLACES)])


def likeness(of: NDArray[np.float32]) -> Likeness:
    return Likeness.of(of, CONFIG.layout.channels, CONFIG.layout.grid)


def signs(of: Likeness, shown: NDArray[np.float32]) -> list[Sign]:
    doubts = Doubts(of)
    return [doubts.sign(row) for row in shown]


@pytest.fixture(scope="module")
def map_of() -> Likeness:
    return likeness(drive("summer"))


@pytest.mark.parametrize(("number", "way"), list(enumerate(TURNED)))
def test_turned_inputs_are_those_of_the_turned_image(number: int, way: str) -> None:
    """As far as cells of an even grid and the edges of the image allow."""
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.integers(0, 256, (64, 64), np.uint8), (0, 0), 3)
    plain, turned = activity([image, TURNED[way](image)])
    back = turned[turns(CONFIG.layout.channels, CONFIG.layout.grid)[number]]
    assert np.corrcoef(plain, back)[0, 1] > 0.99
    assert np.corrcoef(plain, turned)[0, 1] < 0.5


def test_the_numbers_are_those_of_plain_loops() -> None:
    shown = drive("summer")[:7].astype(np.float64)
    found = likeness(shown.astype(np.float32))
    unit = [row / np.sqrt((row**2).sum()) for row in shown]
    total = np.sum(unit, axis=0)
    cosines = [float(one @ (total - one) / np.sqrt(((total - one) ** 2).sum())) for one in unit]
    assert found.typical == pytest.approx(np.mean(cosines), abs=1e-5)
    assert found.spread == pytest.approx(max(np.std(cosines), 0.03), abs=1e-5)
    for number, way in enumerate(turns(CONFIG.layout.channels, CONFIG.layout.grid)):
        apart = [float(a @ b - a @ b[way]) for i, a in enumerate(unit) for j, b in enumerate(unit) if i != j]
        quarters = [np.mean(part, axis=0) for part in np.array_split(unit, 4)]
        between = [float(a @ b - a @ b[way]) for i, a in enumerate(quarters) for j, b in enumerate(quarters) if i != j]
        agreed = number > 0 or np.mean(between) > 0.78 * np.mean(apart)
        assert found.asymmetry[number] == (pytest.approx(np.mean(apart), abs=1e-5) if agreed else np.inf)
        one = unit[3].astype(np.float32)
        best = [max(float(seen @ other) for other in unit) for seen in (unit[3][way], unit[3])]
        assert found.better_turned(one, number) == pytest.approx(best[0] - best[1], abs=1e-5)


@pytest.mark.parametrize("what", CHANGES)
def test_a_cause_is_named_once_a_run_agrees(what: str, map_of: Likeness) -> None:
    cause, change = CHANGES[what]
    found = signs(map_of, drive("winter", change))
    assert [sign.cause for sign in found[: RUN - 1]] == [None] * (RUN - 1)
    assert {sign.cause for sign in found[RUN + 4 :]} == {cause}
    assert all(sign.doubtful == (cause is not None) for sign in found[RUN + 4 :])
    one = [sign.unlike >= 1 for sign in found]
    assert all(one) if cause in (BORDER, BLANK) else not any(one[:1])


@pytest.mark.parametrize("what", ["painted", "squeezed", "mirrored", "upside down"])
def test_what_the_map_shares_is_no_cause(what: str) -> None:
    """A camera that always sees its own mount, or hangs upside down."""
    change = CHANGES[what][1]
    found = signs(likeness(drive("summer", change)), drive("winter", change))
    assert {(sign.cause, sign.doubtful) for sign in found} == {(None, False)}


def test_who_stands_before_one_odd_image_sees_no_run(map_of: Likeness) -> None:
    turned = drive("winter", TURNED["mirrored"])[:1]
    assert {sign.cause for sign in signs(map_of, np.repeat(turned, 60, axis=0))} == {None}


def test_edges_that_some_references_lack_are_no_border() -> None:
    """A map of two drives, of which one had something before its lens."""
    some, painted = drive("summer"), CHANGES["painted"][1]
    some[::8] = drive("summer", painted)[::8]
    assert {sign.cause for sign in signs(likeness(some), drive("winter", painted))} == {None}


def test_bars_that_are_left_out_are_no_border(map_of: Likeness) -> None:
    """An image is then as unlike as what is seen of it; one without anything is blank as ever."""
    grid, masked, plain = CONFIG.layout.grid, drive("winter"), Doubts(map_of)
    rows = masked.reshape(PLACES, -1, grid, grid)
    rows[:, :, :2] = rows[:, :, :, -1:] = 0
    framed = Doubts(map_of, framed=True)
    found = [framed.sign(row) for row in masked]
    assert {sign.cause for sign in found} == {None}
    assert {sign.cause for sign in map(plain.sign, masked)} == {None, BORDER}
    mean = map_of.mean[0].reshape(-1, grid, grid)[:, 2:, :-1]
    cosines = [
        float((row[:, 2:, :-1] * mean).sum() / np.linalg.norm(row) / np.linalg.norm(mean))
        for row in masked.reshape(PLACES, -1, grid, grid)
    ]
    wanted = [max(0.0, (map_of.typical - cosine) / map_of.spread / 5) for cosine in cosines]
    assert [sign.unlike for sign in found] == pytest.approx(wanted, abs=1e-3)
    assert {framed.sign(0 * masked[0]).cause for _ in range(RUN + 1)} == {None, BLANK}
