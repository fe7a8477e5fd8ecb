"""The public interface: a `Localizer` beside the command line, maps that grow under way, names that are kept."""

from __future__ import annotations

import copy
import math
import os
import pickle
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.commands import matches

import lava_vpr
from lava_vpr import Localizer, Match, train
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.errors import ConfigError, InputError
from lava_vpr.maps import extend
from lava_vpr.model import Model
from lava_vpr.positions.frames import Positions
from lava_vpr.storage import container
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
    rows = matches("winter", "--motion", motion, "--scores", "s.npy")
    robot, answers, scores = Localizer("m.lvpr", motion), list[Match](), list[Any]()
    assert robot.scores is None
    for number, image in enumerate(winter):
        answers.append(robot.update(image, stamp=float(number)))
        scores.append(robot.scores)
    assert np.array_equal(np.load("s.npy"), scores)
    assert [str(match.place) for match in answers] == [row["place"] for row in rows]
    assert [match.name for match in answers] == [row["place_name"] for row in rows]
    assert [str(match.accepted).lower() for match in answers] == [row["accepted"] for row in rows]
    assert [f"{match.probability:.6f}" for match in answers] == [row["probability"] for row in rows]
    assert [repr(match.confidence) for match in answers] == [row["confidence"] for row in rows]
    assert [match.stamp for match in answers] == list(range(PLACES))
    for match in answers:
        assert match.position == (5.0 * match.place, 0.0)
        assert match.frame == "xy"
        assert match.radius == (0 if motion == "none" else 1)
        assert math.isnan(match.off_map) == (motion == "none")
        assert match.candidates[0].place == match.place
        assert len(match.candidates) == 5
        chances = [candidate.probability for candidate in match.candidates]
        assert motion == "none" or chances == sorted(chances, reverse=True)
        assert match.spikes.shape == (PLACES,)


def test_it_adapts_as_the_model_says_unless_told_otherwise(winter: Images, route: Model, here: Path) -> None:
    """A model of before has no such setting, and one without signs no biases."""
    header, arrays = container.load(Path("m.lvpr"), "model")
    del header["config"]["network"]["adapt"]
    container.save(Path("older.lvpr"), "model", header, arrays)
    unsigned = update(route.config, {"network": {"signed": False}})
    made = [("older.lvpr", None), (train(winter, config=unsigned), None), (route, 30.0)]
    for model, time_constant in made:
        for motion in ("any", "none"):
            expected = time_constant if motion == "any" else None
            robots = [Localizer(model, motion), Localizer(model, motion, expected), Localizer(model, motion, None)]
            own, same, plain = ([robot.update(image).confidence for image in winter[:9]] for robot in robots)
            assert own == same
            assert (own == plain) == (expected is None)


def test_it_starts_anew_when_reset(winter: Images, route: Model) -> None:
    robot = Localizer(route, adapt=5)
    first = [robot.update(image).probability for image in winter[:6]]
    assert [robot.update(image).probability for image in winter[:6]] != first
    robot.reset()
    assert robot.scores is None
    assert [robot.update(image).probability for image in winter[:6]] == first


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e300, "three", "list"])
def test_a_place_without_a_position_does_not_cost_the_map(wrong: float | str, winter: Images, here: Path) -> None:
    """A receiver that loses its satellites for a second says NaN."""
    before = Path("m.lvpr").read_bytes()
    positions: Any = {"three": np.zeros((2, 3)), "list": [[0.0, 0.0], [0.0]]}.get(str(wrong), np.full((2, 2), wrong))
    robot = Localizer("m.lvpr")
    for refused in (
        lambda: robot.add(winter[:2], positions),
        lambda: extend(robot.model, winter[:2], positions=positions),
        lambda: train(winter[:2], positions=positions),
    ):
        with pytest.raises(InputError, match=r"^position"):
            refused()
    robot.update(winter[3])
    robot.save("m.lvpr")
    assert Path("m.lvpr").read_bytes() == before


def test_positions_may_be_a_list(winter: Images, route: Model) -> None:
    robot = Localizer(route)
    robot.add(winter[:2], [[120, 0], [125, 1]])
    assert robot.model.positions is not None
    assert robot.model.positions[-2:].tolist() == [[120, 0], [125, 1]]


def test_standing_still_changes_nothing(winter: Images, route: Model) -> None:
    robot = Localizer(route)
    for image in winter[:8]:
        last = robot.update(image)
    for _ in range(5):
        again = robot.update(winter[7])
        assert (again.place, again.probability) == (last.place, last.probability)


EAST = np.arange(24.0) * 5 + 60 * (np.arange(24) >= 10)
"""Metres along a route: 5 between places, but 65 between the tenth and the next."""
GREY = np.full((48, 64), 90, np.uint8)

WHERE = {
    "xy": np.stack([EAST, np.zeros(24)], axis=1),
    "UTM 32N": np.stack([5e5 + 0.6 * EAST, 6.6e6 - 0.8 * EAST], axis=1),
    "latlon": np.stack([np.full(24, 60.0), 10 + EAST * 1.798640e-5], axis=1),  # a degree east: 55,597.5 m of the sphere
}


@pytest.mark.parametrize("frame", WHERE)
def test_odometry_says_how_far(frame: str, summer: Images, winter: Images, route: Model) -> None:
    """Images without a spike tell nothing, nor that the robot moves: the odometer alone says where they were taken."""
    placed = train(summer, config=route.config, positions=Positions(WHERE[frame], frame))
    told, untold = Localizer(placed, "forward"), Localizer(placed, "forward")
    for number in range(10):
        places = {robot.update(winter[number]).place for robot in (told, untold)}
        assert places == {number}
    for number, metres in ((10, 65.0), (15, 25.0), (20, 25.0)):
        match, other = told.update(GREY, odometry=metres), untold.update(GREY)
        assert abs(match.place - number) <= 1
        assert (match.frame, match.position) == (frame, tuple(WHERE[frame][match.place]))
        assert abs(other.place - 10) <= 1


