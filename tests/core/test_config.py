"""Settings check themselves and survive TOML."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli
from hypothesis import assume, given, settings, strategies as st
from support.common.commands import fails
from support.common.small_models import paper_model, small_model, tiny_paper

from lava_vpr import config as c, configfile as f
from lava_vpr.config import as_integer_config, integer_config, preset
from lava_vpr.errors import ConfigError
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.matching.decoders import DECODERS
from lava_vpr.model import as_integer, integer_model
from lava_vpr.settings.conductance import ConductanceNetwork
from lava_vpr.settings.ranges import Declared, Range, declared


@pytest.mark.parametrize("name", list(c.PRESETS))
def test_presets_survive_toml_and_dictionaries(name: str, tmp_path: Path) -> None:
    settings_ = c.preset(name)
    path = tmp_path / "a.toml"
    path.write_text(f.to_toml(settings_))
    assert f.read_toml(path) == settings_
    path.write_text(path.read_text(), encoding="utf-8-sig")  # as Notepad writes it
    assert f.read_toml(path) == settings_
    assert f.from_dict(f.to_dict(settings_)) == settings_


def test_numbers_of_numpy_survive_too() -> None:
    plain = c.preset("loihi")
    encoder = dataclasses.replace(plain.encoder, cell=np.int64(4), blur=np.float32(0.5))
    changed = dataclasses.replace(plain, encoder=encoder, seed=np.int64(7))
    assert json.loads(json.dumps(f.to_dict(changed)))["encoder"]["blur"] == 0.5
    assert f.from_dict(f.to_dict(changed)) == changed
    assert type(changed.seed) is int


NAMES = {"kind": st.sampled_from(list(INPUTS)), "default": st.sampled_from(list(DECODERS))}
"""Texts that name rows of registries, or are made by learning."""


def fitting(name: str, setting: Declared) -> st.SearchStrategy[Any]:
    """Values that the declaration of the setting ``name`` allows."""
    if setting.words:
        return st.sampled_from(setting.words)
    if setting.range is None:
        return st.booleans() if setting.kind is bool else NAMES.get(name, st.just("loihi"))
    return numbers(setting.kind, setting.range)


def numbers(kind: type, of: Range) -> st.SearchStrategy[Any]:
    """Numbers of a range, its ends among them."""
    if kind is int:
        return st.one_of(st.sampled_from(list(ends(of))), st.integers(int(of.least), int(of.most)).filter(of.fits))
    open_least, open_most = of.without in ("least", "both"), of.without in ("most", "both")
    return st.floats(float(of.least), float(of.most), exclude_min=open_least, exclude_max=open_most)


def ends(of: Range) -> Iterator[int]:
    """The whole numbers next to the ends of a range that belong to it."""
    for end, way in ((int(of.least), 1), (int(of.most), -1)):
        yield next(n for n in range(end, end + way * 100, way) if of.holds(n) and of.fits(n))


def beyond(setting: Declared) -> Iterator[object]:
    """Values that the declaration of a setting does not allow, the next to its ends first."""
    of, whole = setting.range, setting.kind is int
    if of is not None:
        least, most = (int(of.least), int(of.most)) if whole else (float(of.least), float(of.most))
        yield least if of.without in ("least", "both") else least - 1 if whole else math.nextafter(least, -math.inf)
        yield most if of.without in ("most", "both") else most + 1 if whole else math.nextafter(most, math.inf)
        yield from (4,) if of.only == "odd" else (12,) if of.only else ()
        yield from (5.5,) if whole else ()
        yield from (math.nan, math.inf, -math.inf, 10**400, -(10**400))
    yield from ("nonsense",) if setting.words or setting.kind is not str else ()
    yield from (None, [5], {"a": 1})
    yield from () if setting.kind is bool else (True,)
    yield from (1,) if setting.kind is bool or setting.kind is str else ()


@st.composite
def changed(draw: st.DrawFn, section: Any) -> Any:
    """``section`` with some settings changed to others that its declarations allow, where these go together."""
    settings = declared(type(section))
    names = draw(st.lists(st.sampled_from([n for n in settings if n != "preset"]), max_size=4, unique=True))
    try:
        return dataclasses.replace(section, **{name: draw(fitting(name, settings[name])) for name in names})
    except ConfigError:
        assume(False)


@st.composite
def configs(draw: st.DrawFn) -> c.Config:
    """Settings within all ranges, from any preset."""
    base = draw(changed(c.preset(draw(st.sampled_from(list(c.PRESETS))))))
    parts = [field.name for field in dataclasses.fields(base) if field.name not in declared(c.Config)]
    names = draw(st.lists(st.sampled_from(parts), min_size=1, max_size=3, unique=True))
    try:
        return dataclasses.replace(base, **{name: draw(changed(getattr(base, name))) for name in names})
    except ConfigError:
        assume(False)
        raise


@settings(max_examples=150, deadline=None, derandomize=True)
@given(configs())
def test_settings_within_their_ranges_are_equal_when_they_are_read_again(config: c.Config) -> None:
    assert f.from_dict(f.to_dict(config)) == config
    assert f.from_dict(tomli.loads(f.to_toml(config))) == config


SECTIONS = f.sections()
SETTINGS = [(section, name) for section in SECTIONS for name in declared(section)]


@pytest.mark.parametrize(("section", "name"), SETTINGS, ids=[f"{s.__name__}-{n}" for s, n in SETTINGS])
def test_what_a_setting_declares_is_what_it_takes(section: type, name: str) -> None:
    """Whoever makes the settings, by TOML or in Python: one line with the name, the value and the range."""
    setting, called = declared(section)[name], f"{SECTIONS[section]}.{name}".removeprefix(".")
    line = rf"^{called} is [^\n]*, but must be [^\n]*; change it in the options"
    if setting.kind is not str or setting.words:
        for value in beyond(setting):
            with pytest.raises(ConfigError, match=line):
                section(**{name: value})


LEAST = {"image_size": {"cell": 1}, "cell": {"image_size": 512}, "weight_bits": {"signed": False}}
LEAST |= {"w_max": {"mean_weight": 1e-9, "start_weight": 1e-9}, "start_weight": {"w_max": 1000.0}}
LEAST |= {"shifts": {"shift": 0.0}, "mean_weight": {"w_max": 1000.0}}
"""Other settings with which the ends of a setting's range go together."""


