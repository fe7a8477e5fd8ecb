"""Mutations of `.lvpr` files whose checksum is right again: header, arrays, the zip archive, the raw bytes.

Used by storage and support.
"""

from __future__ import annotations

import hashlib
import io
import json
import random
from collections.abc import Mapping
from typing import Any

import numpy as np
from support.fuzz.files import archives, arrays, values
from support.fuzz.files.archives import Entries


def taken_apart(data: bytes) -> tuple[bytes, Entries]:
    """The magic line of an honest container, and its entries."""
    magic, _, payload = data.split(b"\n", 2)
    return magic, archives.unzipped(payload)


def sealed(magic: bytes, payload: bytes) -> bytes:
    """A container with the right checksum of ``payload``."""
    return magic + b"\n" + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload


def header_of(entries: Entries) -> Any:
    """The header's JSON value."""
    return json.loads(np.lib.format.read_array(io.BytesIO(dict(entries)["header.npy"])).tobytes())


def _with_header(entries: Entries, text: bytes) -> Entries:
    stored = arrays.stored(np.frombuffer(text, np.uint8))
    return [(name, stored if name == "header.npy" else data) for name, data in entries]


def _header(rng: random.Random, entries: Entries) -> tuple[Entries, str]:
    text, told = values.changed(rng, header_of(entries))
    return _with_header(entries, text), f"header: {told}"


def _array(rng: random.Random, entries: Entries) -> tuple[Entries, str]:
    at = rng.randrange(len(entries))
    name, data = entries[at]
    made, told = arrays.changed(rng, arrays.read(data))
    return [*entries[:at], (name, made), *entries[at + 1 :]], f"{name}: {told}"


def _entries(rng: random.Random, entries: Entries, other: Entries) -> tuple[Entries, str]:
    """Entries dropped, added, doubled, renamed, in another order, or those of another file."""
    at = rng.randrange(len(entries))
    name, data = entries[at]
    kind = rng.randrange(8)
    if kind == 0:
        return entries[:at] + entries[at + 1 :], f"without {name}"
    if kind == 1:
        again = arrays.changed(rng, arrays.read(data))[0]
        return rng.choice([[*entries, (name, again)], [(name, again), *entries]]), f"{name} twice"
    if kind == 2:
        odd = rng.choice(
            ["../up.npy", "/abs.npy", "a.npy", "a..npy", "header", "a.\0.npy", "x" * 3000, "a.extra.npy", ""]
        )
        return [*entries, (odd, data)], f"{odd[:20]!r} added"
    if kind == 3:
        return [*entries[:at], (name.upper(), data), *entries[at + 1 :]], f"{name} renamed"
    if kind == 4:
        return rng.sample(entries, len(entries)), "another order"
    if kind == 5:
        stem = name.removesuffix(".npy")
        return [*entries[:at], (stem, data), *entries[at + 1 :]], f"{name} without .npy"
    mine, theirs = dict(entries), dict(other)
    common = sorted(set(mine) & set(theirs))
    if kind == 6 or len(common) < 2:
        chosen = rng.choice(common)
        return [(n, theirs[n] if n == chosen else d) for n, d in entries], f"{chosen} of another file"
    first, second = rng.sample(sorted(mine), 2)
    return [(n, mine[{first: second, second: first}.get(n, n)]) for n, d in entries], f"{first} and {second} exchanged"


def _raw(rng: random.Random, data: bytes, other: bytes) -> tuple[bytes, str]:
    """Changes of the file without a right checksum, and of what stands before it."""
    kind = rng.randrange(8)
    raw = bytearray(data)
    if kind == 0:
        raw[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
        return bytes(raw), "a bit of the file turned"
    if kind == 1:
        return data[: rng.randrange(len(data))], "cut off"
    if kind == 2:
        return rng.choice([b"\n", b"x", b"\xef\xbb\xbf", bytes(64)]) + data, "bytes before the file"
    if kind == 3:
        return data + rng.choice([b"\n", b"x", bytes(64), data]), "bytes behind the file"
    if kind == 4:
        return rng.choice([b"", b"\n" * 70, b"lava-vpr", data[:20], bytes(10_000)]), "hardly anything"
    magic, _, payload = data.split(b"\n", 2)
    if kind == 5:
        odd = [b"lava-vpr model 2", b"lava-vpr \x1b[31m 1", b"lava-vpr checkpoint 1", b"lava-vpr references 1"]
        return sealed(rng.choice([*odd, b"lava-vpr model 1", magic + b"\r"]), payload), "another kind of file"
    if kind == 6:
        return sealed(magic, rng.choice([b"", payload[:30], bytes(5000), b"PK\x05\x06" + bytes(18)])), "another payload"
    return other, "another file in its place"


def changed(rng: random.Random, data: bytes, others: Mapping[str, bytes]) -> tuple[bytes, str]:
    """A changed container, in most cases with a right checksum, and what was changed.

    Args:
        rng: Decides everything.
        data: An honest container.
        others: Other honest ones, for exchanges.
    """
    magic, entries = taken_apart(data)
    other = others[rng.choice(sorted(others))]
    draw = rng.random()
    if draw < 0.32:
        made, told = _header(rng, entries)
    elif draw < 0.72:
        made, told = _array(rng, entries)
    elif draw < 0.82:
        made, told = _entries(rng, entries, taken_apart(other)[1])
    elif draw < 0.91:
        packed, told = archives.changed(rng, entries)
        return sealed(magic, packed), told
    elif draw < 0.918:
        packed, told = archives.bomb(rng, entries)
        return sealed(magic, packed), told
    else:
        return _raw(rng, data, other)
    return sealed(magic, archives.zipped(made)), told
