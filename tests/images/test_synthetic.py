"""The synthetic world: deterministic, recognisable by edges, hard for pixels, and written all or nothing."""

from __future__ import annotations

import errno
import hashlib
import os
import signal
import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from support.common import children
from support.common.imagefiles import refused

from lava_vpr.errors import ConfigError, InputError
from lava_vpr.inputs.orientation import orientation_channels
from lava_vpr.inputs.patches import patch_normalised
from lava_vpr.positions.gpx import read_gpx
from lava_vpr.synthetic import world as synthetic
from lava_vpr.synthetic.scene import LOOKS, ahead, route, segment
from lava_vpr.synthetic.world import CONDITIONS, World, positions, render, track, write_traverses

ENTRIES = ["query", "query.gpx", "query_positions.csv", "reference", "reference.gpx", "reference_positions.csv"]


def sha(image: NDArray[np.uint8]) -> str:
    return hashlib.sha256(image.tobytes()).hexdigest()


def content(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


@lru_cache
def journey(seed: int, condition: str) -> tuple[NDArray[np.uint8], ...]:
    """100 places, drawn one after the other."""
    world = World(seed=seed)
    return tuple(render(world, place, condition) for place in range(world.places))


# Properties of images


@settings(deadline=None, max_examples=15, derandomize=True)
@given(
    seed=st.integers(0, 2**63 - 1),
    place=st.integers(0, 99_999),
    condition=st.sampled_from(CONDITIONS),
    size=st.tuples(st.integers(32, 200), st.integers(24, 120)),
)
def test_any_place_of_any_world_is_drawn_and_drawn_again(
    seed: int, place: int, condition: str, size: tuple[int, int]
) -> None:
    world = World(seed=seed, places=100_000, width=size[0], height=size[1])
    first = render(world, place, condition)
    route.cache_clear()
    segment.cache_clear()
    assert first.dtype == np.uint8
    assert first.shape == (size[1], size[0], 3)
    assert first.std() > 5
    np.testing.assert_array_equal(render(world, place, condition), first)


def test_a_place_drawn_alone_equals_the_same_place_in_a_batch() -> None:
    """Alone in another process, where nothing has been drawn before and strings hash differently."""
    code = (
        "import hashlib; from lava_vpr.synthetic.world import World, render\n"
        "for place, c in ((57, 'summer'), (57, 'winter'), (3, 'night'), (99, 'rain')):\n"
        "    print(hashlib.sha256(render(World(seed=1), place, c).tobytes()).hexdigest())"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "77"}
    alone = children.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    batch = [journey(1, "summer")[57], journey(1, "winter")[57]]
    batch += [render(World(seed=1), 3, "night"), render(World(seed=1), 99, "rain")]
    assert alone.stdout.split() == [sha(image) for image in batch]


def test_a_place_does_not_depend_on_how_many_places_there_are() -> None:
    np.testing.assert_array_equal(render(World(places=6), 5, "winter"), render(World(places=500), 5, "winter"))


def test_every_place_condition_and_seed_gives_its_own_image() -> None:
    images = [render(World(seed=s), p, c) for s in (0, 1) for p in (0, 1, 2) for c in CONDITIONS]
    assert len({sha(image) for image in images}) == len(images)


def test_conditions_have_their_own_noise_and_stance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Were winter coloured like summer, its images would still be other photographs of the same places."""
    monkeypatch.setitem(LOOKS, "winter", LOOKS["summer"])
    with_grain = [render(World(), 4, c).astype(int) for c in ("summer", "winter")]
    for condition in ("summer", "winter"):
        monkeypatch.setitem(LOOKS, condition, replace(LOOKS["summer"], grain=0))
    without = [render(World(), 4, c).astype(int) for c in ("summer", "winter")]
    assert (without[0] != without[1]).any(axis=2).mean() > 0.1
    grain = [(a - b).ravel() for a, b in zip(with_grain, without, strict=True)]
    assert min(g.std() for g in grain) > 1
    assert abs(np.corrcoef(*grain)[0, 1]) < 0.05


def test_snow_turns_dark_ground_bright() -> None:
    summer, winter = (np.stack(journey(0, c)).mean(axis=(0, 2, 3)) for c in ("summer", "winter"))
    assert summer[:16].mean() > summer[40:].mean() + 40
    assert winter[:16].mean() < winter[40:].mean() - 40


def test_night_is_dark_and_rain_is_dull() -> None:
    summer, rain, night = (np.stack([render(World(), p, c) for p in range(8)]) for c in ("summer", "rain", "night"))
    assert night.mean() < 0.6 * summer.mean()
    assert rain.std() < 0.7 * summer.std()


def test_what_one_place_sees_ahead_the_next_ones_pass() -> None:
    here, there = ahead(0, 200.0), ahead(0, 220.0)
    shared = set(here) & set(there)
    assert len(shared) > 0.7 * len(here)
    assert all(t.s < 220.0 for t in set(here) - shared)
    distances = [t.s for t in there if t.kind not in ("land", "lake")]
    assert distances == sorted(distances, reverse=True)


# How hard it is


def recall_at_1(distance: NDArray[np.float64]) -> float:
    return float(np.mean(distance.argmin(axis=1) == np.arange(len(distance))))


@pytest.mark.parametrize("seed", [0, 1])
def test_pixels_recognise_about_half_of_the_places_and_edges_nearly_all(seed: int) -> None:
    pair = journey(seed, "summer"), journey(seed, "winter")
    reference, query = (np.stack([patch_normalised(i).ravel() for i in images]).astype(np.int16) for images in pair)
    sad = np.abs(query[:, None] - reference[None]).mean(axis=2)
    reference, query = (np.stack([orientation_channels(i) for i in images]) for images in pair)
    cosine = (query / np.linalg.norm(query, axis=1)[:, None]) @ (
        reference / np.linalg.norm(reference, axis=1)[:, None]
    ).T
    assert 0.4 <= recall_at_1(sad) <= 0.8
    assert recall_at_1(-cosine) >= 0.93


# Positions


def test_positions_follow_the_route() -> None:
    world = World(seed=3, places=40, spacing_m=25.0)
    ours, theirs = positions(world, "summer"), positions(world, "winter")
    assert ours.shape == (40, 2)
    assert np.abs(np.linalg.norm(np.diff(ours, axis=0), axis=1) - 25).max() < 5
    assert 0 < np.linalg.norm(ours - theirs, axis=1).max() < 5
    np.testing.assert_array_equal(positions(world, "summer"), ours)


@pytest.mark.parametrize("spacing", [20.0, 7.3])
def test_a_track_follows_the_route_at_other_times(spacing: float) -> None:
    world = World(seed=3, places=40, spacing_m=spacing)
    seconds, xy = track(world, "night")
    np.testing.assert_array_equal(seconds, np.arange(len(xy)))
    assert 39 * spacing / 10 <= seconds[-1] < 39 * spacing / 10 + 1
    at = np.arange(40) * spacing / 10
    between = np.stack([np.interp(at, seconds, axis) for axis in xy.T], axis=1)
    assert np.abs(between - positions(world, "night")).max() < 3.5


# Writing


def test_two_journeys_are_written_with_their_positions(tmp_path: Path) -> None:
    out = tmp_path / "new" / "world"
    write_traverses(out, 3, 5)
    assert sorted(p.name for p in out.iterdir()) == ENTRIES
    assert sorted(p.name for p in (out / "query").iterdir()) == [f"place_{k:05d}.png" for k in range(3)]
    for kind, condition in (("reference", "summer"), ("query", "winter")):
        image = cv2.imread(str(out / kind / "place_00002.png"))
        np.testing.assert_array_equal(image, render(World(seed=5, places=3), 2, condition))
        table = (out / f"{kind}_positions.csv").read_text().splitlines()
        assert [row.split(",")[0] for row in table] == ["name", *(f"place_{k:05d}.png" for k in range(3))]
        read = np.array([[float(cell) for cell in row.split(",")[1:]] for row in table[1:]])
        np.testing.assert_allclose(read[:, :2], positions(World(seed=5, places=3), condition), atol=0.006)
        assert np.diff(read[:, 2]).tolist() == [2, 2]  # 20 m at 10 m/s
        gps = read_gpx(out / f"{kind}.gpx")
        assert gps.stamps is not None
        assert (gps.stamps - read[0, 2]).tolist() == [0, 1, 2, 3, 4]
        away = gps.positions.to("UTM 32N").values[::2] - [610_000, 6_640_000] - read[:, :2]
        assert np.abs(away).max() < 3.01  # an error of 1.5 m each
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["world"]


def test_equal_arguments_write_equal_bytes_and_replace_the_earlier_result(tmp_path: Path) -> None:
    write_traverses(tmp_path / "a", 2, 0, ("summer", "night"))
    write_traverses(tmp_path / "b", 4, 1)
    write_traverses(tmp_path / "b", 2, 0, ("summer", "night"))
    assert content(tmp_path / "a") == content(tmp_path / "b")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "b"]


def test_an_empty_folder_is_filled(tmp_path: Path) -> None:
    (tmp_path / "w").mkdir()
    write_traverses(tmp_path / "w", 1, 0)
    assert sorted(p.name for p in (tmp_path / "w").iterdir()) == ENTRIES


def test_entries_to_keep_stay(tmp_path: Path) -> None:
    write_traverses(tmp_path / "w", 2, 0)
    (tmp_path / "w" / "model.lvpr").write_text("m")
    write_traverses(tmp_path / "w", 1, 0, keep=("model.lvpr",))
    assert (tmp_path / "w" / "model.lvpr").read_text() == "m"
    assert len(list((tmp_path / "w" / "query").iterdir())) == 1


@pytest.mark.parametrize("stranger", ["holiday.jpg", "reference/holiday.jpg", "query", "reference/place_00000.png/x"])
def test_a_folder_with_something_else_is_refused_and_left_alone(tmp_path: Path, stranger: str) -> None:
    file = tmp_path / "w" / stranger
    file.parent.mkdir(parents=True)
    file.write_text("mine")
    before = content(tmp_path)
    with pytest.raises(InputError, match=r"w: holds something else \(.+\); choose a new or an empty folder$"):
        write_traverses(tmp_path / "w", 1, 0)
    assert content(tmp_path) == before


def test_a_file_in_the_way_is_refused(tmp_path: Path) -> None:
    (tmp_path / "w").write_text("mine")
    with pytest.raises(InputError, match=r"w: exists and is not a folder; choose another name$"):
        write_traverses(tmp_path / "w", 1, 0)
    with pytest.raises(InputError, match=r"w.x: cannot be written \(.+\); choose a folder on a disk with free space"):
        write_traverses(tmp_path / "w" / "x", 1, 0)


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_traverses(tmp_path / "w", 1, 0)
    before = content(tmp_path)
    written: list[Path] = []

    def full(self: Path, data: bytes) -> int:
        written.append(self)
        if len(written) == 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        return len(data)

    monkeypatch.setattr(Path, "write_bytes", full)
    refused(
        lambda: write_traverses(tmp_path / "w", 2, 7),
        "w: cannot be written (No space left on device); choose a folder on a disk",
    )
    assert len(written) == 3
    assert content(tmp_path) == before
    assert [p.name for p in tmp_path.iterdir()] == ["w"]


@pytest.mark.parametrize("failing", range(1, 9))
def test_a_failed_replacement_brings_the_earlier_result_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: int
) -> None:
    write_traverses(tmp_path / "w", 1, 0)
    before = content(tmp_path)
    rename, calls = os.rename, 0

    def flaky(source: Path, target: Path) -> None:
        nonlocal calls
        calls += 1
        if calls == failing:
            raise PermissionError(errno.EACCES, "Permission denied")
        rename(source, target)

    monkeypatch.setattr(synthetic.os, "rename", flaky)
    refused(lambda: write_traverses(tmp_path / "w", 1, 9), "w: cannot be written (Permission denied)")
    assert content(tmp_path) == before
    assert [p.name for p in tmp_path.iterdir()] == ["w"]


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("stopped", range(1, 9))
def test_a_replacement_that_is_interrupted_loses_neither_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stopped: int
) -> None:
    write_traverses(tmp_path / "w", 1, 9)
    new = content(tmp_path)
    write_traverses(tmp_path / "w", 1, 0)
    rename, calls = os.rename, 0

    def slow(source: Path, target: Path) -> None:
        nonlocal calls
        calls += 1
        rename(source, target)
        if calls == stopped:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(synthetic.os, "rename", slow)
    with pytest.raises(KeyboardInterrupt):
        write_traverses(tmp_path / "w", 1, 9)
    assert content(tmp_path) == new
    assert [p.name for p in tmp_path.iterdir()] == ["w"]


def test_a_folder_without_permission_is_refused(tmp_path: Path) -> None:
    if os.geteuid() == 0:
        pytest.skip("the superuser may write everywhere")
    tmp_path.chmod(0o500)
    refused(lambda: write_traverses(tmp_path / "w", 1, 0), "w: cannot be written (Permission denied)")


# Wrong arguments


@pytest.mark.parametrize(
    ("name", "value"),
    [("seed", -1), ("seed", 2**63), ("places", 0), ("width", 31), ("height", 4000), ("spacing_m", float("nan"))],
)
def test_a_world_outside_its_range_is_refused(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=rf"the synthetic world's {name} is .+, but must be in \d+\.\.\d+$"):
        World(**{name: value})  # type: ignore[arg-type]


def test_unknown_conditions_and_places_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"there is no condition 'spring'; choose from summer, winter, rain, night$"):
        render(World(), 0, "spring")
    refused(lambda: write_traverses(tmp_path / "w", 1, 0, ("summer", "fog")), "there is no condition 'fog'")
    refused(lambda: write_traverses(tmp_path / "w", 1, 0, ("summer",)), "1 conditions are given; give two")
    for place in (-1, 100):
        with pytest.raises(InputError, match=rf"place {place} is not in the synthetic world; choose one of 0\.\.99$"):
            render(World(), place, "summer")
    assert not list(tmp_path.iterdir())
