"""``learning.rule = "template"``: nothing is learned, the references' rates are the weights."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.common.small_models import encoded, small_config, tiny_paper

from lava_vpr import model
from lava_vpr.cli import main
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.bundle.learning import chip_learning
from lava_vpr.encoding import training_rates
from lava_vpr.engine.inference.quantise import unit_norm
from lava_vpr.errors import ConfigError
from lava_vpr.synthetic import write_traverses
from lava_vpr.training.loop import check_size, train
from lava_vpr.training.templates import template_of


def templates(**changes: object) -> Config:
    return small_config(learning={"rule": "template", "epochs": 1, **changes})


def test_the_weights_are_the_rates() -> None:
    """Every neuron's weights are the mean rates of its place's references, all traverses alike."""
    first, second = encoded(), dataclasses.replace(encoded(noise=0.5), indices=np.arange(8) + 5)
    config = templates()
    learned = train([first, second], config).learned
    rates = [training_rates(part.activity, config).astype(np.float64) for part in (first, second)]
    assert np.allclose(unit_norm(learned), unit_norm(np.mean(rates, axis=0).T), rtol=1e-4, atol=1e-6)
    assert np.array_equal(unit_norm(train([first], config).learned).argmax(axis=0), rates[0].argmax(axis=1))
    once, often = train([first], config), train([first], templates(epochs=3))
    assert np.allclose(once.learned, often.learned, rtol=1e-5, atol=1e-8)


def test_they_know_their_places_and_are_kept_in_a_model(tmp_path: Path) -> None:
    trained = train([encoded()], templates())
    assert np.array_equal(trained.neuron_places(), np.arange(8))
    model.save(trained, tmp_path / "m.lvpr")
    assert model.load(tmp_path / "m.lvpr").config.learning.rule == "template"


def test_every_place_takes_one_neuron() -> None:
    config = update(preset("loihi"), {"learning": {"rule": "template"}, "network": {"neurons_per_place": 1.5}})
    with pytest.raises(ConfigError, match=r"one neuron for each place, but 100 places have 150 neurons; set network\."):
        check_size(100, config)


def test_a_chip_has_nothing_to_learn() -> None:
    with pytest.raises(
        ConfigError, match=r"^learning on the chip needs weights that were learned, not templates; train"
    ):
        chip_learning(train([encoded()], templates()))


def test_the_command_line_knows_the_word(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_traverses(tmp_path, 4, 0)
    Path("t.toml").write_text('[learning]\nrule = "template"\n')

    def rule_of(*words: str) -> tuple[str, str, int]:
        done = CliRunner().invoke(main, ["train", "reference", "-o", "m.lvpr", *words])
        assert done.exit_code == 0, done.output
        learning = model.load("m.lvpr").config.learning
        return learning.rule, learning.arithmetic, learning.epochs

    assert rule_of("--learning", "template") == ("template", "float", 1)
    assert rule_of("--config", "t.toml", "--epochs", "2") == ("template", "float", 2)
    assert rule_of("--config", "t.toml", "--learning", "integer", "--epochs", "1") == ("stdp", "integer", 1)


@pytest.mark.parametrize("views", [1, 3])
def test_any_model_gives_the_one_that_learned_nothing(views: int) -> None:
    """From what a model keeps, bit for bit what ``--learning template`` makes of the same images."""
    traverses = [encoded(seed=view) for view in range(views)] + [encoded(seed=view, noise=0.5) for view in range(views)]
    traverses = [dataclasses.replace(one, names=traverses[0].names) for one in traverses]
    settings = {"views": {"shifts": views}, "network": {"neurons_per_place": 2.0}}
    made = template_of(train(traverses, small_config(**settings)), Pool(2))
    wanted = train(traverses, update(templates(), {"views": {"shifts": views}}))
    assert made.neurons == 8 * views
    np.testing.assert_array_equal(made.network.weights, wanted.network.weights)
    np.testing.assert_array_equal(made.network.bias, wanted.network.bias)
    np.testing.assert_array_equal(made.responses, wanted.responses)
    assert made.network.scalars == wanted.network.scalars
    assert made.stretches == wanted.stretches


def test_the_conductance_model_has_no_templates() -> None:
    with pytest.raises(ConfigError, match=r"^the baseline template needs an integer network"):
        template_of(train([encoded(inputs=784)], tiny_paper()))
