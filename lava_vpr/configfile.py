"""Settings as dictionaries and TOML files, in and out; unknown names and wrong types are refused."""

from __future__ import annotations

import dataclasses
import typing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli
import tomli_w

from lava_vpr.config import PRESETS, Config, LifNetwork, preset
from lava_vpr.errors import ConfigError, brief, said, shown
from lava_vpr.settings.ranges import CHANGE_IT, KINDS, declared, need, whole
from lava_vpr.storage.reading import read_bytes

FRONT_END_BEFORE = {"pixel_levels": 32, "race_steps": 15}
"""Settings of the encoder that older files lack, and what they were then."""
OF_DIRECT = ("direct_levels", "direct_race", "read_steps", "read_threshold", "read_inhibition")
"""Settings of the encoder for neurons that hear the cells themselves, which other files lack."""
_LONGEST_LINE, _LONGEST_NAME = 1000, 60


def to_dict(config: Config) -> dict[str, Any]:
    """``config`` as nested plain dictionaries, ready for TOML or JSON; without what is off and older files lack."""

    made = dataclasses.asdict(
        config, dict_factory=lambda items: {k: v.item() if isinstance(v, np.generic) else v for k, v in items}
    )
    if made["network"].get("surroundings") == 0:
        del made["network"]["surroundings"]
    own = PRESETS.get(config.preset, Config()).encoder
    unused = () if config.encoder.front_end is not None else tuple(FRONT_END_BEFORE)
    for name in unused + (() if config.encoder.direct is not None else OF_DIRECT):
        if made["encoder"][name] == getattr(own, name):
            del made["encoder"][name]
    return made


def _named(section: str, key: str) -> str:
    """The setting ``key`` of a file, whatever it is, for a message."""
    return f"{section}.{key}" if key.isidentifier() and len(key) <= _LONGEST_NAME else f"{section}.{brief(key)}"


def _section(base: Any, values: object, name: str) -> Any:
    """Dataclass ``base`` with the settings in ``values`` replaced, unknown names refused."""
    if not isinstance(values, dict):
        raise ConfigError(f"[{name}] must be a table of settings, not {brief(values)}")
    kind: type = type(base)
    known, changes = declared(kind), {}
    for key, value in values.items():
        if key not in known:
            raise ConfigError(f"{_named(name, key)} is not a setting; known are {', '.join(known)}")
        if known[key].kind is float and whole(value):
            need(abs(value) < 2**53, f"{name}.{key}", value, KINDS[float])
            value = float(value)
        changes[key] = value
    return replace(base, **changes)


_TOP = declared(Config)
_SECTIONS = tuple(field.name for field in dataclasses.fields(Config) if field.name not in _TOP)


def sections() -> dict[type, str]:
    """Every dataclass of settings, and how files call its section; `Config` itself stands in none."""
    hints = typing.get_type_hints(Config)
    return {Config: ""} | {part: name for name in _SECTIONS for part in typing.get_args(hints[name]) or [hints[name]]}


def update(base: Config, values: dict[str, Any]) -> Config:
    """``base`` with the (nested) settings in ``values`` replaced.

    Raises:
        ConfigError: an unknown setting, a wrong type or a value outside its range.
    """
    changes: dict[str, Any] = {}
    for key, value in values.items():
        if key in _SECTIONS:
            changes[key] = _section(getattr(base, key), value, key)
        elif key in _TOP:
            changes[key] = value
        else:
            raise ConfigError(f"{brief(key)} is not a setting; known are {', '.join(_TOP)}, [{'], ['.join(_SECTIONS)}]")
    return replace(base, **changes)


def from_dict(values: Any) -> Config:
    """The inverse of `to_dict`; starts from the preset that ``values`` names (default ``loihi``).

    Raises:
        ConfigError: no dictionary, or as `update`.
    """
    if not isinstance(values, dict):
        raise ConfigError(f"the settings must be a table, not {brief(values)}")
    name = values.get("preset", "loihi")
    if not isinstance(name, str):
        raise ConfigError(f"preset is {brief(name)}, but must be a name; {CHANGE_IT}")
    return update(preset(name), values)


def of_file(values: Any) -> Config:
    """As `from_dict`, of settings that are a model's: what older ones lack is off, whatever the preset has now."""
    if isinstance(values, dict) and isinstance(encoder := values.get("encoder"), dict) and "filters" in encoder:
        if encoder["filters"] != "":
            raise ConfigError("encoder.filters: no input learns filters any more; train again with --input frontend")
        values = values | {"encoder": {name: value for name, value in encoder.items() if name != "filters"}}
    config = from_dict(values)
    if isinstance(config.network, LifNetwork) and "adapt" not in values.get("network", {}):
        config = replace(config, network=replace(config.network, adapt=0))
    if config.encoder.front_end is not None:
        before: dict[str, Any] = {
            name: size for name, size in FRONT_END_BEFORE.items() if name not in values.get("encoder", {})
        }
        config = replace(config, encoder=replace(config.encoder, **before))
    return config


def read_toml(path: Path, base: Config | None = None) -> Config:
    """Settings from a TOML file, over ``base`` (default: the preset that the file names).

    Raises:
        ConfigError: the file is missing, no TOML, or holds a setting that is unknown or out of range.
    """
    values = _toml(path)
    try:
        if base is None:
            return from_dict(values)
        if values.get("preset", base.preset) != base.preset:
            raise ConfigError(
                f"preset is {brief(values['preset'])}, but --preset says {base.preset!r}; give one of them"
            )
        return update(base, values)
    except ConfigError as error:
        raise ConfigError(f"{shown(path)}: {error}") from None


def _toml(path: Path) -> dict[str, Any]:
    """What the TOML file at ``path`` says.

    Raises:
        ConfigError: the file is missing, too long, or no TOML.
    """
    try:
        text = read_bytes(path, "config_bytes").decode("utf-8-sig")
        # The parser takes time in proportion to the square of the dots in a key, and a key stands on one line.
        longest = max(len(line) for line in text.split("\n"))
        if longest > _LONGEST_LINE:
            raise ValueError(f"a line of {longest:,} characters, where settings have at most {_LONGEST_LINE:,}")
        return tomli.loads(text)
    except OSError as error:
        raise ConfigError(f"{shown(path)}: cannot be read ({error.strerror}); give an existing TOML file") from None
    except (ValueError, RecursionError) as error:  # of these are errors of UTF-8 and TOML, and too long numbers
        cause = "nested too deeply" if isinstance(error, RecursionError) else said(error)
        raise ConfigError(f"{shown(path)}: not a TOML file ({cause}); see docs/configuration.md") from None


def to_toml(config: Config) -> str:
    """``config`` as TOML text that `read_toml` reads back to the equal value."""
    return tomli_w.dumps(to_dict(config))
