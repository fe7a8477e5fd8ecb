"""Registries: one table for each kind of thing that can be added, a row with everything that belongs to one of them.

A row is a frozen dataclass with a ``name``. What the code needs to know about a decoder, an input, a backend, a board
or a dataset is a field of its row, so nothing elsewhere asks for a name. A row that lacks a part is refused when it is
registered, which for the rows of this package is when their module is imported.
"""

from __future__ import annotations

import collections.abc
import dataclasses
import types
import typing
from collections.abc import Iterator, Mapping
from typing import Any, Generic, Protocol, TypeVar

from lava_vpr.errors import LavaVprError


class Named(Protocol):
    """Every row has a name, by which users choose it."""

    @property
    def name(self) -> str:
        """The row's name, the key of its registry."""
        ...


Row = TypeVar("Row", bound=Named)


class Registry(Mapping[str, Row], Generic[Row]):
    """The rows of one kind by name, in the order in which they were registered.

    >>> @dataclass(frozen=True)
    ... class Board:
    ...     name: str
    ...     cores: int
    >>> BOARDS: Registry[Board] = Registry("board")
    >>> BOARDS.register(Board("kapoho-bay", cores=256))

    Args:
        kind: What a row is, one word for messages: "decoder", "board".
        error: The error that says that no row has a name.
    """

    def __init__(self, kind: str, error: type[LavaVprError] = LavaVprError) -> None:
        self.kind = kind
        self._error = error
        self._rows: dict[str, Row] = {}

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

    def __getitem__(self, name: str) -> Row:
        """The row that was registered under ``name``.

        Raises:
            LavaVprError: (of the class given as ``error``) no row has that name; the message lists the names there are.
        """
        if name not in self._rows:
            raise self._error(f"there is no {self.kind} {name!r}; choose from {', '.join(self)}")
        return self._rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def get(self, name: str, default: Any = None) -> Any:
        """The row called ``name``, or ``default`` if no row has that name."""
        return self._rows.get(name, default)

    def __contains__(self, name: object) -> bool:
        return name in self._rows


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
