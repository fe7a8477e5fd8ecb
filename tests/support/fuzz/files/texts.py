"""Mutations of settings in TOML: by value, by line, by its grammar, by byte.

Used by support.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence

ODD_LITERALS = (
    "nan",
    "inf",
    "-inf",
    "+nan",
    "true",
    "false",
    "0",
    "-0",
    "-1",
    "1",
    "0.5",
    "1e308",
    "1e999",
    "-1e-300",
    "10" * 15,
    "9" * 10_000,
    "-" + "9" * 400,
    "0x7fffffffffffffff",
    "0o17",
    "0b1",
    "1_000",
    "1__0",
    "01",
    "1.",
    ".5",
    '""',
    "''",
    '"a\\u0000b"',
    '"\\ud800"',
    '"\\u001b[31m"',
    '"' + "x" * 5000 + '"',
    "'''\nlong\n'''",
    '"""\\\n  joined"""',
    '"unclosed',
    "[1, 2]",
    "[" * 3000 + "]" * 3000,
    "{a = 1}",
    "{a = " * 1500 + "1" + "}" * 1500,
    "1979-05-27T07:32:00Z",
    "07:32:00",
    "1979-05-27",
    "[",
    "",
    "\x00",
    "'\ttab'",
    "word",
    "'float'",
    "'conductance'",
    "'triplet'",
    "'bias'",
    "'pixels'",
    "'paper'",
)
ODD_LINES = (
    "[network]",
    "[[network]]",
    "[network.inner]",
    "[]",
    "[unknown]",
    "[encoder]",
    "network = 1",
    "network.steps = 3",
    'preset = "paper"',
    'preset = "nothing"',
    "preset = 3",
    "seed = -1",
    "seed = 9223372036854775808",
    "stretch = 1e3",
    "= 1",
    "key",
    "key = ",
    "'quoted key' = 1",
    '"" = 1',
    "a.b.c.d = 1",
    ".".join("a" * 2000) + " = 1",
    "# " + "x" * 5000,
    "\r",
    "\x07",
    "\ufeff",
    "x" * 5000 + " = 1",
    '"\\u001b[2J" = 1',
)


def _value(rng: random.Random, text: str) -> tuple[str, str]:
    """Another value on the right of an equals sign."""
    lines = text.split("\n")
    with_value = [k for k, line in enumerate(lines) if "=" in line]
    at = rng.choice(with_value)
    key, value = lines[at].split(" = ", 1)
    new = rng.choice(ODD_LITERALS) if rng.random() < 0.6 else _near(rng, value)
    lines[at] = f"{key} = {new}"
    return "\n".join(lines), f"{key} = {new[:30]!r}"


def _near(rng: random.Random, value: str) -> str:
    """A number not far away."""
    if not re.fullmatch(r"-?[0-9.]+", value):
        return rng.choice([value.upper(), value[:-1], value + value, value.replace('"', "'")])
    factor = rng.choice(["0", "00", "000000", ".5", "e3", "e-3", "e40", "_0"])
    return rng.choice([value + factor, "-" + value, "0." + value.replace(".", "").lstrip("-"), f"[{value}]"])


def _line(rng: random.Random, text: str) -> tuple[str, str]:
    return lines_changed(rng, text, ODD_LINES)


def lines_changed(rng: random.Random, text: str, odd: Sequence[str]) -> tuple[str, str]:
    """Lines dropped, doubled, moved, the first alone, or one of the ``odd`` ones added; and what was done."""
    lines = text.split("\n")
    at, kind = rng.randrange(len(lines)), rng.randrange(5)
    if kind == 0:
        gone = lines.pop(at)
        return "\n".join(lines), f"without {gone[:30]!r}"
    if kind == 1:
        lines.insert(rng.randrange(len(lines) + 1), lines[at])
        return "\n".join(lines), f"{lines[at][:30]!r} twice"
    if kind == 2:
        lines.insert(rng.randrange(len(lines)), lines.pop(at))
        return "\n".join(lines), f"line {at} moved"
    if kind == 3:
        return "\n".join(lines[:1]), "the first line alone"
    new = rng.choice(odd)
    lines.insert(rng.choice([0, at]), new)
    return "\n".join(lines), f"{new[:30]!r} added"


def _key(rng: random.Random, text: str) -> tuple[str, str]:
    """Another key on the left."""
    keys = re.findall(r"^([a-z_]+) =", text, re.MULTILINE)
    key = rng.choice(keys)
    new = rng.choice([key + "_", key.upper(), f'"{key}"', f"network.{key}", "é", key.replace("_", "-"), '""', *keys])
    return re.sub(rf"^{key} =", lambda _: f"{new} =", text, count=1, flags=re.MULTILINE), f"{key} is called {new}"


def _byte(rng: random.Random, text: str) -> tuple[bytes, str]:
    """Changes of the bytes."""
    raw = text.encode()
    kind = rng.randrange(9)
    at = rng.randrange(len(raw))
    if kind == 0:
        return raw[:at] + bytes([raw[at] ^ 1 << rng.randrange(8)]) + raw[at + 1 :], "a bit turned"
    if kind == 1:
        return raw[:at], "cut off"
    if kind == 2:
        return raw[:at] + rng.choice([b"\0", b"\r", b"\xff", b"\x1b[2J", b"\xed\xa0\x80", b"\\"]) + raw[
            at:
        ], "a byte added"
    if kind == 3:
        return text.encode("utf-16"), "UTF-16"
    if kind == 4:
        return b"\xef\xbb\xbf" + raw, "BOM"
    if kind == 5:
        return raw + raw, "twice"
    if kind == 6:
        return rng.choice([b"", b"\n", b"\0" * 1000, b"#", b"lava-vpr model 1\n"]), "hardly anything"
    if kind == 7:
        return raw.replace(b"\n", b"\r\n"), "CRLF"
    return raw.replace(b"\n", b"\r"), "CR"


_CHANGES: tuple[tuple[float, Callable[[random.Random, str], tuple[str | bytes, str]]], ...] = (
    (6, _value),
    (2, _line),
    (1, _key),
    (1.5, _byte),
)


def changed(rng: random.Random, data: bytes) -> tuple[bytes, str]:
    """Changed TOML, and what was changed."""
    weights, changes = zip(*_CHANGES, strict=True)
    made, told = rng.choices(changes, weights)[0](rng, data.decode())
    return (made.encode("utf-8", "surrogatepass") if isinstance(made, str) else made), told
