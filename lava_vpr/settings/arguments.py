"""Arguments of the public functions, checked where a caller in Python gives them: one table, one refusal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from numbers import Real
from pathlib import Path
from typing import Any

from lava_vpr.errors import InputError, brief
from lava_vpr.settings.ranges import real, whole

_MOST = 2**53
"""No number of metres or seconds is larger: whole ones are no longer exact in float64."""


def is_path(value: Any) -> bool:
    """Whether ``value`` is a path that a file can have."""
    return isinstance(value, (str, Path)) and bool(str(value)) and "\0" not in str(value)


def is_sequence(value: Any) -> bool:
    """Whether ``value`` has elements in order: a list, a tuple or an array, no text."""
    return getattr(value, "ndim", 0) > 0 or (isinstance(value, Sequence) and not isinstance(value, (str, bytes)))


def _measured(value: Any) -> bool:
    return real(value) and abs(value) <= _MOST


def _sequence_of(right: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: is_sequence(value) and all(map(right, value))


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


_PATH, _TEXT, _NUMBER = (is_path, "the path of a file"), (_is_text, "text"), (real, "a number")
_ABOVE_0 = (lambda value: _measured(value) and value > 0, "a number above 0")
_IMAGES = (lambda value: is_path(value) or is_sequence(value), "a path, or a list or array of images or vectors")
_YES_OR_NO = (lambda value: isinstance(value, bool), "True or False")
_ARGUMENTS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "path": _PATH,
    "model": (is_path, "a Model, or the path of a file"),
    "checkpoint": _PATH,
    "images": _IMAGES,
    "references": (_sequence_of(_IMAGES[0]), f"for each traverse {_IMAGES[1]}"),
    "rates": (
        lambda value: _sequence_of(is_sequence)(value) and len(value) > 0,
        "an array (images, inputs), or several",
    ),
    "names": (_sequence_of(_is_text), "a list of texts"),
    "motion": _TEXT,
    "preset": _TEXT,
    "dataset": _TEXT,
    "cluster": _TEXT,
    "adapt": (
        lambda value: value == "model" if _is_text(value) else _measured(value) and value >= 1,
        "a number of images, at least 1, or 'model'",
    ),
    "target_precision": _NUMBER,
    "off_map": _NUMBER,
    "stamp": (lambda value: _measured(value) or (isinstance(value, Real) and value != value), "a number of seconds"),
    "name": _TEXT,
    "crop": (lambda value: value in ("none", "auto"), "'none' or 'auto'"),
    "odometry": (_measured, "a finite number of metres (leave it out where unknown)"),
    "every": _ABOVE_0,
    "spacing": _ABOVE_0,
    "keyframes": _ABOVE_0,
    "gap": (lambda value: _measured(value) and value >= 0, "a number of seconds, at least 0"),
    "seed": (lambda value: whole(value) and 0 <= value < 2**63, "a whole number in [0, 9223372036854775807]"),
    "query_views": (whole, "a whole number"),
    "section": (whole, "a whole number"),
    "threads": (lambda value: whole(value) and value >= 1, "a whole number, at least 1"),
    "places": (lambda value: _sequence_of(whole)(value) and len(value) == 2, "two whole numbers (A, B)"),
    "parts": (_sequence_of(whole), "a list of whole numbers"),
    "stamps": (lambda value: is_path(value) or _sequence_of(is_path)(value), "the path of a file, or a list of paths"),
    "config": (is_path, "a Config, or the path of a file"),
    "standard": (is_path, "a Model, or the path of a file"),
    "resume": _YES_OR_NO,
    "skip_unreadable": _YES_OR_NO,
    "allow_duplicates": _YES_OR_NO,
    "learn": _YES_OR_NO,
}


def check_arguments(required: str = "", **given: Any) -> None:
    """Refuse what is not of the kind that an argument takes.

    Args:
        required: Names of those that cannot be None, which others can.
        given: What a caller gave, by the name of the argument.
    Raises:
        InputError: naming the first such argument.
    """
    for name, value in given.items():
        right, wanted = _ARGUMENTS[name]
        if not (right(value) if value is not None else name not in required.split()):
            raise InputError(f"{name} is {brief(value)}, but must be {wanted}; correct the call")
