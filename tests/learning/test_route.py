"""One way to learn: the command's options are the arguments of `train`, and both give the same model, byte for byte."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from support.common.commands import run

from lava_vpr import train
from lava_vpr.cli.train import train as command
from lava_vpr.config import preset
from lava_vpr.errors import ConfigError, InputError, ModelFileError, UsageError
from lava_vpr.learning.route import SETTINGS, Training
from lava_vpr.model import save
from lava_vpr.synthetic.world import World, render
from lava_vpr.training.stretches import Monitor

PLACES = 6
TEMPLATE = {"learning": "template"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two traverses of one route, with positions of each."""
    root = tmp_path_factory.mktemp("route")
    for season in ("summer", "winter"):
        (root / season).mkdir()
        for place in range(PLACES):
            cv2.imwrite(str(root / season / f"{place}.png"), render(World(0), place, season))
        rows = "".join(f"{4.0 * place},0\n" for place in range(PLACES))
        (root / f"{season}.csv").write_text("x,y\n" + rows)
    (root / "own.toml").write_text("seed = 3\n[learning]\nrule = 'template'\nepochs = 1\n")
    return root


@pytest.fixture
def here(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(folder)
    return folder


def test_every_option_of_the_command_is_an_argument_and_the_other_way_round() -> None:
    arguments = set(inspect.signature(train).parameters) - {"settings"} | set(SETTINGS)
    options = {str(option.name) for option in command.params}
    options = {{"address": "cluster", "jobs": "threads"}.get(name, name) for name in options}
    files = {"output", "pairs", "gt"}  # what the command writes beside a model, and reads for that
    assert options - files == arguments - {"rates", "progress", "checkpoint"}  # what only Python gives


WAYS: list[tuple[str, dict[str, Any]]] = [
    ("summer --learning template", TEMPLATE),
    ("summer --config own.toml --preset loihi", {"config": "own.toml", "preset": "loihi"}),
    ("summer winter --learning template --places 1:5 --seed 2", {**TEMPLATE, "places": (1, 5), "seed": 2}),
    (
        "summer winter --learning template --positions summer.csv --positions winter.csv --spacing 7",
        {**TEMPLATE, "positions": ["summer.csv", "winter.csv"], "spacing": 7.0},
    ),
    ("summer --learning template --keyframes 0.1 --views 3", {**TEMPLATE, "keyframes": 0.1, "views": 3}),
    ("summer --learning template --parts 2,4 --weight-bits 4", {**TEMPLATE, "parts": (2, 4), "weight_bits": 4}),
]


@pytest.mark.parametrize(("words", "arguments"), WAYS, ids=[words for words, _ in WAYS])
def test_python_learns_what_the_command_learns(words: str, arguments: dict[str, Any], here: Path) -> None:
    run("train", *words.split(), "-o", "command.lvpr")
    references = [word for word in words.split() if word in ("summer", "winter")]
    save(train(*references, **arguments), Path("python.lvpr"))
    assert Path("python.lvpr").read_bytes() == Path("command.lvpr").read_bytes()


def test_images_in_memory_take_the_same_arguments(here: Path) -> None:
    images = [render(World(0), place, "summer") for place in range(PLACES)]
    where = np.stack([np.arange(6) * 4.0, np.zeros(6)], axis=1)
    made = train(images, positions=where, spacing=7.0, **TEMPLATE)
    stored = train("summer", positions="summer.csv", spacing=7.0, **TEMPLATE)
    assert made.place_indices.tolist() == stored.place_indices.tolist() == [0, 2, 4]
    assert made.place_names == ("image 000000", "image 000002", "image 000004")
    np.testing.assert_array_equal(made.network.weights, stored.network.weights)
    assert made.positions is not None
    assert made.positions.tolist() == where[::2].tolist()
    with pytest.raises(InputError, match="images: has 6 images; places 0:9 go beyond"):
        train(images, places=(0, 9))


def test_a_training_is_followed_and_kept(here: Path) -> None:
    seen: list[str] = []

    @contextmanager
    def bar(text: str, total: int) -> Iterator[Callable[[int, str], None]]:
        done: list[int] = []
        yield lambda by, note: done.append(by)
        seen.append(f"{text}: {sum(done)} of {total}")

    monitor = Monitor(seen.append, bar)
    model = train("summer", keyframes=0.1, progress=monitor, checkpoint="c", threads=1, **TEMPLATE)
    kept = f"note: {model.places} of 6 images of summer become places"
    assert kept in seen or model.places == 6
    assert "looking for places in summer: 6 of 6" in seen
    assert f"reading summer: {model.places} of {model.places}" in seen
    assert f"learning: {model.places} of {model.places}" in seen
    assert not Path("c").exists()  # it is done
    with pytest.raises(ModelFileError, match="there is no checkpoint to resume from"):
        train("summer", checkpoint="c", resume=True)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"spacing": 1.0, "keyframes": 0.5}, "both say which images become places"),
        ({"window_ms": 5.0, "window_events": 10}, "both say how long a window is"),
        ({"resume": True}, "nowhere to resume from"),
        ({"section": 1}, "is one of a dataset's"),
        ({"positions": ["summer.csv", "winter.csv"]}, "--positions is given 2 times for 1 references"),
    ],
)
def test_arguments_that_exclude_each_other_are_wrong_usage(arguments: dict[str, Any], said: str, here: Path) -> None:
    with pytest.raises(UsageError, match=said):
        train("summer", **arguments)


def test_a_setting_that_is_none_and_a_rule_that_is_none_are_refused(here: Path) -> None:
    with pytest.raises(TypeError, match="neuron"):
        train("summer", neuron=3)
    with pytest.raises(ConfigError, match="there is no learning rule 'magic'; choose from float, integer"):
        train("summer", learning="magic")


def test_settings_that_are_given_whole_are_not_changed() -> None:
    assert Training.of(["r.aedat4"], config=preset("fast")).start == preset("fast")
