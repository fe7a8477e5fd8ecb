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
        self._loaded: dict[Plugin, Row | str] = {}

    def register(self, row: Row) -> Row:
        """Add ``row`` as the last one, and return it.

        Raises:
            TypeError: the row is no frozen dataclass, or lacks a part.
            ValueError: a row of that name is registered already.
        """
        _check_row(row, self.kind)
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

    def _found(self) -> Iterator[tuple[Plugin, str | None]]:
        """Every plug-in, and what a message says if its name is taken, by a row of this program or an earlier one."""
        owners = dict.fromkeys(self._rows, "this program itself")
        for plugin in plugins(self.group) if self.group is not None else ():
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
            try:
                self._loaded[plugin] = self._sound(plugin)
            except PluginError as error:
                self._loaded[plugin] = f"{self._called(plugin)} {error}; update or uninstall that package"
        return self._loaded[plugin]

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
            _check_row(row, self.kind)
        except TypeError as error:
            raise PluginError(f"is not whole ({error})") from None
        return typing.cast(Row, row)


@lru_cache(maxsize=256)
def _warn(line: str) -> None:
    """Say ``line`` as a warning, once."""
    logging.getLogger("lava_vpr").warning("%s", line)


def _check_row(row: object, kind: str) -> None:
    """Refuse a row that is no frozen dataclass or lacks a part; finer types are for type checkers.

    Raises:
        TypeError: with the row's name and the field.
    """
    if not dataclasses.is_dataclass(row) or isinstance(row, type) or not type(row).__dataclass_params__.frozen:  # type: ignore[attr-defined]
        raise TypeError(f"{kind} {row!r} is no frozen dataclass; make its row one")
    hints = typing.get_type_hints(type(row))
    for field in dataclasses.fields(row):
        value, wanted = getattr(row, field.name), _lacking(getattr(row, field.name), hints[field.name])
        if wanted is not None:
            wanted = wanted or f"a value of {field.type}"
            name = getattr(row, "name", None)
            raise TypeError(f"{kind} {name!r}: {field.name} is {value!r}, but must be {wanted}")


def _lacking(value: object, annotation: Any) -> str | None:
    """What belongs in a field, for a message; None if ``value`` does, empty if that is a value of its annotation."""
    united = typing.get_origin(annotation) in (typing.Union, types.UnionType)
    kinds = typing.get_args(annotation) if united else (annotation,)
    if value is None and type(None) in kinds:
        return None
    if any(collections.abc.Callable in (kind, typing.get_origin(kind)) for kind in kinds):
        return None if callable(value) else "a function"
    if annotation is str:
        return None if isinstance(value, str) and value else "a text that is not empty"
    if typing.get_origin(annotation) is typing.Literal:
        return None if value in typing.get_args(annotation) else ""
    if annotation in (int, float, bool):
        return None if isinstance(value, (int, annotation)) else ""
    return None if value is not None else ""
