"""Registries keep rows by name, in order, and refuse a row that lacks a part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import pytest

from lava_vpr.errors import ConfigError
from lava_vpr.rows.registry import Registry


@dataclass(frozen=True)
class Shape:
    """A row with a field of every sort."""

    name: str
    area: Callable[[float], float]
    outline: Callable[[float], float] | None
    corners: int
    scale: float
    colour: Literal["red", "blue"]
    sizes: tuple[int, ...]


SQUARE = Shape("square", lambda side: side * side, None, 4, 1, "red", (1, 2))


def shapes() -> Registry[Shape]:
    registry: Registry[Shape] = Registry("shape", ConfigError)
    registry.register(SQUARE)
    return registry


def test_rows_are_kept_by_name_in_the_order_of_registration() -> None:
    registry = shapes()
    circle = registry.register(replace(SQUARE, name="circle"))
    triangle = registry.register(replace(SQUARE, name="a triangle"))
    assert list(registry) == ["square", "circle", "a triangle"]
    assert list(registry.values()) == [SQUARE, circle, triangle]
    assert registry["circle"] is circle
    assert ("circle" in registry, "ring" in registry, len(registry)) == (True, False, 3)
    assert (registry.get("circle"), registry.get("ring")) == (circle, None)


def test_an_unknown_name_is_one_line_that_lists_the_known_ones() -> None:
    registry = shapes()
    registry.register(replace(SQUARE, name="circle"))
    with pytest.raises(ConfigError, match=r"^there is no shape 'ring'; choose from square, circle$"):
        registry["ring"]
    with pytest.raises(ConfigError, match="there is no shape 'ring'"):
        registry.remove("ring")


def test_two_rows_of_one_name_are_refused_until_the_first_is_removed() -> None:
    registry = shapes()
    with pytest.raises(ValueError, match="shape 'square' is registered twice"):
        registry.register(replace(SQUARE, corners=5))
    assert registry["square"].corners == 4
    registry.remove("square")
    registry.register(replace(SQUARE, corners=5))
    assert registry["square"].corners == 5


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ({"name": ""}, "name is '', but must be a text that is not empty"),
        ({"area": None}, "area is None, but must be a function"),
        ({"area": "side squared"}, "area is 'side squared', but must be a function"),
        ({"outline": 3}, "outline is 3, but must be a function"),
        ({"corners": None}, "corners is None, but must be a value of int"),
        ({"corners": 4.5}, "corners is 4.5, but must be a value of int"),
        ({"scale": "1"}, "scale is '1', but must be a value of float"),
        ({"colour": "green"}, "colour is 'green', but must be a value of Literal"),
        ({"sizes": None}, "sizes is None, but must be a value of tuple"),
    ],
)
def test_a_row_with_a_missing_part_is_refused(part: dict[str, Any], message: str) -> None:
    registry = shapes()
    with pytest.raises(TypeError, match=message):
        registry.register(replace(SQUARE, **{"name": "ring", **part}))
    assert list(registry) == ["square"]


def test_a_row_is_a_frozen_dataclass() -> None:
    @dataclass
    class Loose:
        name: str

    @dataclass(frozen=True)
    class Short:
        name: str
        area: Callable[[float], float]

    registry: Registry[Any] = Registry("shape")
    for row in (Loose("ring"), "ring", Short):
        with pytest.raises(TypeError, match="is no frozen dataclass"):
            registry.register(row)
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'area'"):
        registry.register(Short("ring"))  # type: ignore[call-arg]
