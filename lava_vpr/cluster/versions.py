"""What must be the same wherever and whenever tasks run, for their results to be: this package, Python, packages."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from lava_vpr import __version__

COMPUTES = ("numpy", "numba", "scipy", "opencv-python-headless")
"""Packages whose versions can change a result."""


def that_compute() -> Mapping[str, str]:
    """Versions of Python, and of the packages that compute, by name."""
    return {"Python": platform.python_version()} | {name: version(name) for name in COMPUTES}


@cache
def here() -> Mapping[str, str]:
    """Versions by name that a cluster's machines must share: of this package with a hash of its source, those of
    `that_compute`, and of what machines talk with."""
    own = {"lava-vpr": f"{__version__} ({_source()})"}
    return {**own, **that_compute(), "distributed": version("distributed")}


def _source() -> str:
    """A hash of the package's modules, 12 digits: two checkouts of one version are not the same program."""
    modules: dict[str, Path] = {}
    for name in ("", "processes", "deploy"):  # the last two stand beside the package in a checkout, in it elsewhere
        spec = find_spec(f"lava_vpr.{name}".rstrip("."))
        for root in spec.submodule_search_locations or () if spec is not None else ():
            found = {path.relative_to(root).as_posix(): path for path in Path(root).rglob("*.py")}
            modules |= {f"{name}/{own}".lstrip("/"): path for own, path in found.items()}
    digest = hashlib.sha256()
    for own, path in sorted(modules.items()):
        digest.update(own.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:12]


def difference(ours: Mapping[str, str], theirs: Mapping[str, str]) -> str | None:
    """What differs, in words: ``numpy 1.26.4, here 1.26.3``; None if nothing does."""
    named = [f"{name} {theirs.get(name, 'none')}, here {own}" for name, own in ours.items() if theirs.get(name) != own]
    return "; ".join(named) or None
