"""Whether lava-dl and torch are here, asked without importing either; and both, imported by who learns."""

from __future__ import annotations

import contextlib
import io
import logging
import sys
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any, NamedTuple

from lava_vpr.errors import ConfigError


def missing() -> str | None:
    """What learning by SLAYER lacks here, or None."""
    if sys.version_info[:2] != (3, 10):
        return f"this is Python {sys.version_info[0]}.{sys.version_info[1]}, and lava-dl runs under 3.10 alone"
    for package in ("torch", "lava.lib.dl"):
        try:
            found = find_spec(package) is not None
        except ModuleNotFoundError:  # nor is its parent here
            found = False
        if not found:
            return f"{'lava-dl' if package != 'torch' else package} is not installed"
    return None


def require() -> None:
    """Refuse to learn without lava-dl.

    Raises:
        ConfigError: naming what is missing and how to install it.
    """
    reason = missing()
    if reason is not None:
        raise ConfigError(
            f"learning by SLAYER needs lava-dl: {reason}; install lava-vpr with its extra, pip install "
            "'lava-vpr[dl]' (Python 3.10, 6 GB with torch), or use --learning float"
        )


class Libraries(NamedTuple):
    """The modules ``torch`` and ``lava.lib.dl.slayer``."""

    torch: Any
    slayer: Any


@cache
def libraries() -> Libraries:
    """Both, imported without the greetings that they print; torch takes deterministic algorithms only."""
    logging.disable(logging.WARNING)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            found = Libraries(import_module("torch"), import_module("lava.lib.dl.slayer"))
    finally:
        logging.disable(logging.NOTSET)
    found.torch.use_deterministic_algorithms(True)
    return found
