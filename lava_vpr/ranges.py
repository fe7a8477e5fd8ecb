"""Ranges of settings: a value outside its range is refused, with its name and the range."""

from __future__ import annotations

from lava_vpr.errors import ConfigError


def need(condition: bool, name: str, value: object, limit: str) -> None:
    """Refuse a setting outside its range, naming it, its value and its range (NaN fails every comparison).

    Raises:
        ConfigError: the condition does not hold.
    """
    if not condition:
        raise ConfigError(f"{name} is {value!r}, but must be {limit}; change it in the options or the --config file")


def within(part: object, section: str, **ranges: str) -> None:
    """Refuse settings outside their ranges, written ``[least, most]`` or, without the end itself, ``(least, most)``.

    Raises:
        ConfigError: naming the first attribute of ``part`` that lies outside its range.
    """
    for name, limits in ranges.items():
        value = getattr(part, name)
        low, high = (float(end) for end in limits[1:-1].split(","))
        above = value > low if limits[0] == "(" else value >= low
        below = value < high if limits[-1] == ")" else value <= high
        need(above and below, f"{section}.{name}", value, f"in {limits}")
