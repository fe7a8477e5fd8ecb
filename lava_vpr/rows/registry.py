"""Registries: one table for each kind of thing that can be added, a row with everything that belongs to one of them.

A row is a frozen dataclass with a ``name``. What the code needs to know about a decoder, an input, a backend, a board
or a dataset is a field of its row, so nothing elsewhere asks for a name. That a row has every part, and of the right
type, is seen by its class and by type checkers.

An installed package brings rows by entry points, in a group such as ``lava_vpr.decoders``. The entry points of all
packages are read once in a process, and only when a name is asked for that is not built in, or all names are.
"""

from __future__ import annotations

import contextlib
import logging
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from lava_vpr.errors import LavaVprError, PluginError, brief
from lava_vpr.rows.guarded import PASSES, cause, guarded

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

PREFIX = "lava_vpr."
"""How the names of our entry-point groups begin."""


class Named(Protocol):
    """Every row has a name, by which users choose it."""

    @property
    def name(self) -> str:
        """The row's name, the key of its registry."""
        ...


Row = TypeVar("Row", bound=Named)


@dataclass(frozen=True)
class Plugin:
    """A row that a package brings, not yet loaded.

    Attributes:
        name: The row's name.
        package, version: Of the distribution that brings it.
        entry: Its entry point.
    """

    name: str
    package: str
    version: str
    entry: EntryPoint

    @property
    def origin(self) -> str:
        """Where it is from, for messages."""
        return f"the package {self.package} {self.version}"


@lru_cache(maxsize=1)
def scanned() -> list[Plugin]:
    """The plug-ins of all groups in the order of package and name, none of them loaded; kept until `cache_clear`."""
    from importlib.metadata import distributions  # most commands need no more than what is built in

    found: dict[tuple[str, str, str], Plugin] = {}
    for distribution in distributions():
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):  # metadata that cannot be read
            if PREFIX in (distribution.read_text("entry_points.txt") or ""):
                package, version = distribution.metadata["Name"] or "?", distribution.version or "?"
                for entry in distribution.entry_points:
                    plugin = Plugin(entry.name, package, version, entry)
                    found.setdefault((package, entry.name, entry.group), plugin)
    return [plugin for _, plugin in sorted(found.items(), key=lambda item: item[0])]


def plugged_names(group: str) -> tuple[str, ...]:
    """The names of all plug-ins of ``group``, none of them loaded."""
    return tuple(plugin.name for plugin in scanned() if plugin.entry.group == group)


def elsewhere(group: str | None) -> str:
    """What a message adds to the names there are: that a package may bring others; nothing without a group."""
    return "" if group is None else f", or install the package that has it among its entry points {group}"


