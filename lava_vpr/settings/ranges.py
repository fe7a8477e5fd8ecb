"""Ranges of settings, declared once: a setting's annotation says what it may be, and everything else reads that.

`check` refuses settings of a dataclass that are not what their annotations declare; TOML files, options, tests and
docs/security.md read the same declarations by `declared`.
"""

from __future__ import annotations

import math
import numbers
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

from lava_vpr.errors import ConfigError, brief

CHANGE_IT = "change it in the options or the --config file"
"""The remedy for a setting that cannot be."""

Number = int | float


@dataclass(frozen=True)
class Range:
    """Numbers from ``least`` to ``most``.

    Attributes:
        least, most: The ends.
        without: The ends that are themselves outside: ``least``, ``most`` or ``both``.
        only: Which whole numbers in between are meant, a key of `_KINDS`; empty: all.
    """

    least: Number
    most: Number
    without: Literal["", "least", "most", "both"] = ""
    only: Literal["", "odd", "a power of two"] = ""

    def holds(self, value: Number) -> bool:
        """Whether ``value`` lies between the ends."""
        above = value > self.least if self.without in ("least", "both") else value >= self.least
        below = value < self.most if self.without in ("most", "both") else value <= self.most
        return above and below

    def fits(self, value: Number) -> bool:
        """Whether ``value``, which lies between the ends, is one of those that are meant."""
        return not self.only or _KINDS[self.only](int(value))

    def __str__(self) -> str:
        first = "(" if self.without in ("least", "both") else "["
        last = ")" if self.without in ("most", "both") else "]"
        return f"{first}{_written(self.least)}, {_written(self.most)}{last}"


_KINDS: dict[str, Callable[[int], bool]] = {"odd": lambda n: n % 2 == 1, "a power of two": lambda n: n & (n - 1) == 0}


def _written(end: Number) -> str:
    return str(end).replace("e+", "e")


@dataclass(frozen=True)
class Declared:
    """What an annotation says of a setting.

    Attributes:
        kind: ``int``, ``float``, ``bool`` or ``str``.
        range: Of a number; None: any.
        words: Of a text, those that are allowed; empty: any.
        note: What a message adds to the words.
    """

    kind: type
    range: Range | None = None
    words: tuple[str, ...] = ()
    note: str = ""

    def __str__(self) -> str:
        if self.words:
            *others, last = self.words
            return " or ".join([", ".join(others), last] if others else [last]) + self.note
        if self.range is not None:
            return f"{self.range.only}{', ' if self.range.only else ''}in {self.range}"
        return KINDS[self.kind]


KINDS: dict[type, str] = {int: "a whole number", float: "a number", bool: "true or false", str: "text"}
"""The types of settings, and how a message calls each."""


@cache
def declared(section: type) -> Mapping[str, Declared]:
    """What the annotations of a dataclass say of each setting; sections within it are left out."""
    hints = typing.get_type_hints(section, include_extras=True)
    found = {name: _declared(annotation) for name, annotation in hints.items()}
    return {name: setting for name, setting in found.items() if setting is not None}


def _declared(annotation: Any) -> Declared | None:
    """What one annotation says: ``Annotated[int, Range(0, 9)]``, ``Literal["a", "b"]``, ``bool`` and the like."""
    extras = getattr(annotation, "__metadata__", ())
    bare = annotation.__origin__ if extras else annotation
    note = next((f" {extra}" for extra in extras if isinstance(extra, str)), "")
    if typing.get_origin(bare) is Literal:
        return Declared(str, words=typing.get_args(bare), note=note)
    return Declared(bare, next((e for e in extras if isinstance(e, Range)), None)) if bare in KINDS else None


def need(condition: bool, name: str, value: object, limit: str) -> None:
    """Refuse a setting outside its range, naming it, its value and its range (NaN fails every comparison).

    Raises:
        ConfigError: the condition does not hold.
    """
    if not condition:
        raise ConfigError(f"{name} is {brief(value)}, but must be {limit}; {CHANGE_IT}")


def whole(value: object) -> bool:
    """Whether ``value`` is a whole number, which a truth value is not."""
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)


def real(value: object) -> bool:
    """Whether ``value`` is a finite number."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool) and (whole(value) or math.isfinite(value))


def check(section: Any, name: str = "", **narrower: Range) -> None:
    """Refuse settings that are not what their annotations declare.

    Args:
        section: A dataclass of settings.
        name: How files call it; empty for the settings that stand in no section.
        narrower: Ranges in place of those declared, where other settings narrow them.
    Raises:
        ConfigError: naming the first setting that lies outside its range.
    """
    kind: type = type(section)
    for key, setting in declared(kind).items():
        called, value = f"{name}.{key}" if name else key, getattr(section, key)
        of = narrower.get(key, setting.range)
        if of is None:
            fits = isinstance(value, setting.kind) and (not setting.words or value in setting.words)
            need(fits, called, value, str(setting))
        else:
            need(whole(value) if setting.kind is int else real(value), called, value, f"{KINDS[setting.kind]} in {of}")
            need(of.holds(value), called, value, f"in {of}")
            need(of.fits(value), called, value, f"{of.only}, in {of}")
