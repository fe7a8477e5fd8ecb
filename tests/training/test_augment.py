"""Without lava-dl one line says what to install; and the changes that references are shown with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.common.small_models import encoded, small_config

from lava_vpr.cli import main
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.errors import ConfigError
from lava_vpr.inputs.augment import AugmentConfig, augmented, shifted
from lava_vpr.inputs.encoder import ChannelLayout
from lava_vpr.slayer import needs
from lava_vpr.synthetic import write_traverses
from lava_vpr.training.loop import check_size, train

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
