"""Ways to learn are rows, templates among them, which learn nothing; and references that are changed at random."""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.common.small_models import encoded, paper_model, small_config, tiny_paper

from lava_vpr import model
from lava_vpr.cli import main
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.bundle.learning import chip_learning
from lava_vpr.engine.inference.quantise import unit_norm
from lava_vpr.engine.rates import training_rates
from lava_vpr.errors import ConfigError
from lava_vpr.inputs.encoder import ChannelLayout
from lava_vpr.inputs.views import AugmentConfig, augmented, shifted
from lava_vpr.slayer import needs
from lava_vpr.synthetic import write_traverses
from lava_vpr.training.loop import check_size, train
from lava_vpr.training.templates import template_of
from lava_vpr.training.trainers import CONDUCTANCE, LEARNING, TemplateTrainer, rule_of, rule_settings


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
    with pytest.raises(ConfigError, match=r"^learning on the chip takes rule stdp alone, not template; train with --"):
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
        template_of(paper_model())


@pytest.mark.parametrize("name", LEARNING)
def test_the_settings_of_a_rule_choose_it(name: str) -> None:
    for before in LEARNING:  # whatever was chosen before
        config = update(preset("loihi"), {"learning": rule_settings(before, preset("loihi"))})
        assert rule_of(update(config, {"learning": rule_settings(name, config)})) is LEARNING[name]


def test_the_conductance_model_has_a_way_of_its_own() -> None:
    assert rule_of(tiny_paper()) is CONDUCTANCE
    assert rule_settings("float", tiny_paper()) == {"arithmetic": "float"}


def test_a_rule_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []

    class Counting(TemplateTrainer):
        def begin_epoch(self, epoch: int) -> None:
            seen.append(epoch)

    row = replace(
        LEARNING["template"], name="counting", trainer=lambda config, stretch, key, _: Counting(config, stretch)
    )
    LEARNING.register(row)
    try:
        monkeypatch.setattr("lava_vpr.training.stretches.rule_of", lambda config: LEARNING["counting"])
        made = train([encoded()], small_config(learning={"epochs": 2}))
    finally:
        LEARNING.remove("counting")
    assert seen == [0, 1, 0, 1]  # two stretches
    assert made.places == 8


NOTHING = AugmentConfig(shift=0, contrast=0, illumination=0, noise=0, altered=0)


def test_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(needs, "find_spec", lambda name: None)
    monkeypatch.setattr(needs, "sys", type("Sys", (), {"version_info": (3, 10, 1)}))
    write_traverses(tmp_path, 4, 0)
    made = CliRunner().invoke(
        main, ["train", str(tmp_path / "reference"), "-o", str(tmp_path / "m"), "--learning", "slayer"]
    )
    assert made.exit_code == 1
    (line,) = made.output.strip().splitlines()
    assert "torch is not installed; install lava-vpr with its extra, pip install 'lava-vpr[dl]'" in line
    assert not (tmp_path / "m").exists()


@pytest.mark.parametrize(
    ("version", "installed", "said"),
    [((3, 12, 0), True, "this is Python 3.12, and lava-dl runs under 3.10 alone"), ((3, 10, 0), True, None)],
)
def test_what_is_missing(
    version: tuple[int, ...], installed: bool, said: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(needs, "sys", type("Sys", (), {"version_info": version}))
    monkeypatch.setattr(needs, "find_spec", lambda name: object())
    assert needs.missing() == said


def test_a_missing_parent_is_no_surprise(monkeypatch: pytest.MonkeyPatch) -> None:
    def find_spec(name: str) -> object:
        if name == "torch":
            return object()
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(needs, "sys", type("Sys", (), {"version_info": (3, 10, 0)}))
    monkeypatch.setattr(needs, "find_spec", find_spec)
    assert needs.missing() == "lava-dl is not installed"


def test_a_place_takes_one_neuron(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(needs, "missing", lambda: None)
    config = update(preset("loihi"), {"learning": {"rule": "slayer"}, "network": {"neurons_per_place": 1.5}})
    with pytest.raises(ConfigError, match=r"^learning\.rule slayer takes one neuron for each place, but 100 places"):
        check_size(100, config)


def test_only_slayer_may_learn_weights_below_0() -> None:
    """What another rule has learned has no sign: a file that says so is refused."""
    model = train([encoded()], small_config())
    assert model.learned.min() >= 0


def test_settings_are_checked() -> None:
    for section, values, said in (
        ("slayer", {"start": "zero"}, r"^slayer\.start is 'zero', but must be template or scratch"),
        ("slayer", {"rate": 0.0}, r"^slayer\.rate is 0\.0"),
        ("augment", {"altered": 1.5}, r"^augment\.altered is 1\.5"),
        ("augment", {"noise": -1.0}, r"^augment\.noise is -1\.0"),
        ("learning", {"rule": "hebb"}, r"^learning\.rule is 'hebb', but must be stdp, template or slayer"),
    ):
        with pytest.raises(ConfigError, match=said):
            update(preset("loihi"), {section: values})


def activity() -> np.ndarray:
    return np.random.default_rng(3).random((20, 50)).astype(np.float32)


def test_nothing_changes_where_nothing_is_asked_for() -> None:
    shown = activity()
    assert np.allclose(augmented(shown, ChannelLayout(2, 5), NOTHING, np.random.default_rng(0)), shown, atol=1e-6)


def test_every_change_changes() -> None:
    shown = activity()
    for name in ("shift", "contrast", "illumination", "noise", "altered"):
        config = AugmentConfig(**{**vars(NOTHING), name: 0.5})
        seen = augmented(shown, ChannelLayout(2, 5), config, np.random.default_rng(0))
        assert seen.min() >= 0, name
        assert np.isfinite(seen).all(), name
        assert np.mean(seen != shown) > 0.3, name
        again = augmented(shown, ChannelLayout(2, 5), config, np.random.default_rng(0))
        assert np.array_equal(seen, again), name


def test_altered_inputs_are_those_of_other_references() -> None:
    shown = activity()
    config = AugmentConfig(shift=0, contrast=0, illumination=0, noise=0, altered=1.0)
    seen = augmented(shown, ChannelLayout(2, 5), config, np.random.default_rng(0))
    assert all(np.isin(seen[:, j], shown[:, j]).all() for j in range(shown.shape[1]))


def test_a_shift_moves_columns_and_repeats_the_edge() -> None:
    layout = ChannelLayout(1, 4)
    image = np.tile(np.array([0.0, 10.0, 20.0, 30.0], np.float32), 4)[None]
    row = [shifted(image, layout, np.array([cells]))[0, :4] for cells in (1.0, -1.0, 0.25, 9.0)]
    assert np.array_equal(row[0], [10, 20, 30, 30])
    assert np.array_equal(row[1], [0, 0, 10, 20])
    assert np.allclose(row[2], [2.5, 12.5, 22.5, 30])
    assert np.array_equal(row[3], [30, 30, 30, 30])


def test_inputs_of_vectors_are_neither_shifted_nor_lit() -> None:
    activity = np.random.default_rng(1).random((4, 10)).astype(np.float32)
    config = AugmentConfig(shift=3, contrast=0, illumination=5, noise=0, altered=0)
    assert np.array_equal(augmented(activity, ChannelLayout(2, 3, 5), config, np.random.default_rng(0)), activity)