class Registry(Mapping[str, Row], Generic[Row]):
    """The rows of one kind by name: those of this package in the order in which they were registered, then plug-ins.

    >>> @dataclass(frozen=True)
    ... class Board:
    ...     name: str
    ...     cores: int
    >>> BOARDS: Registry[Board] = Registry("board")
    >>> BOARDS.register(Board("kapoho-bay", cores=256))

    With a ``group``, installed packages bring rows, too. A name that is built in is looked up
    without them, and nothing of a package is imported before its row is asked for by name, or all rows are. One that
    cannot be used is left out with a warning, and is an error where it is asked for by name. Whatever fails in one that
    is used is a `PluginError` (`lava_vpr.rows.guarded`).

    Args:
        kind: What a row is, one word for messages: "decoder", "board".
        error: The error that says that no row has a name.
        group: Entry-point group of rows from other packages; None: there are none.
        row_class: What such a row must be an instance of.
    """

    def __init__(
        self,
        kind: str,
        error: type[LavaVprError] = LavaVprError,
        *,
        group: str | None = None,
        row_class: type[Any] = object,
    ) -> None:
        self.kind = kind
        self.group = group
        self._error = error
        self._row_class = row_class
        self._rows: dict[str, Row] = {}
        self._loaded: dict[Plugin, Row | str] = {}

    def register(self, row: Row) -> Row:
        """Add ``row`` as the last one, and return it.

        Raises:
            ValueError: a row of that name is registered already.
        """
        if row.name in self._rows:
            raise ValueError(f"{self.kind} {row.name!r} is registered twice; give each row a name of its own")
        self._rows[row.name] = row
        return row

    def remove(self, name: str) -> None:
        """Take the row called ``name`` out again; an unknown name is the same error as for ``registry[name]``."""
        del self._rows[self[name].name]

    def names(self) -> tuple[str, ...]:
        """All names, those of plug-ins that were not loaded yet, too; one of these may turn out not to be usable."""
        return (*self._rows, *self._plugins())

    def built_in(self, name: str) -> bool:
        """Whether the row ``name`` is one of this program's own."""
        return name in self._rows

    def plugged(self) -> Iterator[tuple[Plugin, str | None]]:
        """Every plug-in of the group, and why it cannot be used; None if it can. All are loaded."""
        for plugin, taken in self._found():
            row = taken or self._load(plugin)
            yield plugin, row if isinstance(row, str) else None

    def __getitem__(self, name: str) -> Row:
        """The row called ``name``.

        Raises:
            LavaVprError: (of the class given as ``error``) no row has that name; the message lists the names there are.
                Or a package brings it, but it cannot be used.
        """
        if name in self._rows:
            return self._rows[name]
        if name not in self._plugins():
            known = ", ".join(self.names())
            raise self._error(f"there is no {self.kind} {name!r}; choose from {known}{self.elsewhere}")
        row = self._load(self._plugins()[name])
        if isinstance(row, str):
            raise self._error(row)
        return row

    @property
    def elsewhere(self) -> str:
        """`elsewhere` of the group."""
        return elsewhere(self.group)

    @contextlib.contextmanager
    def spared(self, name: str) -> Iterator[None]:
        """Skip with a warning the work of the row ``name`` of a package if it fails, since no user requested it."""
        try:
            yield
        except LavaVprError as error:
            plugin = None if name in self._rows else self._plugins().get(name)
            if plugin is None:
                raise
            said = "" if isinstance(error, PluginError) else f"{self._called(plugin)} is left out: "
            _warn(f"{said}{error}")

    def __iter__(self) -> Iterator[str]:
        yield from self._rows
        for name, plugin in self._plugins().items():
            row = self._load(plugin)
            if isinstance(row, str):
                _warn(row)
            else:
                yield name

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def get(self, name: str, default: Any = None) -> Any:
        """The row called ``name``, or ``default`` if no row has that name; errors as ``registry[name]``."""
        return self[name] if name in self else default

    def __contains__(self, name: object) -> bool:
        return name in self._rows or name in self._plugins()

    def _found(self) -> Iterator[tuple[Plugin, str | None]]:
        """Every plug-in, and what a message says if its name is taken, by a row of this program or an earlier one."""
        owners = dict.fromkeys(self._rows, "this program itself")
        for plugin in scanned() if self.group is not None else ():
            if plugin.entry.group != self.group:
                continue
            owner = owners.setdefault(plugin.name, "")
            owners[plugin.name] = owner or plugin.origin
            end = f"has a {self.kind} of that name; uninstall one, or rename it"
            yield plugin, f"{self._called(plugin)} is left out: {owner} {end}" if owner else None

    def _plugins(self) -> dict[str, Plugin]:
        """The plug-ins by name, the first of each; a warning tells of one whose name is taken."""
        free = {}
        for plugin, taken in self._found():
            if taken is None:
                free[plugin.name] = plugin
            else:
                _warn(taken)
        return free

    def _called(self, plugin: Plugin) -> str:
        """A plug-in, for messages."""
        return f"{self.kind} {plugin.name!r} of {plugin.origin}"

    def _load(self, plugin: Plugin) -> Row | str:
        """The row of ``plugin``, loaded once, or why it cannot be used, for people."""
        if plugin not in self._loaded:
            row = reason = None
            try:
                row = plugin.entry.load()
                if not isinstance(row, self._row_class):
                    reason = f"is {type(row).__name__} instead of a row of type {self._row_class.__name__}"
                elif row.name != plugin.name:
                    reason = f"calls itself {brief(row.name)}"
                else:
                    row = guarded(row, self._called(plugin))
            except PASSES:
                raise
            except BaseException as error:  # whatever a package of somebody does when it is imported
                reason = f"cannot be loaded ({cause(error)})"
            refusal = f"{self._called(plugin)} {reason}; update or uninstall that package"
            self._loaded[plugin] = typing.cast(Row, row) if reason is None else refusal
        return self._loaded[plugin]


@lru_cache(maxsize=256)
def _warn(line: str) -> None:
    """Say ``line`` as a warning, once."""
    logging.getLogger("lava_vpr").warning("%s", line)
