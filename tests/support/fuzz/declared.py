"""Settings made of what they declare: values within their ranges, at the ends, and beyond.

Used by core.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

from hypothesis import assume
from hypothesis import strategies as st

from lava_vpr.config import PRESETS, Config, preset
from lava_vpr.errors import ConfigError
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.matching.decoders import DECODERS
from lava_vpr.settings.ranges import Declared, Range, declared

NAMES = {"kind": st.sampled_from(list(INPUTS)), "default": st.sampled_from(list(DECODERS)), "filters": st.just("")}
"""Texts that name rows of registries, or are made by learning."""


def fitting(name: str, setting: Declared) -> st.SearchStrategy[Any]:
    """Values that the declaration of the setting ``name`` allows."""
    if setting.words:
        return st.sampled_from(setting.words)
    if setting.range is None:
        return st.booleans() if setting.kind is bool else NAMES.get(name, st.just("loihi"))
    return numbers(setting.kind, setting.range)


def numbers(kind: type, of: Range) -> st.SearchStrategy[Any]:
    """Numbers of a range, its ends among them."""
    if kind is int:
        return st.one_of(st.sampled_from(list(ends(of))), st.integers(int(of.least), int(of.most)).filter(of.fits))
    open_least, open_most = of.without in ("least", "both"), of.without in ("most", "both")
    return st.floats(float(of.least), float(of.most), exclude_min=open_least, exclude_max=open_most)


def ends(of: Range) -> Iterator[int]:
    """The whole numbers next to the ends of a range that belong to it."""
    for end, way in ((int(of.least), 1), (int(of.most), -1)):
        yield next(n for n in range(end, end + way * 100, way) if of.holds(n) and of.fits(n))


def beyond(setting: Declared) -> Iterator[object]:
    """Values that the declaration of a setting does not allow, the next to its ends first."""
    of, whole = setting.range, setting.kind is int
    if of is not None:
        least, most = (int(of.least), int(of.most)) if whole else (float(of.least), float(of.most))
        yield least if of.without in ("least", "both") else least - 1 if whole else math.nextafter(least, -math.inf)
        yield most if of.without in ("most", "both") else most + 1 if whole else math.nextafter(most, math.inf)
        yield from (4,) if of.only == "odd" else (12,) if of.only else ()
        yield from (5.5,) if whole else ()
        yield from (math.nan, math.inf, -math.inf, 10**400, -(10**400))
    yield from ("nonsense",) if setting.words or setting.kind is not str else ()
    yield from (None, [5], {"a": 1})
    yield from () if setting.kind is bool else (True,)
    yield from (1,) if setting.kind is bool or setting.kind is str else ()


@st.composite
def changed(draw: st.DrawFn, section: Any) -> Any:
    """``section`` with some settings changed to others that its declarations allow, where these go together."""
    settings = declared(type(section))
    names = draw(st.lists(st.sampled_from([n for n in settings if n != "preset"]), max_size=4, unique=True))
    try:
        return dataclasses.replace(section, **{name: draw(fitting(name, settings[name])) for name in names})
    except ConfigError:
        assume(False)


@st.composite
def configs(draw: st.DrawFn) -> Config:
    """Settings within all ranges, from any preset."""
    base = draw(changed(preset(draw(st.sampled_from(list(PRESETS))))))
    parts = [field.name for field in dataclasses.fields(base) if field.name not in declared(Config)]
    names = draw(st.lists(st.sampled_from(parts), min_size=1, max_size=3, unique=True))
    try:
        return dataclasses.replace(base, **{name: draw(changed(getattr(base, name))) for name in names})
    except ConfigError:
        assume(False)
        raise