def test_a_stuck_camera_is_named_where_an_odometer_moves(winter: Images, route: Model) -> None:
    """With motion ``none``, too, and through a change of the map; images that repeat alone change no answer."""
    for motion in ("any", "none"):
        driven, rests = (Localizer(route, motion, target_precision=0.3) for _ in range(2))
        moved = [driven.update(winter[7], float(k), odometry=0.0 if k < 3 else 2.0) for k in range(25)]
        still = [rests.update(winter[7], float(k)) for k in range(25)]
        assert [match.repeats for match in moved] == [match.repeats for match in still] == list(range(25))
        assert [match.accepted for match in moved] == [number < 3 for number in range(25)]
        assert [match.cause for match in moved] == [None] * 19 + ["stuck camera"] * 6
        assert {(match.accepted, match.cause) for match in still} == {(True, None)}
        assert not {"repeats", "cause", "unlike", "time_fault"} & set(still[0].values())
        assert (moved[-1].values()["repeats"], moved[-1].values()["cause"]) == (24, "stuck camera")
        driven.remove([0])
        assert driven.update(winter[7], odometry=0.0).cause == "stuck camera"
        assert driven.update(winter[8], odometry=2.0).cause is None


def test_times_that_cannot_be_are_told_with_the_match(winter: Images, route: Model) -> None:
    robot = Localizer(route)
    said = [robot.update(winter[k], stamp) for k, stamp in enumerate((5.0, 4.0, np.nan, -1.0, 6.0))]
    assert [match.time_fault for match in said] == [None, "backwards", "not a number", "backwards", None]
    assert [match.values()["time"] for match in said] == [5.0, 4.0, None, -1.0, 6.0]
    assert "time_fault" not in said[0].values()


@pytest.mark.parametrize(
    ("change", "gone"),
    [
        (lambda robot, _: robot.remove([0, 1, 2]), ()),
        (lambda robot, _: robot.remove([18, 20, 23]), ()),
        (lambda robot, _: robot.remove([10, 11, 12, 13]), (10, 11, 12, 13)),
        (lambda robot, images: robot.add(images[:13], np.ones((13, 2)), allow_duplicates=True), ()),
    ],
)
def test_what_is_believed_outlives_a_change_of_the_map(
    change: Callable[[Localizer, Images], None], gone: tuple[int, ...], summer: Images, winter: Images, route: Model
) -> None:
    """Then comes an image without a spike, which says nothing: the tracks move by their speed, and a few of them end.

    What was believed of removed places is off the map.
    """
    robot = Localizer(route, "forward")
    before = [robot.update(image) for image in winter[:12]][-1]
    assert (before.place, before.probability > 0.98) == (11, True)
    unchanged = copy.deepcopy(robot).update(GREY)
    change(robot, summer)
    believed = {one.place: one.probability for one in before.candidates}
    lost = sum(believed[place] for place in gone)
    after = robot.update(GREY)
    assert after.off_map == pytest.approx(before.off_map + lost, abs=0.012)
    if gone:
        assert after.off_map > 0.95
        return
    assert after.place == 12
    for one, same in zip(after.candidates[:4], unchanged.candidates[:4], strict=True):
        assert (one.place, one.probability) == (same.place, pytest.approx(same.probability, abs=1e-3))


def test_new_places_are_in_the_frame_of_the_map(summer: Images, route: Model) -> None:
    robot = Localizer(train(summer[:8], config=route.config, positions=Positions(WHERE["latlon"][:8], "latlon")))
    robot.add(summer[8:10], WHERE["latlon"][8:10])
    assert robot.model.frame == "latlon"
    np.testing.assert_array_equal(robot.model.positions, WHERE["latlon"][:10])


def test_seeds_are_those_that_are_given(summer: Images, winter: Images, route: Model) -> None:
    assert train(summer[:4], config=route.config, seed=3).config.seed == 3
    own, same, other = (
        [Localizer(route, "none", seed=seed).update(image).spikes.tolist() for image in winter] for seed in (None, 0, 1)
    )
    assert own == same
    assert own != other


def test_probabilities_are_calibrated_for_one_view(winter: Images, route: Model) -> None:
    """Of several they are not known, and no match is accepted."""
    assert route.calibration is not None
    match = Localizer(route, "none", query_views=3).update(winter[3])
    assert (match.place, match.accepted, math.isnan(match.probability)) == (3, False, True)
    with pytest.raises(ConfigError, match="needs probabilities, but several views of a query"):
        Localizer(route, "none", query_views=3, target_precision=0.9)


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
    last = robot.update(winter[22])
    assert (last.place, last.unlike) == (22, Localizer(robot.model).update(winter[22]).unlike)
    with pytest.raises(InputError, match="no place 0"):
        robot.remove([0])


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


def test_a_copy_goes_on_where_it_was(winter: Images, route: Model) -> None:
    robot = Localizer(route)
    for image in winter[:4]:
        robot.update(image)
    copies = [pickle.loads(pickle.dumps(robot)), copy.deepcopy(robot)]
    for image in winter[4:8]:
        own = robot.update(image).values()
        assert [one.update(image).values() for one in copies] == [own, own]
