"""What a `Localizer`, `train` and `load` refuse: in one line, by its name, and without a change."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import lava_vpr
from lava_vpr import Localizer, train
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.errors import ConfigError, InputError, LavaVprError
from lava_vpr.model import Model
from lava_vpr.synthetic.world import World, render

PLACES = 8
Images = list[NDArray[np.uint8]]


@pytest.fixture(scope="module")
def summer() -> Images:
    return [render(World(0), place, "summer") for place in range(PLACES)]


@pytest.fixture(scope="module")
def winter() -> Images:
    return [render(World(0), place, "winter") for place in range(PLACES)]


@pytest.fixture(scope="module")
def route(summer: Images) -> Model:
    config = update(preset("loihi"), {"learning": {"rule": "template", "epochs": 1}})
    return train(summer, config=config, positions=np.stack([np.arange(PLACES) * 5.0, np.zeros(PLACES)], axis=1))


def test_what_is_refused_changes_nothing(winter: Images, route: Model) -> None:
    """Odometry on a map without positions; and an image that is none."""
    asked, spared = (Localizer(dataclasses.replace(route, positions=None, frame=None)) for _ in range(2))
    for number, image in enumerate(winter[:6]):
        for wrong, odometry in ((winter[-1 - number], 1.0), (np.zeros((4, 4)), None)):
            with pytest.raises(InputError):
                asked.update(wrong, odometry=odometry)
        assert asked.update(image).values() == spared.update(image).values()
    assert asked._asker._adaptation is not None
    np.testing.assert_array_equal(asked._asker._adaptation.mean, spared._asker._adaptation.mean)


def test_an_image_that_is_refused_is_called_by_its_number_or_name(winter: Images, route: Model) -> None:
    robot = Localizer(route)
    robot.update(winter[0])
    for said, call in (
        ("^image 1 is of type float64", lambda: robot.update(np.zeros((4, 4)))),
        ("^left.png is of type float64", lambda: robot.update(np.zeros((4, 4)), name="left.png")),
        ("^image 3 is of type float64", lambda: robot.update(np.zeros((4, 4)))),
    ):
        with pytest.raises(InputError, match=said):
            call()


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((4, 4), np.float32), "type float32"),
        (np.zeros((4, 4, 4), np.uint8), r"shape \(4, 4, 4\)"),
        (np.zeros((0, 4), np.uint8), r"shape \(0, 4\)"),
        (np.zeros(9, np.uint8), r"shape \(9,\)"),
    ],
)
def test_what_is_no_image_is_refused(image: NDArray[np.uint8], words: str, route: Model) -> None:
    with pytest.raises(InputError, match=words):
        Localizer(route).update(image)


MADE: Any = Localizer
LEARN: Any = train
HUGE = np.broadcast_to(np.uint8(7), (2**31, 2))
"""An image larger than any memory, which costs none."""
WRONG: dict[str, Callable[[Any, Any], object]] = {
    "model is None": lambda robot, seen: MADE(None),
    "model is ''": lambda robot, seen: MADE(""),
    "path is ''": lambda robot, seen: lava_vpr.load(""),
    "motion is": lambda robot, seen: MADE(robot.model, ["any"]),
    "adapt is 'x'": lambda robot, seen: MADE(robot.model, adapt="x"),
    "adapt is 0.5": lambda robot, seen: MADE(robot.model, adapt=0.5),
    "query_views is True": lambda robot, seen: MADE(robot.model, query_views=True),
    "seed is 'x'": lambda robot, seen: MADE(robot.model, seed="x"),
    "seed is 1.5": lambda robot, seen: MADE(robot.model, seed=1.5),
    "seed is -1": lambda robot, seen: MADE(robot.model, seed=-1),
    "seed is 1180591620717411303424": lambda robot, seen: MADE(robot.model, seed=2**70),
    "odometry is 'x'": lambda robot, seen: robot.update(seen[0], odometry="x"),
    "odometry is a number of": lambda robot, seen: robot.update(seen[0], odometry=10**400),
    "stamp is 'x'": lambda robot, seen: robot.update(seen[0], stamp="x"),
    "image 0 is of type object": lambda robot, seen: robot.update(object()),
    "^image 0 has 2 x 2147483648 = ": lambda robot, seen: robot.update(HUGE),
    "images is None": lambda robot, seen: robot.add(None),
    "images is {}": lambda robot, seen: robot.add({}),
    "names is 'ab'": lambda robot, seen: robot.add(seen[:2], np.ones((2, 2)), names="ab"),
    "names is .1, 2.": lambda robot, seen: robot.add(seen[:2], np.ones((2, 2)), names=[1, 2]),
    "places are 3": lambda robot, seen: robot.remove(3),
    "places are 3, but must be absolute": lambda robot, seen: robot.remove(np.array(3)),
    "has no place 1.7": lambda robot, seen: robot.remove([1.7]),
    "has no place True": lambda robot, seen: robot.remove([True]),
    "has no place .1.": lambda robot, seen: robot.remove([[1]]),
    "has no place 'x'": lambda robot, seen: robot.remove(["x"]),
    "has no place 1180591620717411303424": lambda robot, seen: robot.remove([2**70]),
    "path is None": lambda robot, seen: robot.save(None),
    "path is 'x.x00'": lambda robot, seen: robot.save("x\0"),
    "references is .None": lambda robot, seen: LEARN(None),
    "references is .{}": lambda robot, seen: LEARN({}),
    "references is .<list_iterator": lambda robot, seen: LEARN(iter(seen)),
    "image 0 has 2 x 2147483648 = ": lambda robot, seen: LEARN([HUGE]),
    "rates is ..,": lambda robot, seen: LEARN(rates=[]),
    "rates is .1.0": lambda robot, seen: LEARN(rates=[1.0, 2.0]),
    "config is {}": lambda robot, seen: LEARN(seen, config={}),
    "preset is 3": lambda robot, seen: LEARN(seen, preset=3),
    "standard is 3": lambda robot, seen: LEARN(seen, standard=3),
    "places is .0.0, 4": lambda robot, seen: LEARN(seen, places=(0.0, 4)),
    "places is .False, 4": lambda robot, seen: LEARN(seen, places=(False, 4)),
    "parts is .2.5, ": lambda robot, seen: LEARN(seen, parts=[2.5, 2.5]),
    "section is 1.0": lambda robot, seen: LEARN("S", dataset="nordland", section=1.0),
    "threads is 1.5": lambda robot, seen: LEARN(seen, threads=1.5),
    "threads is -1": lambda robot, seen: LEARN(seen, threads=-1),
    "every is 'x'": lambda robot, seen: LEARN("S", every="x"),
    "gap is None": lambda robot, seen: LEARN(seen, gap=None),
    "spacing is True": lambda robot, seen: LEARN(seen, spacing=True),
    "keyframes is 'x'": lambda robot, seen: LEARN(seen, keyframes="x"),
    "stamps is None": lambda robot, seen: LEARN(seen, stamps=None),
    "cluster is 7": lambda robot, seen: LEARN(seen, cluster=7),
    "checkpoint is 7": lambda robot, seen: LEARN(seen, checkpoint=7),
    "resume is 1": lambda robot, seen: LEARN(seen, resume=1),
    "seed is 1.5, but": lambda robot, seen: LEARN(seen, seed=1.5),
    "epochs is True": lambda robot, seen: LEARN(seen, epochs=True),
}


@pytest.mark.parametrize("said", WRONG)
def test_what_is_of_a_wrong_kind_is_refused_by_its_name(said: str, summer: Images, route: Model) -> None:
    robot = Localizer(route)
    with pytest.raises(LavaVprError, match=said) as told:
        WRONG[said](robot, summer[:4])
    assert "\n" not in str(told.value)
    assert robot.model.places == PLACES


def test_what_cannot_be_asked_is_refused(winter: Images, summer: Images, route: Model, tmp_path: Path) -> None:
    robot = Localizer(train(summer[:8], config=route.config))
    robot.update(winter[0])
    wrong: list[tuple[type[LavaVprError], str, Callable[[], object]]] = [
        (ConfigError, "no motion 'sideways'", lambda: Localizer(route, "sideways")),
        (ConfigError, "a precision of 1 ", lambda: Localizer(route, target_precision=1.0)),
        (ConfigError, "1 is no share", lambda: Localizer(route, off_map=1.0)),
        (ConfigError, "odd", lambda: Localizer(route, query_views=2)),
        (LavaVprError, "nowhere", lambda: Localizer(tmp_path / "nowhere.lvpr")),
        (InputError, "odometry needs a map with positions", lambda: robot.update(winter[1], odometry=5.0)),
        (InputError, "nothing to learn", train),
    ]
    for error, text, call in wrong:
        with pytest.raises(error, match=text):
            call()
