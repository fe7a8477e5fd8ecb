"""The gate for settings: asks for those of an integer network, and refuses the float conductance model's.

`lava_vpr.model.integer_model` asks the same of a trained model, with the same words.
"""

from __future__ import annotations

from pathlib import Path
from typing import cast

from lava_vpr.config import Config, LifNetwork, StdpLearning
from lava_vpr.errors import ConfigError


class IntegerConfig(Config):
    """The settings of an integer network, as `integer_config` returns them.

    Only type checkers see this class: what passes the gate stays the `Config` that it is.
    """

    network: LifNetwork
    learning: StdpLearning


def as_integer_config(config: Config) -> IntegerConfig | None:
    """``config`` itself if it describes an integer network, else None."""
    integer = isinstance(config.network, LifNetwork) and isinstance(config.learning, StdpLearning)
    return cast(IntegerConfig, config) if integer else None


def integer_config(config: Config, purpose: str, path: Path | None = None) -> IntegerConfig:
    """``config`` itself, seen to describe an integer network.

    Args:
        config: The settings.
        purpose: What needs an integer network; the message begins with it.
        path: The file that the settings are from, if it is known.
    Raises:
        ConfigError: the settings are those of the float conductance model.
    """
    settings = as_integer_config(config)
    if settings is None:
        raise not_integer(purpose, path)
    return settings


def not_integer(purpose: str, path: Path | None = None) -> ConfigError:
    """The refusal of a float model by what needs an integer network; see `integer_config`."""
    file = "" if path is None else f"{path}: "
    return ConfigError(
        f"{file}{purpose} needs an integer network, but preset paper is the float conductance model; train with "
        "--preset loihi, or run this one with --backend host or lava-float"
    )
