"""The public interface: a `Localizer` beside the command line, maps that grow under way, names that are kept."""

from __future__ import annotations

import csv
import math
import os
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.commands import run

import lava_vpr
from lava_vpr import Localizer, load, train
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.errors import ConfigError, InputError, LavaVprError
from lava_vpr.matching.forward_filter import RADIUS
from lava_vpr.model import Model
from lava_vpr.synthetic.world import World, render

PLACES = 24
Images = list[NDArray[np.uint8]]


def views(season: str, first: int = 0, end: int = PLACES) -> Images:
    return [render(World(0), place, season) for place in range(first, end)]


@pytest.fixture(scope="module")
def summer() -> Images:
    return views("summer")


@pytest.fixture(scope="module")
def winter() -> Images:
    return views("winter")


@pytest.fixture(scope="module")
def route(summer: Images) -> Model:
    config = update(preset("loihi"), {"learning": {"rule": "template", "epochs": 1}})
    return train(summer, config=config, positions=np.stack([np.arange(24.0) * 5, np.zeros(24)], axis=1))


@pytest.fixture
def here(route: Model, winter: Images, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Localizer(route).save("m.lvpr")
    Path("winter").mkdir()
    for number, image in enumerate(winter):
        cv2.imwrite(f"winter/{number:03d}.png", image)
    return tmp_path


def test_the_public_names_are_these() -> None:
    assert lava_vpr.__all__ == ["Candidate", "LavaVprError", "Localizer", "Match", "__version__", "load", "train"]
    assert set(lava_vpr.__all__) <= set(dir(lava_vpr))
    for name in lava_vpr.__all__:
        assert getattr(lava_vpr, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = lava_vpr.nothing


@pytest.mark.parametrize("motion", ["none", "any", "forward"])
def test_it_says_what_the_command_says(motion: str, winter: Images, here: Path) -> None:
    run("query", "m.lvpr", "winter", "-o", "q.csv", "--motion", motion)
    with open("q.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    robot = Localizer("m.lvpr", motion)
    matches = [robot.update(image, stamp=float(number)) for number, image in enumerate(winter)]
    assert [str(match.place) for match in matches] == [row["place"] for row in rows]
    assert [match.name for match in matches] == [row["place_name"] for row in rows]
    assert [str(match.accepted).lower() for match in matches] == [row["accepted"] for row in rows]
    assert [f"{match.probability:.6f}" for match in matches] == [row["probability"] for row in rows]
    assert [repr(match.confidence) for match in matches] == [row["confidence"] for row in rows]
    assert [match.stamp for match in matches] == list(range(PLACES))
    for match in matches:
        assert match.position == (5.0 * match.place, 0.0)
        assert match.frame == "xy"
        assert match.radius == (0 if motion == "none" else RADIUS)
        assert math.isnan(match.off_map) == (motion == "none")
        assert match.candidates[0].place == match.place
        assert len(match.candidates) == 5
        chances = [candidate.probability for candidate in match.candidates]
        assert motion == "none" or chances == sorted(chances, reverse=True)
        assert match.spikes.shape == (PLACES,)


def test_it_starts_anew_when_reset(winter: Images, route: Model) -> None:
    robot = Localizer(route, adapt=5)
    first = [robot.update(image).probability for image in winter[:6]]
    assert [robot.update(image).probability for image in winter[:6]] != first
    robot.reset()
    assert [robot.update(image).probability for image in winter[:6]] == first


def test_standing_still_changes_nothing(winter: Images, route: Model) -> None:
    robot = Localizer(route)
    for image in winter[:8]:
        last = robot.update(image)
    for _ in range(5):
        again = robot.update(winter[7])
        assert (again.place, again.probability) == (last.place, last.probability)


def test_odometry_says_how_far(winter: Images, route: Model) -> None:
    told, untold = Localizer(route, "forward"), Localizer(route, "forward")
    for robot, metres in ((told, 25.0), (untold, None)):
        for number in range(0, PLACES, 5):
            match = robot.update(winter[number], odometry=None if number == 0 else metres)
        assert match.place == 20 or robot is untold
    assert told.update(winter[23], odometry=15.0).place == 23


def test_places_come_and_go_while_it_drives(summer: Images, winter: Images, route: Model) -> None:
    short = train(summer[:16], config=route.config, positions=np.stack([np.arange(16.0) * 5, np.zeros(16)], axis=1))
    robot = Localizer(short)
    before = [robot.update(image) for image in winter[:16]][-1]
    where = np.stack([np.arange(16.0, 24) * 5, np.zeros(8)], axis=1)
    robot.add(summer[16:], where, names=[f"new {k}" for k in range(8)])
    assert robot.model.places == PLACES
    assert np.array_equal(robot.model.learned[:, :16], short.learned)
    matches = [robot.update(image) for image in winter[16:]]
    assert matches[0].probability > 0.5 * before.probability  # it was not lost
    assert [match.place for match in matches][-3:] == [21, 22, 23]
    assert matches[-1].name == "new 7"
    robot.remove([0, 1, 2])
    assert robot.model.places == PLACES - 3
    assert robot.update(winter[22]).place == 22
    with pytest.raises(InputError, match="no place 0"):
        robot.remove([0])


def test_what_is_saved_answers_alike(winter: Images, route: Model, tmp_path: Path) -> None:
    robot = Localizer(route, "none")
    robot.save(tmp_path / "m.lvpr")
    again = Localizer(load(tmp_path / "m.lvpr"), "none")
    for image in winter[:5]:
        one, other = robot.update(image), again.update(image)
        assert (one.place, one.probability) == (other.place, other.probability)
        assert np.array_equal(one.spikes, other.spikes)


def test_no_thread_no_file_no_memory(winter: Images, route: Model) -> None:
    robot = Localizer(route, adapt=10)
    robot.update(winter[0])
    threads, files = threading.active_count(), os.listdir("/proc/self/fd") if Path("/proc/self/fd").is_dir() else []
    sizes = {name: np.asarray(value).nbytes for name, value in vars(robot).items() if isinstance(value, np.ndarray)}
    for image in winter * 3:
        robot.update(image)
    assert threading.active_count() == threads
    assert not files or os.listdir("/proc/self/fd") == files
    assert sizes == {name: np.asarray(value).nbytes for name, value in vars(robot).items() if name in sizes}


def test_an_image_without_a_spike_matches_nothing_alone(route: Model) -> None:
    match = Localizer(route, "none").update(np.full((48, 64), 90, np.uint8))
    assert (match.place, match.name, match.position, match.accepted) == (-1, "", None, False)
    assert match.confidence == -math.inf


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


def test_what_cannot_be_asked_is_refused(winter: Images, summer: Images, route: Model, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no motion 'sideways'"):
        Localizer(route, "sideways")
    with pytest.raises(ConfigError, match="a precision of 1 "):
        Localizer(route, target_precision=1.0)
    with pytest.raises(ConfigError, match="odd"):
        Localizer(route, query_views=2)
    with pytest.raises(LavaVprError, match="nowhere"):
        Localizer(tmp_path / "nowhere.lvpr")
    unplaced = train(summer[:8], config=route.config)
    robot = Localizer(unplaced)
    robot.update(winter[0])
    with pytest.raises(InputError, match="odometry needs a map with positions"):
        robot.update(winter[1], odometry=5.0)
    with pytest.raises(InputError, match="nothing to learn"):
        train()
