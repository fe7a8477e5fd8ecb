"""The convolutional layer in place of the fixed channels, and its filters, learned with lava-dl."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from support.common.small_models import small_config

from lava_vpr import model
from lava_vpr.cli import main
from lava_vpr.config import Config
from lava_vpr.encoding import activity_of
from lava_vpr.errors import ConfigError
from lava_vpr.inputs import filters
from lava_vpr.slayer import front_end, needs
from lava_vpr.synthetic import write_traverses
from lava_vpr.synthetic.world import World, render

with_lava_dl = pytest.mark.skipif(needs.missing() is not None, reason=f"lava-dl is left out: {needs.missing()}")


@cache
def images() -> tuple[NDArray[np.uint8], ...]:
    world = World(seed=1, places=6)
    return tuple(render(world, place, "summer") for place in range(6))


def config(text: str = "") -> Config:
    return small_config(encoder={"kind": "filters", "image_size": 32, "orientations": 4, "filters": text})


def start() -> str:
    return filters.written(front_end.rounded(front_end.oriented(4)))


def test_filters_are_written_and_read() -> None:
    made = front_end.rounded(front_end.oriented(4))
    assert made.shape == (4, front_end.SIDE, front_end.SIDE)
    assert np.abs(made).max() == filters.TOP
    assert np.array_equal(filters.parsed(filters.written(made), 4), made)


@pytest.mark.parametrize("text", ["", "?", "AAAA", filters.written(np.ones((4, 4, 4), np.int8)), "AAAAAAAA" * 99])
def test_what_is_no_filters_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"^encoder\.filters holds no 4 square filters of an odd side up to 7; leave"):
        filters.parsed(text, 4)
    if text:
        with pytest.raises(ConfigError):
            config(text)


def test_spikes_are_those_of_a_neuron_that_integrates() -> None:
    currents = np.array([0, 1, 100, 129, 1365, 1366, 4095, 4096, 4097, 9000])
    counts = []
    for current in currents:
        v = count = 0
        for _ in range(filters.STEPS):
            v += int(current)
            if v > filters.THRESHOLD:
                v, count = 0, count + 1
        counts.append(count)
    assert filters.spikes(currents).tolist() == counts
    assert counts[-1] == filters.STEPS


def test_the_layer_is_blind_to_contrast_sign_and_to_illumination() -> None:
    image = images()[0]
    seen = activity_of(image, config(start()).encoder)
    assert seen.shape == (4 * 8 * 8,)
    assert seen.any()
    negative = activity_of((255 - image).astype(np.uint8), config(start()).encoder)
    assert np.mean(np.abs(seen - negative) > 1) < 0.02
    dark = activity_of((image // 2).astype(np.uint8), config(start()).encoder)
    assert np.corrcoef(seen, dark)[0, 1] > 0.9


@with_lava_dl
def test_lava_dl_makes_the_same_spikes() -> None:
    encoder, torch = config(start()).encoder, needs.libraries().torch
    weights = torch.from_numpy(front_end.oriented(4)[:, None].copy())
    seen = np.array([filters.seen_by(one, encoder.image_size, encoder.blur) for one in images()])
    found = front_end.layer(weights, seen, encoder).numpy()
    assert np.array_equal(found, [activity_of(one, encoder) for one in images()])
    assert found.max() > 3


@with_lava_dl
def test_filters_learn_from_references_alone_and_the_same_every_time() -> None:
    once = front_end.learned_filters(images(), config(), 2)
    assert once == front_end.learned_filters(images(), config(), 2)
    assert once != front_end.learned_filters(images(), config(), 0) == start()


@with_lava_dl
def test_the_command_line_learns_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With any kind of learning behind them; the model keeps them, and answers as any other."""
    monkeypatch.chdir(tmp_path)
    write_traverses(tmp_path, 4, 0)
    runner, words = CliRunner(), ("--input", "filters", "--learning", "template")
    made = runner.invoke(main, ["train", "reference", "-o", "m.lvpr", *words])
    assert made.exit_code == 0, made.output
    text = model.load("m.lvpr").config.encoder.filters
    assert filters.parsed(text, 8).shape == (8, 5, 5)
    asked = runner.invoke(main, ["eval", "m.lvpr", "reference"])
    assert asked.exit_code == 0, asked.output


def test_without_lava_dl_one_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(needs, "missing", lambda: "torch is not installed")
    write_traverses(tmp_path, 4, 0)
    made = CliRunner().invoke(
        main, ["train", str(tmp_path / "reference"), "-o", str(tmp_path / "m"), "--input", "filters"]
    )
    assert made.exit_code == 1
    assert "needs lava-dl: torch is not installed" in made.output
