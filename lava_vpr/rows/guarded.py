"""What a package brings, so wrapped that whatever fails in it is an error of one line that names it.

The functions of a row are wrapped, and what they return: functions, iterators, and objects of a package's own. Errors
that a user can cause (`LavaVprError`), a lack of memory and a signal pass as they are.
"""

from __future__ import annotations

import array
import dataclasses
import operator
import types
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lava_vpr.errors import LavaVprError, PluginError

_PLAIN: tuple[type, ...] = (type(None), str, bytes, int, float, np.ndarray, np.generic, Path, BaseException, type)
_PLAIN += (memoryview, array.array, set, frozenset, range)
"""What has no code of a package that anybody here would call."""
_OURS = __name__.partition(".")[0]
_FUNCTIONS = (types.FunctionType, types.MethodType, types.BuiltinFunctionType, partial)
PASSES = (MemoryError, KeyboardInterrupt)
"""What is no fault of a package."""


def cause(error: BaseException) -> str:
    """What was raised, on one line that is not too long."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]


@contextmanager
def _named(called: str) -> Iterator[None]:
    """Turn what is raised into a `PluginError` of what is ``called`` so."""
    try:
        yield
    except (LavaVprError, *PASSES):
        raise
    except BaseException as error:  # whatever a package of somebody does
        raise PluginError(f"{called} failed ({cause(error)}); update or uninstall that package") from error


def guarded(value: Any, called: str) -> Any:
    """``value``, wrapped.

    Args:
        value: A row, or what one of its functions returned.
        called: What a message calls the row.
    """
    if isinstance(value, _PLAIN):
        return value
    wrap = partial(guarded, called=called)
    if isinstance(value, tuple) and hasattr(value, "_make"):
        return value._make(map(wrap, value))
    if isinstance(value, (tuple, list)):
        return type(value)(map(wrap, value))
    if isinstance(value, Mapping):
        return {key: wrap(one) for key, one in value.items()}
    if isinstance(value, Iterator):
        return _walked(value, called)
    if type(value).__module__.partition(".")[0] == _OURS:
        return _row(value, wrap) if dataclasses.is_dataclass(value) else value
    return partial(_call, value, called) if isinstance(value, _FUNCTIONS) else _Guarded(value, called)


def _row(value: Any, wrap: Callable[[Any], Any]) -> Any:
    """A dataclass of this package, its fields wrapped."""
    fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value) if field.init}
    return dataclasses.replace(value, **{name: wrap(one) for name, one in fields.items()})


def _call(function: Callable[..., Any], called: str, /, *args: Any, **options: Any) -> Any:
    """Call ``function``."""
    with _named(called):
        return guarded(function(*args, **options), called)


def _walked(items: Iterator[Any], called: str) -> Iterator[Any]:
    """The ``items``, one by one."""
    end = object()
    while True:
        with _named(called):
            item = next(items, end)
        if item is end:
            return
        yield guarded(item, called)


class _Guarded:
    """An object of a package's own, such as a backend: what its methods and attributes give is wrapped."""

    def __init__(self, value: Any, called: str) -> None:
        self._value, self._called = value, called

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # whether it can do what Python, NumPy or copy asks of it
            return getattr(self._value, name)
        return _call(getattr, self._called, self._value, name)

    def __call__(self, *args: Any, **options: Any) -> Any:
        return _call(self._value, self._called, *args, **options)

    def __bool__(self) -> bool:
        return bool(_call(bool, self._called, self._value))

    def __iter__(self) -> Iterator[Any]:
        walked: Iterator[Any] = _call(iter, self._called, self._value)
        return walked

    def __getitem__(self, key: Any) -> Any:
        return _call(operator.getitem, self._called, self._value, key)

    def __len__(self) -> int:
        return int(_call(len, self._called, self._value))
