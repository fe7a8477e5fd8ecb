"""Learning by SLAYER, with lava-dl: the same spikes as the engine's, gradients, and models like any other."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.common import children
from support.common.small_models import encoded, small_config

from lava_vpr import model as model_file
from lava_vpr.cli import main
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, integer_config
from lava_vpr.engine.inference import counting, quantise
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.engine.rates import draw_trains, query_rates16
from lava_vpr.model import Model, integer_model
from lava_vpr.slayer import forward, needs
from lava_vpr.synthetic import write_traverses
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
    film = counting.count_spikes(network, rates, keys, raster=True)[2]
    assert film.sum() > 12
    root = counting.inhibitory_spikes(network, film)[:, :, -1]
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


def test_without_lava_dl_one_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(needs, "missing", lambda: "torch is not installed")
    write_traverses(tmp_path, 4, 0)
    made = CliRunner().invoke(
        main, ["train", str(tmp_path / "reference"), "-o", str(tmp_path / "m"), "--learning", "slayer"]
    )
    assert made.exit_code == 1
    assert "needs lava-dl: torch is not installed" in made.output
