"""Mutations of JSON values: other types, absurd numbers and texts, keys dropped, added, renamed and doubled.

Used by support.
"""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Callable, Iterator
from typing import Any

Place = tuple[Any, Any]
"""A list or dictionary, and the index or key of one of its values."""

RAW = "\ue000raw "
"""A text that begins so stands in JSON as what follows it, without quotes."""

DEEP = 3000
ODD_VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    1,
    -1,
    7,
    2**31 - 1,
    2**31,
    2**63,
    10**9,
    10**30,
    -(10**30),
    0.0,
    0.5,
    -0.5,
    1.0,
    1e308,
    -1e308,
    5e-324,
    "",
    "1",
    "NaN",
    "nan",
    "x" * 5000,
    "a\0b",
    "\x1b[31mred\x1b[0m\r\n",
    "\ud800",
    "../../etc/passwd",
    [],
    {},
    [0],
    [[0]],
    {"a": 0},
    RAW + "NaN",
    RAW + "Infinity",
    RAW + "-Infinity",
    RAW + "1e999",
    RAW + "9" * 10_000,
    RAW + "[" * DEEP + "]" * DEEP,
    RAW + '{"a":' * DEEP + "0" + "}" * DEEP,
    RAW + "",
)
"""What a value is replaced by."""


def places(value: Any) -> Iterator[Place]:
    """Every place in ``value`` where a value stands."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, below in inner:
        yield value, key
        yield from places(below)


def near(rng: random.Random, value: Any) -> Any:
    """A value of the same type, a little or much off."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return rng.choice([value + 1, value - 1, -value, value * 2, value * 1000 + 1, value << 40, float(value)])
    if isinstance(value, float):
        return rng.choice([value + 0.5, -value, value * 1e6, value / 1e6, round(value), value + 1e-9])
    if isinstance(value, str):
        return rng.choice([value[:-1], value + "x", value.upper(), value * 50, "\ufeff" + value, value + "\n"])
    return rng.choice([[value], {"": value}, None])


def _replace(rng: random.Random, value: Any, others: list[Place]) -> str:
    holder, key = rng.choice(others)
    holder[key] = rng.choice(ODD_VALUES)
    return f"{key!r} becomes {str(holder[key])[:30]!r}"


def _shift(rng: random.Random, value: Any, others: list[Place]) -> str:
    holder, key = rng.choice(others)
    holder[key] = near(rng, holder[key])
    return f"{key!r} becomes {str(holder[key])[:30]!r}"


def _swap(rng: random.Random, value: Any, others: list[Place]) -> str:
    (a, k), (b, m) = rng.choice(others), rng.choice(others)
    a[k], b[m] = copy.deepcopy(b[m]), copy.deepcopy(a[k])
    return f"{k!r} and {m!r} exchanged"


def _drop(rng: random.Random, value: Any, others: list[Place]) -> str:
    holder, key = rng.choice(others)
    del holder[key]
    return f"{key!r} dropped"


def _add(rng: random.Random, value: Any, others: list[Place]) -> str:
    holder, key = rng.choice(others)
    if isinstance(holder, list):
        holder.insert(rng.randrange(len(holder) + 1), rng.choice([*ODD_VALUES, holder[key]]))
        return f"a value added beside {key!r}"
    name = rng.choice(["", "extra", "__class__", "a\0b", "\x1b[2J", "x" * 3000])
    holder[name] = rng.choice(ODD_VALUES)
    return f"key {name[:20]!r} added"


def _rename(rng: random.Random, value: Any, others: list[Place]) -> str:
    keyed = [(holder, key) for holder, key in others if isinstance(holder, dict)]
    if not keyed:
        return _replace(rng, value, others)
    holder, key = rng.choice(keyed)
    name = rng.choice([key.upper(), key + "_", "", key[:-1] + "\0", "0"])
    holder[name] = holder.pop(key)
    return f"key {key!r} renamed to {name!r}"


def _double(rng: random.Random, value: Any, others: list[Place]) -> str:
    keyed = [(holder, key) for holder, key in others if isinstance(holder, dict)]
    if not keyed:
        return _replace(rng, value, others)
    holder, key = rng.choice(keyed)
    again = rng.choice([*ODD_VALUES[:22], near(rng, holder[key])])
    pair = f"{json.dumps(key)}: {_text(again)}"
    holder[key] = RAW + f"{_text(holder[key])}, {pair}"
    return f"key {key!r} twice"


_CHANGES: tuple[tuple[float, Callable[[random.Random, Any, list[Place]], str]], ...] = (
    (5, _replace),
    (5, _shift),
    (1, _swap),
    (1, _drop),
    (1, _add),
    (1, _rename),
    (0.5, _double),
)


def changed(rng: random.Random, value: Any) -> tuple[bytes, str]:
    """The JSON text of ``value``, a dictionary, with one or two changes, and what they are."""
    value = json.loads(json.dumps(value))
    told = []
    for _ in range(rng.choice([1, 1, 1, 2])):
        others = list(places(value))
        # Lists of hundreds of equal entries would take all changes: the upper levels have half of them.
        top = [(holder, key) for holder, key in others if holder is value]
        chosen = top if rng.random() < 0.4 and top else others
        weights, changes = zip(*_CHANGES, strict=True)
        if chosen:
            told.append(rng.choices(changes, weights)[0](rng, value, chosen))
    if rng.random() < 0.04:
        value = rng.choice(ODD_VALUES)
        told.append(f"all of it is {str(value)[:30]!r}")
    text = _text(value).encode("utf-8", "surrogatepass")
    encoding = rng.random()
    if encoding < 0.02:
        return text.decode("utf-8", "surrogatepass").encode("utf-16", "surrogatepass"), ", ".join(told) + ", UTF-16"
    if encoding < 0.04:
        return b"\xef\xbb\xbf" + text, ", ".join(told) + ", BOM"
    if encoding < 0.06:
        return text[: rng.randrange(len(text) + 1)], ", ".join(told) + ", cut off"
    return text, ", ".join(told)


def _text(value: Any) -> str:
    """``value`` as JSON, with what `RAW` marks as it is."""
    if isinstance(value, str) and value.startswith(RAW):
        return value[len(RAW) :]
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)}: {_text(below)}" for key, below in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_text, value)) + "]"
    return json.dumps(value)
