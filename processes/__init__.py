"""Custom Lava Processes, in folders with a ``process.py`` each (import as `lava_vpr.processes`).

``from lava_vpr.processes import PoissonEncoder, PlaceNetwork``: every Process can be imported from here; Lava itself is
imported only when one is. docs/lava.md lists them. A ``process.py`` has a Process and its models, or some of a kind;
the folder's ``__init__.py`` names them as ``PROCESSES``.
"""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType
from typing import Any

from lava_vpr.processes.base.lava_checks import require_lava


def _process_modules(package: ModuleType | None = None) -> dict[str, str]:
    """The module that defines each Process, by the Process's name: every folder below this one is asked for its own."""
    path, name = (__path__, __name__) if package is None else (package.__path__, package.__name__)
    modules: dict[str, str] = {}
    for entry in pkgutil.iter_modules(path, f"{name}."):
        if entry.ispkg:
            folder = importlib.import_module(entry.name)
            named = getattr(folder, "PROCESSES", None)
            modules |= dict.fromkeys(named, f"{entry.name}.process") if named else _process_modules(folder)
    return modules


_MODULES = _process_modules()

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