@pytest.mark.parametrize(("section", "name"), SETTINGS, ids=[f"{s.__name__}-{n}" for s, n in SETTINGS])
def test_the_ends_of_a_range_are_taken(section: type, name: str) -> None:
    of = declared(section)[name].range
    for end in ends(of) if of is not None else ():
        others = {key: value for key, value in LEAST.get(name, {}).items() if key in declared(section)}
        assert getattr(section(**{name: end, **others}), name) == end


def test_every_number_declares_a_range() -> None:
    for section in SECTIONS:
        for name, setting in declared(section).items():
            assert (setting.range is not None) == (setting.kind in (int, float)), (section, name)
            assert section.__dataclass_fields__[name].default is not dataclasses.MISSING


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[network]\nneuron = 5\n", r"network\.neuron is not a setting; known are model, neurons"),
        ("[nets]\nneurons = 5\n", r"'nets' is not a setting"),
        ("[network]\nweight_bits = 9\n", r"network\.weight_bits is 9, but must be in \[1, 7\]"),
        ("[network]\nweight_bits = 8\n", r"network\.weight_bits is 8, but must be in \[1, 7\]"),
        ("[network]\nsigned = false\nweight_bits = 9\n", r"network\.weight_bits is 9, but must be in \[1, 8\]"),
        ("[network]\nsigned = 1\n", r"network\.signed is 1, but must be true or false"),
        ("[network]\nsteps = 60\n", r"network\.steps is 60, but must be a power of two"),
        ("[network]\ntrains = 'random'\n", r"network\.trains is 'random', but must be poisson or regular"),
        (
            "[network]\ntrains = 'poisson'\ninput_mode = 'bias'\n",
            r"network\.trains is 'poisson', but must be regular where input_mode is bias",
        ),
        ("[network]\ncommon = 1.0\n", r"network\.common is not a setting; known are model, neurons"),
        ("[network]\nweight_bits = 3.5\n", r"network\.weight_bits is 3\.5, but must be a whole number"),
        ("[network]\nweight_bits = true\n", r"must be a whole number"),
        ("network = 3\n", r"\[network\] must be a table"),
        ("seed = -1\n", r"seed is -1"),
        ("preset = 'fastest'\n", r"no preset 'fastest'; choose from loihi, balanced, fast, accurate, paper"),
        ("preset = 3\n", r"preset is 3"),
        ("[encoder]\nimage_size = 57\n", r"image_size is 57, but must be a multiple of 4"),
        ("[learning]\nrule = 'triplet'\n", r"learning\.rule is 'triplet'"),
        ("preset = 'paper'\n[encoder]\nkind = 'onoff'\n", r"takes encoder\.kind 'pixels', not 'onoff'"),
        (
            "[encoder]\nkind = 'frontend-events'\n[events]\nimage = 'surface'\n",
            r"encoder\.kind 'frontend-events' takes numbers of events; set events\.image to counts",
        ),
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


