"""Settings check themselves and survive TOML."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lava_vpr import config as c
from lava_vpr import configfile as f
from lava_vpr.errors import ConfigError
from lava_vpr.inputs.encoder import INPUTS


@pytest.mark.parametrize("name", list(c.PRESETS))
def test_presets_survive_toml_and_dictionaries(name: str, tmp_path: Path) -> None:
    settings_ = c.preset(name)
    path = tmp_path / "a.toml"
    path.write_text(f.to_toml(settings_))
    assert f.read_toml(path) == settings_
    assert f.from_dict(f.to_dict(settings_)) == settings_


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.integers(0, 2**63 - 1), st.integers(1, 8), st.floats(0.01, 1000), st.sampled_from(list(INPUTS)))
def test_any_legal_change_survives(seed: int, bits: int, spikes: float, kind: str) -> None:
    changed = f.update(
        c.preset("loihi"),
        {"seed": seed, "network": {"weight_bits": bits}, "encoder": {"query_spikes": spikes, "kind": kind}},
    )
    assert f.from_dict(f.to_dict(changed)) == changed


def test_every_number_has_a_range() -> None:
    """NaN, and a number far outside, is refused for every numeric setting of every section."""
    for name in c.PRESETS:
        base = c.preset(name)
        for section in ("encoder", "network", "learning", "decoder"):
            part = getattr(base, section)
            for field in dataclasses.fields(part):
                value = getattr(part, field.name)
                if isinstance(value, float):
                    for bad in (float("nan"), float("inf")):
                        with pytest.raises(ConfigError, match=field.name):
                            dataclasses.replace(part, **{field.name: bad})
                if isinstance(value, (int, float)):
                    with pytest.raises(ConfigError):
                        dataclasses.replace(part, **{field.name: -(10**9)})
                elif isinstance(value, str):
                    with pytest.raises(ConfigError, match=field.name):
                        dataclasses.replace(part, **{field.name: "nonsense"})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[network]\nneuron = 5\n", r"network\.neuron is not a setting; known are model, neurons"),
        ("[nets]\nneurons = 5\n", r"'nets' is not a setting"),
        ("[network]\nweight_bits = 9\n", r"network\.weight_bits is 9, but must be in \[1, 8\]"),
        ("[network]\nweight_bits = 3.5\n", r"network\.weight_bits is 3\.5, but must be of type int"),
        ("[network]\nweight_bits = true\n", r"must be of type int"),
        ("network = 3\n", r"\[network\] must be a table"),
        ("seed = -1\n", r"seed is -1"),
        ("preset = 'fastest'\n", r"no preset 'fastest'; choose from loihi, fast, paper"),
        ("preset = 3\n", r"preset is 3"),
        ("[encoder]\nimage_size = 57\n", r"image_size is 57, but must be a multiple of 4"),
        ("[learning]\nrule = 'triplet'\n", r"learning\.rule is 'triplet'"),
        ("preset = 'paper'\n[encoder]\nkind = 'onoff'\n", r"takes encoder\.kind 'pixels', not 'onoff'"),
        ("[network\n", r"not a TOML file"),
    ],
)
def test_errors_name_file_setting_and_range(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        f.read_toml(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_and_binary_files(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml: cannot be read \(No such file"):
        f.read_toml(tmp_path / "none.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not a TOML file"):
        f.read_toml(tmp_path / "b.toml")


def test_mixed_models_are_refused() -> None:
    with pytest.raises(ConfigError, match="does not go with"):
        c.Config(network=c.ConductanceNetwork())


def test_neurons_follow_the_places_unless_given() -> None:
    base = c.preset("loihi")
    assert base.neurons_for(37) == round(37 * base.network.neurons_per_place)
    assert f.update(base, {"network": {"neurons": 12}}).neurons_for(37) == 12
