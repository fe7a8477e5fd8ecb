"""Learning by SLAYER, with lava-dl: the same spikes as the engine's, gradients, and models like any other."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from support.common import children
from support.common.small_models import encoded, small_config

from lava_vpr import model, model as model_file
from lava_vpr.cli import main
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, integer_config
from lava_vpr.encoding import activity_of, draw_trains, query_rates16
from lava_vpr.engine.inference import fixed, quantise
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.errors import ConfigError
from lava_vpr.inputs import orientation as filters
from lava_vpr.model import Model, integer_model
from lava_vpr.slayer import forward, front_end, needs
from lava_vpr.synthetic import write_traverses
from lava_vpr.synthetic.world import World, render
from lava_vpr.training.loop import train

with_lava_dl = pytest.mark.skipif(needs.missing() is not None, reason=f"lava-dl is left out: {needs.missing()}")


def slayer(**changes: object) -> Config:
    settings = {"learning": {"rule": "slayer", "epochs": 3}, "slayer": {"batch": 3}}
    return small_config(**{**settings, **changes})


@cache
def learned() -> Model:
    return train([encoded()], slayer(), pool=Pool(2))


@with_lava_dl
@pytest.mark.parametrize("changes", [{}, {"trains": "poisson"}, {"signed": False, "tau_membrane": 4.0}])
def test_it_spikes_as_the_engine_does(changes: dict[str, object]) -> None:
    """Every excitatory spike of every step, of networks with biases and inhibition that do something."""
    network = integer_model(train([encoded(12)], small_config(stretch=0, network=changes)), "a test").network
    rates = query_rates16(encoded(12, noise=0.5).activity, small_config().encoder)
    keys = presentation_keys(1, "query", image_keys(rates))
    film = fixed.count_spikes(network, rates, keys, raster=True)[2]
    assert film.sum() > 12
    root = fixed.inhibitory_spikes(network, film)[:, :, -1]
    torch = needs.libraries().torch
    weights = torch.zeros(network.weights.shape)
    trains = forward.input_trains(network, rates, keys)
    found = forward.spikes(network, weights, trains, root, 0.3).numpy()
    assert np.array_equal(found.transpose(0, 2, 1), film)
    drawn = draw_trains(rates, keys, network.steps, network.interval, regular=network.regular)
    assert np.array_equal(trains[:, network.input_delay :], drawn[:, : -network.input_delay])


@with_lava_dl
@pytest.mark.parametrize("signed", [True, False])
def test_weights_are_scaled_as_deployment_rounds_them(signed: bool) -> None:
    settings = integer_config(small_config(network={"signed": signed}), "a test").network
    weights = np.random.default_rng(0).random((60, 9)).astype(np.float32) ** 3
    scaled = forward.scaled(needs.libraries().torch.from_numpy(weights), settings.weight_bits, signed).numpy()
    deployed = quantise.integer_weights(quantise.distinctive(weights, settings), settings.weight_bits)
    inside = np.abs(scaled) < 7
    assert np.abs(scaled - deployed)[inside].max() < 0.5001
    assert np.array_equal(np.sign(deployed[~inside]), np.sign(scaled[~inside]))


@with_lava_dl
def test_a_spike_more_for_the_own_place_lowers_the_loss() -> None:
    """The gradient is down hill: a step along it, on weights that know nothing, brings the right neurons more."""
    scratch = {"start": "scratch", "batch": 8, "rate": 0.1, "sharpness": 0.1, "surrogate": 1.0}
    config = small_config(stretch=0, learning={"rule": "slayer", "epochs": 40}, slayer=scratch)
    shown = encoded()
    before = train([shown], small_config(stretch=0, learning={"rule": "slayer", "epochs": 1}, slayer=scratch))
    after = train([shown], config)
    right = [np.mean(model.responses.argmax(axis=0) == np.arange(8)) for model in (before, after)]
    assert right[1] == 1.0
    assert right[0] < 1.0


@with_lava_dl
def test_the_same_model_for_every_number_of_threads_and_from_a_checkpoint(tmp_path: Path) -> None:
    config, path = slayer(), tmp_path / "c"
    once = learned()

    class Stop(Exception):
        pass

    def stop(progress: object) -> None:
        if getattr(progress, "epoch", 0) == 2:
            raise Stop

    with pytest.raises(Stop):
        train([encoded()], config, checkpoint=path, interval=0, progress=stop)
    again = train([encoded()], config, checkpoint=path, resume=True)
    assert np.array_equal(again.learned, once.learned)
    other = train([encoded()], slayer(seed=1))
    assert not np.array_equal(other.learned, once.learned)


@with_lava_dl
def test_a_model_like_any_other(tmp_path: Path) -> None:
    """With a sign in what it learned, it is kept in a file, and knows its places."""
    model = learned()
    assert model.learned.min() < 0
    assert np.array_equal(model.neuron_places(), np.arange(8))
    model_file.save(model, tmp_path / "m.lvpr")
    back = model_file.load(tmp_path / "m.lvpr")
    assert np.array_equal(back.learned, model.learned)
    assert back.config.learning.rule == "slayer"


@with_lava_dl
def test_two_traverses_and_views_are_learned() -> None:
    config = slayer(views={"shifts": 3}, learning={"rule": "slayer", "epochs": 1})
    references = [encoded(seed=k, noise=0.3) for k in range(3)] * 2
    model = train(references, config)
    assert model.neurons == 24
    assert len(model.stretches) == 6


@with_lava_dl
def test_nobody_else_waits_for_torch() -> None:
    said = "import sys, lava_vpr.training.loop, lava_vpr.cli.train; print('torch' in sys.modules)"
    done = children.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


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