HOSTILE: dict[str, tuple[bytes, str]] = {
    "deep array": (b"a = " + b"[" * 50_000, "line of 50,004 characters"),
    "deep over lines": (b"a = " + b"[\n" * 20_000, "nested too deeply|not a TOML file"),
    "deep table": (b"a = " + b"{a=" * 300, "not a TOML file"),
    "digits": (b"seed = " + b"9" * 900, "seed is a number of 2990 bits"),
    "hexadecimal": (b"seed = 0x" + b"f" * 900, "seed is a number of 3600 bits"),
    "many digits": (b"seed = " + b"9" * 10_000, "line of 10,007 characters"),
    "dots": (b"a" + b".a" * 20_000 + b" = 1", "line of 40,005 characters"),
    "long key": (b"x" * 900 + b" = 1", "'xxxxx.*' is not a setting"),
    "escape in a key": (b'[network]\n"\\u001b[31m" = 1', r"network\.'.x1b\[31m' is not a setting"),
    "NUL": (b"seed = 1\0", "not a TOML file"),
    "NUL in a name": (b'preset = "a\\u0000b"', r"no preset 'a.x00b'"),
    "not UTF-8": (b'preset = "\xff"', "not a TOML file"),
    "NaN": (b"[network]\nthreshold = nan", r"network\.threshold is nan, but must be a number in"),
    "infinite": (b"[learning]\neta = inf", r"learning\.eta is inf, but must be a number in"),
    "large": (b"[learning]\neta = " + b"9" * 400, r"learning\.eta is a number of 1329 bits, but must be a number"),
    "date": (b"seed = 2020-01-01", r"seed is datetime\.date\(2020, 1, 1\), but must be a whole number"),
    "array": (b"[network]\nsteps = [1]", r"network\.steps is \[1\], but must be a whole number"),
    "table": (b"[network.model]\na = 1", r"network\.model is \{'a': 1\}, but must be text"),
    "array of tables": (b"[[network]]\nsteps = 1", r"\[network\] must be a table of settings, not \[\{'steps': 1\}\]"),
    "10^9 steps": (b"[network]\nsteps = 1000000000", r"network\.steps is 1000000000, but must be in \[4, 65536\]"),
    "10^9 epochs": (b"[learning]\nepochs = 1000000000", r"learning\.epochs is 1000000000, but must be in"),
    "no end of refractoriness": (b"preset = 'paper'\n[network]\ntimer_rate = 1e-300", r"in \[0\.001, 1\]"),
    "huge": (b"#" * 70_000, r"has 70,000 bytes, more than the 65,536 allowed; .* set LAVA_VPR_MAX_CONFIG_BYTES"),
}


