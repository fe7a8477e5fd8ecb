"""Custom Lava Processes, in folders with a ``process.py`` each (import as `lava_vpr.processes`).

``from lava_vpr.processes import PoissonEncoder, PlaceNetwork``: every Process can be imported from here; Lava itself is
imported only when one is. docs/lava.md lists them. A ``process.py`` has a Process and its models, or some of a kind;
the folder's ``__init__.py`` names them as ``PROCESSES``.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any

from lava_vpr.processes.base.lava_checks import require_lava

_MODULES: dict[str, str] = {
    name: f"{entry.name}.process"
    for entry in pkgutil.walk_packages(__path__, f"{__name__}.")
    if entry.ispkg
    for name in getattr(importlib.import_module(entry.name), "PROCESSES", ())
}
"""The module that defines each Process, by the Process's name: every folder below this one has its own."""

__all__ = list(_MODULES)


def __getattr__(name: str) -> Any:
    """The class of the Process called ``name``, imported when it is asked for.

    Raises:
        AttributeError: there is none.
        BackendUnavailableError: Lava cannot run here; the line says what to install.
    """
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    require_lava()
    return getattr(importlib.import_module(_MODULES[name]), name)
