"""Settings as dictionaries and TOML files, in and out; unknown names and wrong types are refused."""

from __future__ import annotations

import dataclasses
import typing
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomli
import tomli_w

from lava_vpr.config import Config, preset
from lava_vpr.errors import ConfigError, brief
from lava_vpr.settings.ranges import CHANGE_IT
from lava_vpr.storage.reading import read_bytes
from lava_vpr.storage.text import harmless, shown

_TYPES: dict[str, tuple[type, str]] = {
    "int": (int, "a whole number"),
    "float": (float, "a number"),
    "str": (str, "text"),
    "bool": (bool, "true or false"),
}
"""What a setting's annotation asks of a value, and how a message says so."""
_LONGEST_LINE, _LONGEST_NAME = 1000, 60


def to_dict(config: Config) -> dict[str, Any]:
    """``config`` as nested plain dictionaries, ready for TOML or JSON."""
    return dataclasses.asdict(
        config, dict_factory=lambda items: {k: v.item() if isinstance(v, np.generic) else v for k, v in items}
    )


def _checked(value: object, annotation: Any, name: str) -> object:
    """The ``value`` of setting ``name`` as the annotated scalar type; what TOML typed differently is refused."""
    origin = typing.get_origin(annotation)
    if origin is Literal:
        return value  # __post_init__ says which words are allowed
    expected, words = _TYPES[getattr(annotation, "__name__", "str")]
    if expected is float and isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**53:
        return float(value)
    if not isinstance(value, expected) or (isinstance(value, bool) and expected is not bool):
        raise ConfigError(f"{name} is {brief(value)}, but must be {words}; {CHANGE_IT}")
    return value


def _named(section: str, key: str) -> str:
    """The setting ``key`` of a file, whatever it is, for a message."""
    return f"{section}.{key}" if key.isidentifier() and len(key) <= _LONGEST_NAME else f"{section}.{brief(key)}"


def _section(base: Any, values: object, name: str) -> Any:
    """Dataclass ``base`` with the settings in ``values`` replaced, unknown names refused."""
    if not isinstance(values, dict):
        raise ConfigError(f"[{name}] must be a table of settings, not {brief(values)}")
    hints = typing.get_type_hints(type(base))
    changes = {}
    for key, value in values.items():
        if key not in hints:
            raise ConfigError(f"{_named(name, key)} is not a setting; known are {', '.join(hints)}")
        changes[key] = _checked(value, hints[key], f"{name}.{key}")
    return replace(base, **changes)


_SECTIONS = ("encoder", "views", "events", "network", "learning", "slayer", "augment", "decoder")


def update(base: Config, values: dict[str, Any]) -> Config:
    """``base`` with the (nested) settings in ``values`` replaced.

    Raises:
        ConfigError: an unknown setting, a wrong type or a value outside its range.
    """
    changes: dict[str, Any] = {}
    for key, value in values.items():
        if key in _SECTIONS:
            changes[key] = _section(getattr(base, key), value, key)
        elif key in ("preset", "seed", "stretch"):
            changes[key] = _checked(value, {"preset": str, "seed": int, "stretch": int}[key], key)
        else:
            raise ConfigError(
                f"{brief(key)} is not a setting; known are preset, seed, stretch, [{'], ['.join(_SECTIONS)}]"
            )
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
        text = read_bytes(path, "config_bytes").decode("utf-8")
        # The parser takes time in proportion to the square of the dots in a key, and a key stands on one line.
        longest = max(len(line) for line in text.split("\n"))
        if longest > _LONGEST_LINE:
            raise ValueError(f"a line of {longest:,} characters, where settings have at most {_LONGEST_LINE:,}")
        return tomli.loads(text)
    except OSError as error:
        raise ConfigError(f"{shown(path)}: cannot be read ({error.strerror}); give an existing TOML file") from None
    except (ValueError, RecursionError) as error:  # of these are errors of UTF-8 and TOML, and too long numbers
        cause = "nested too deeply" if isinstance(error, RecursionError) else " ".join(str(error).split())[:200]
        raise ConfigError(f"{shown(path)}: not a TOML file ({harmless(cause)}); see docs/configuration.md") from None


def to_toml(config: Config) -> str:
    """``config`` as TOML text that `read_toml` reads back to the equal value."""
    return tomli_w.dumps(to_dict(config))