@pytest.mark.timeout(30)
@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_gets_one_line(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data, message = HOSTILE[name]
    monkeypatch.chdir(tmp_path)
    Path("bad.toml").write_bytes(data)
    said = fails("train", "no", "-o", "m.lvpr", "--config", "bad.toml")
    assert said.startswith("bad.toml: ")
    assert re.search(message, said), said
    assert len(said) < 480


@pytest.mark.timeout(20)
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.toml")
    with pytest.raises(ConfigError, match=r"a\.toml: cannot be read \(is a named pipe, not a file\); give an existing"):
        f.read_toml(tmp_path / "a.toml")


def test_missing_and_binary_files(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml: cannot be read \(No such file"):
        f.read_toml(tmp_path / "none.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not a TOML file"):
        f.read_toml(tmp_path / "b.toml")


def test_mixed_models_are_refused() -> None:
    with pytest.raises(ConfigError, match="does not go with"):
        c.Config(network=ConductanceNetwork())


def test_neurons_follow_the_places_unless_given() -> None:
    base = c.preset("loihi")
    assert base.neurons_for(37) == round(37 * base.network.neurons_per_place)
    assert f.update(base, {"network": {"neurons": 12}}).neurons_for(37) == 12


@pytest.mark.parametrize("name", ["loihi", "fast"])
def test_integer_settings_pass(name: str) -> None:
    config = preset(name)
    assert integer_config(config, "a test") is config
    assert as_integer_config(config) is config


def test_an_integer_model_passes() -> None:
    model = small_model()
    assert integer_model(model, "a test") is model
    assert as_integer(model) is model


def test_the_float_model_is_refused_with_cause_and_remedy() -> None:
    text = (
        "a board needs an integer network, but preset paper is the float conductance model; train with "
        "--preset loihi, or run this one with --backend host or lava-float"
    )
    model = paper_model(4)
    for path, message in ((None, text), (Path("p.lvpr"), f"p.lvpr: {text}")):
        for ask, asked in ((integer_config, model.config), (integer_model, model)):
            with pytest.raises(ConfigError) as caught:
                ask(asked, "a board", path)  # type: ignore[operator]
            assert str(caught.value) == message
    assert as_integer_config(model.config) is None
    assert as_integer(model) is None


def test_settings_and_network_must_both_be_of_integers() -> None:
    with pytest.raises(ConfigError, match="needs an integer network"):
        integer_model(replace(small_model(), config=tiny_paper()), "a test")


def test_models_of_before_without_learned_filters_are_read_and_those_with_them_refused() -> None:
    config = preset("fast")
    before = f.to_dict(config)
    before["encoder"]["filters"] = ""
    assert f.of_file(before) == config
    before["encoder"]["filters"] = "AAAA"
    with pytest.raises(ConfigError, match=r"^encoder\.filters: no input learns filters any more; train again with"):
        f.of_file(before)


@pytest.mark.parametrize(("name", "steps"), [("loihi", 45), ("fast", 29)])
def test_each_preset_has_a_front_end_of_its_own_which_models_of_before_lack(name: str, steps: int) -> None:
    """Files say how long it is; before they did, all had 52 steps. What has none says nothing of it."""
    config = f.update(preset(name), {"encoder": {"kind": "frontend"}})
    assert config.encoder.front_end is not None
    assert config.encoder.front_end.steps == steps
    written = f.to_dict(config)
    assert f.of_file(written) == f.from_dict(written) == config
    for setting in f.FRONT_END_BEFORE:
        del written["encoder"][setting]
    before = f.of_file(written).encoder.front_end
    assert before is not None
    assert before.steps == 52
    assert not set(f.FRONT_END_BEFORE) & set(f.to_dict(preset(name))["encoder"])
    other = f.update(preset(name), {"encoder": {"pixel_levels": 20}})
    assert f.from_dict(f.to_dict(other)) == other
