"""Registries keep rows by name, in order."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest

from lava_vpr.errors import ConfigError
from lava_vpr.rows.registry import Registry


@dataclass(frozen=True)
class Shape:
    """A row."""

    name: str
    corners: int


SQUARE = Shape("square", 4)


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
