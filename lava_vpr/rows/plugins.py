"""Rows of registries that installed packages bring, found by their entry points.

A package names a row in an entry-point group such as ``lava_vpr.decoders``; `lava_vpr.rows.registry` asks for the
names of the group here, and loads a row when it is asked for. The entry points of all packages are read once in a
process, and only when a name is asked for that is not built in, or all names are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from importlib.metadata import Distribution, EntryPoint

PREFIX = "lava_vpr."
"""How the names of our entry-point groups begin."""


@dataclass(frozen=True)
class Plugin:
    """A row that a package brings, not yet loaded.

    Attributes:
        group: The entry-point group, such as ``lava_vpr.decoders``.
        name: The row's name.
        package, version: Of the distribution that brings it.
        entry: Its entry point.
    """

    group: str
    name: str
    package: str
    version: str
    entry: EntryPoint

    @property
    def origin(self) -> str:
        """Where it is from, for messages."""
        return f"the package {self.package} {self.version}"

    def load(self) -> Any:
        """The object that the entry point names.

        Raises:
            PluginError: it cannot be had, whatever the package does.
        """
        try:
            return self.entry.load()
        except (Exception, SystemExit) as error:  # whatever a package of somebody does when it is imported
            cause = " ".join(f"{type(error).__name__}: {error}".split())[:200]
            raise PluginError(f"cannot be loaded ({cause})") from error


class PluginError(Exception):
    """A plug-in that cannot be used; the message says why, as in "cannot be loaded (ImportError: ...)"."""


@lru_cache(maxsize=1)
def _scanned() -> dict[str, tuple[Plugin, ...]]:
    """The plug-ins of each of our groups, in the order of package and name."""
    from importlib.metadata import distributions  # most commands need no more than what is built in

    found: dict[str, dict[tuple[str, str], Plugin]] = {}
    for distribution in distributions():
        for plugin in _brought(distribution):
            found.setdefault(plugin.group, {}).setdefault((plugin.package, plugin.name), plugin)
    return {group: tuple(plugin for _, plugin in sorted(rows.items())) for group, rows in found.items()}


def _brought(distribution: Distribution) -> list[Plugin]:
    """What a distribution brings; nothing where its metadata cannot be read."""
    try:
        if PREFIX not in (distribution.read_text("entry_points.txt") or ""):
            return []
        package, version = distribution.metadata["Name"] or "?", distribution.version or "?"
        entries = [entry for entry in distribution.entry_points if entry.group.startswith(PREFIX)]
        return [Plugin(entry.group, entry.name, package, version, entry) for entry in entries]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def plugins(group: str) -> tuple[Plugin, ...]:
    """The plug-ins of ``group`` in the order of package and name; nothing of them is loaded."""
    return _scanned().get(group, ())


def rescan() -> None:
    """Forget what was found, where packages have been installed since."""
    _scanned.cache_clear()
