"""lava-vpr: visual place recognition with spiking networks on Intel's Loihi.

`train` learns the places of a route, `load` reads a model, and a `Localizer` locates a robot, image by image. These
names are stable; everything else may change between versions.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from lava_vpr import kernelcache

if TYPE_CHECKING:
    from lava_vpr.errors import LavaVprError
    from lava_vpr.learning.route import train
    from lava_vpr.localizer import Localizer, load
    from lava_vpr.matches import Candidate, Match

_ROOMS = {"LavaVprError": "errors", "Candidate": "matches", "Match": "matches", "train": "learning.route"}
__all__ = ["Candidate", "LavaVprError", "Localizer", "Match", "__version__", "load", "train"]

__version__ = "0.1.0"

kernelcache.prepare()


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that the command line starts without it."""
    if name in __all__:
        room = _ROOMS.get(name, "localizer")
        return getattr(importlib.import_module(f"lava_vpr.{room}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
