"""Registries: one table for each kind of thing that can be added, a row with everything that belongs to one of them.

A row is a frozen dataclass with a ``name``. What the code needs to know about a decoder, an input, a backend, a board
or a dataset is a field of its row, so nothing elsewhere asks for a name. A row that lacks a part is refused when it is
registered, which for the rows of this package is when their module is imported.
"""

from __future__ import annotations

import collections.abc
import dataclasses
import logging
import types
import typing
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any, Generic, Protocol, TypeVar

from lava_vpr.errors import LavaVprError, brief
from lava_vpr.rows.plugins import Plugin, PluginError, plugins


class Named(Protocol):
    """Every row has a name, by which users choose it."""

    @property
    def name(self) -> str:
        """The row's name, the key of its registry."""
        ...


Row = TypeVar("Row", bound=Named)


class Registry(Mapping[str, Row], Generic[Row]):
    """The rows of one kind by name: those of this package in the order in which they were registered, then plug-ins.

    >>> @dataclass(frozen=True)
    ... class Board:
    ...     name: str
    ...     cores: int
    >>> BOARDS: Registry[Board] = Registry("board")
    >>> BOARDS.register(Board("kapoho-bay", cores=256))

    With a ``group``, installed packages bring rows, too (`lava_vpr.rows.plugins`). A name that is built in is looked up
    without them, and nothing of a package is imported before its row is asked for by name, or all rows are. One that
    cannot be used is left out with a warning, and is an error where it is asked for by name.

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
        row_class: type[Row] | None = None,
    ) -> None:
        self.kind = kind
        self.group = group
        self._error = error
        self._row_class = row_class
        self._rows: dict[str, Row] = {}
        self._plugged: dict[Plugin, Row | str] = {}

    def register(self, row: Row) -> Row:
        """Add ``row`` as the last one, and return it.

        Raises:
            TypeError: the row is no frozen dataclass, or a part of it is missing or of another type than its field.
            ValueError: a row of that name is registered already.
        """
        check_row(row, self.kind)
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

    def plugged(self) -> Iterator[tuple[Plugin, str | None]]:
        """Every plug-in of the group, and why it cannot be used; None if it can. All are loaded."""
        for plugin in plugins(self.group) if self.group is not None else ():
            row = self._load(plugin)
            yield plugin, row if isinstance(row, str) else None

    def __getitem__(self, name: str) -> Row:
        """The row called ``name``.

        Raises:
            LavaVprError: (of the class given as ``error``) no row has that name; the message lists the names there are.
                Or a package brings it, but it cannot be used.
        """
        if name in self._rows:
            return self._rows[name]
        plugin = self._plugins().get(name)
        if plugin is None:
            raise self._error(
                f"there is no {self.kind} {name!r}; choose from {', '.join(self.names())}{self.elsewhere}"
            )
        row = self._load(plugin)
        if isinstance(row, str):
            raise self._error(row)
        return row

    @property
    def elsewhere(self) -> str:
        """What a message adds to the names there are: that a package may bring others; nothing without a group."""
        if self.group is None:
            return ""
        return f", or install the package that has it among its entry points {self.group}"

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

    def _plugins(self) -> dict[str, Plugin]:
        """The plug-ins by name, the first of each; a warning tells of one whose name is taken."""
        found: dict[str, Plugin] = {}
        for plugin in plugins(self.group) if self.group is not None else ():
            taken = self._taken(plugin)
            if taken is None:
                found[plugin.name] = plugin
            else:
                _warn(taken)
        return found

    def _taken(self, plugin: Plugin) -> str | None:
        """What a message says of a plug-in whose name another row has; None if it has its own."""
        by = None
        if plugin.name in self._rows:
            by = "this program itself"
        for other in plugins(plugin.group):
            if by is None and other.name == plugin.name and other is not plugin:
                by = other.origin
            if other is plugin:
                break
        if by is None:
            return None
        return f"{self._told(plugin)} is left out: {by} has a {self.kind} of that name; uninstall one, or rename it"

    def _told(self, plugin: Plugin) -> str:
        """A plug-in, for messages."""
        return f"{self.kind} {plugin.name!r} of {plugin.origin}"

    def _load(self, plugin: Plugin) -> Row | str:
        """The row of ``plugin``, loaded once, or why it cannot be used, for people."""
        taken = self._taken(plugin)
        if taken is not None:
            return taken
        if plugin not in self._plugged:
            try:
                self._plugged[plugin] = self._sound(plugin)
            except PluginError as error:
                self._plugged[plugin] = f"{self._told(plugin)} {error}; update or uninstall that package"
        return self._plugged[plugin]

    def _sound(self, plugin: Plugin) -> Row:
        """The row of ``plugin``.

        Raises:
            PluginError: it cannot be loaded, or is no such row.
        """
        row = plugin.load()
        if self._row_class is not None and not isinstance(row, self._row_class):
            raise PluginError(f"is {type(row).__name__} instead of a row of type {self._row_class.__name__}")
        if getattr(row, "name", None) != plugin.name:
            raise PluginError(f"calls itself {brief(getattr(row, 'name', None))}")
        try:
            check_row(row, self.kind)
        except TypeError as error:
            raise PluginError(f"is not whole ({error})") from None
        return typing.cast(Row, row)


@lru_cache(maxsize=256)
def _warn(line: str) -> None:
    """Say ``line`` as a warning, once."""
    logging.getLogger("lava_vpr").warning("%s", line)


def check_row(row: object, kind: str) -> None:
    """Refuse a row that lacks a part.

    Every field must hold what its annotation says: a callable where a function belongs, a text that is not empty, and
    None only where the annotation allows it.

    Raises:
        TypeError: with the row's name and the field.
    """
    if not dataclasses.is_dataclass(row) or isinstance(row, type) or not type(row).__dataclass_params__.frozen:  # type: ignore[attr-defined]
        raise TypeError(f"{kind} {row!r} is no frozen dataclass; make its row one")
    name = getattr(row, "name", None)
    hints = typing.get_type_hints(type(row))
    for field in dataclasses.fields(row):
        value = getattr(row, field.name)
        if not _holds(value, hints[field.name]):
            raise TypeError(f"{kind} {name!r}: {field.name} is {value!r}, but must be {_described(hints[field.name])}")


def _holds(value: object, annotation: Any) -> bool:
    """Whether ``value`` is what a field annotated with ``annotation`` must hold; items of containers are not seen."""
    if annotation is Any:
        return value is not None
    if annotation is None or annotation is type(None):
        return value is None
    origin = typing.get_origin(annotation)
    if origin in (typing.Union, types.UnionType):
        return any(_holds(value, part) for part in typing.get_args(annotation))
    if origin is typing.Literal:
        return value in typing.get_args(annotation)
    if collections.abc.Callable in (annotation, origin):
        return callable(value)
    expected = origin or annotation
    if expected is str:
        return isinstance(value, str) and value != ""
    if expected in (int, float):
        return isinstance(value, (int, expected)) and not isinstance(value, bool)
    if not isinstance(expected, type) or getattr(expected, "_is_protocol", False):
        return value is not None  # a protocol or a type variable: no class to compare with
    return isinstance(value, expected)


def _described(annotation: Any) -> str:
    """What a field annotated with ``annotation`` must hold, in words."""
    origin = typing.get_origin(annotation)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(_described(part) for part in typing.get_args(annotation))
    if collections.abc.Callable in (annotation, origin):
        return "a function"
    if annotation is str:
        return "a text that is not empty"
    if annotation is type(None):
        return "None"
    return f"a value of {getattr(origin or annotation, '__name__', annotation)}"
