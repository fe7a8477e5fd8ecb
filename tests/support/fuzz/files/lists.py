"""Honest lists of images, ground truths and positions, and their mutations.

Used by storage and support.
"""

from __future__ import annotations

import io
import json
import random
from collections.abc import Callable

import numpy as np
from support.fuzz.files import arrays, texts, values

PLACES = 6
PATHS = tuple(f"../query/img{k}.png" for k in range(PLACES))
NEAR = [[k] if k % 2 else [k, (k + 1) % PLACES] for k in range(PLACES)]
METRES = [(10.0 * k, 2.5 * k) for k in range(PLACES)]


def _npy(array: object) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.asarray(array))
    return buffer.getvalue()


HONEST: dict[str, bytes] = {
    "list.txt": "".join(f"{path}\n" for path in ("# images", *PATHS)).encode(),
    "plain.csv": "".join(f"{path},{k}\n" for k, path in enumerate(PATHS)).encode(),
    "list.csv": ("number,image,weather\n" + "".join(f"{k},{p},sun\n" for k, p in enumerate(PATHS))).encode(),
    "truth.txt": "".join(f"{k}: {' '.join(map(str, near))}\n" for k, near in enumerate(NEAR)).encode(),
    "truth.csv": ("query,places\n" + "".join(f"{k},{';'.join(map(str, n))}\n" for k, n in enumerate(NEAR))).encode(),
    "truth.json": json.dumps({str(k): near for k, near in enumerate(NEAR)}).encode(),
    "truth-list.json": json.dumps(NEAR).encode(),
    "truth.npy": _npy(np.arange(PLACES)),
    "truth-pairs.npy": _npy([(k, place) for k, near in enumerate(NEAR) for place in near]),
    "truth-matrix.npy": _npy(np.eye(PLACES, dtype=bool)),
    "positions.csv": ("x,y\n" + "".join(f"{x},{y}\n" for x, y in METRES)).encode(),
    "plain-positions.csv": "".join(f"{x},{y}\n" for x, y in METRES).encode(),
    "degrees.csv": ("lat,lon\n" + "".join(f"{50 + x / 1e5},{8 + y / 1e5}\n" for x, y in METRES)).encode(),
    "track.gpx": "".join(
        (
            '<?xml version="1.0"?>\n<gpx version="1.1" creator="a">\n<trk><trkseg>\n',
            *(f'<trkpt lat="{50 + x / 1e5}" lon="{8 + y / 1e5}"><ele>1</ele></trkpt>\n' for x, y in METRES),
            "</trkseg></trk>\n</gpx>\n",
        )
    ).encode(),
}
"""Lists of images, truths of six queries and places, positions."""

IMAGE_LISTS = ("list.txt", "list.csv", "plain.csv")

ODD_CELLS = (
    "",
    " ",
    "nan",
    "inf",
    "-inf",
    "1e999",
    "-1",
    "7",
    "1000000",
    "9" * 10_000,
    "0.5",
    "1_0",
    "٣",
    "x",
    '"',
    '"a""b"',
    '"unclosed',
    "a\0b",
    "\r",
    "a\rb",
    "\x1b[31m",
    "\u2028",
    "\ufeff",
    "../query",
    "/dev/zero",
    "../query/missing.png",
    "../reference/img0.png",
    "x" * 5000,
    "../" * 3000,
    "#",
    "0:1",
    "../list.txt",
    "~/img.png",
    "file:///etc/passwd",
    "concat:a|b",
    "pipe:0",
)
ODD_LINES = (
    "",
    "#",
    "image",
    "image,image",
    "x,y,x",
    "lat,lon,x,y",
    "a,b,c,d,e,f,g",
    '"',
    '"a\nb"',
    ",,,,",
    ";",
    "7: 6 7 8",
    "7",
    ": 1",
    "0: 0",
    "\0",
    "\r",
    "\x0c",
    "\x85",
    "../query/img0.png,../query/img1.png",
    "name;image",
    "x" * 140_000,
)


def _lines(rng: random.Random, text: str) -> tuple[str, str]:
    return texts.lines_changed(rng, text, ODD_LINES)


def _cell(rng: random.Random, text: str) -> tuple[str, str]:
    """One cell replaced, added or dropped."""
    lines = text.split("\n")
    at = rng.choice([k for k, line in enumerate(lines) if line] or [0])
    separator = next((s for s in (",", " ") if s in lines[at]), ",")
    cells = lines[at].split(separator)
    column, kind = rng.randrange(len(cells)), rng.randrange(4)
    new = rng.choice(ODD_CELLS)
    if kind == 0 and len(cells) > 1:
        gone = cells.pop(column)
        told = f"cell {gone[:20]!r} dropped"
    elif kind == 1:
        cells.insert(column, new)
        told = f"cell {new[:20]!r} added"
    else:
        told = f"cell {cells[column][:20]!r} becomes {new[:20]!r}"
        cells[column] = new
    lines[at] = separator.join(cells)
    return "\n".join(lines), told


def _bytes(rng: random.Random, text: str) -> tuple[bytes, str]:
    """Changes of the bytes."""
    raw = text.encode("utf-8", "surrogatepass")
    at, kind = rng.randrange(len(raw) or 1), rng.randrange(11)
    if kind == 0:
        return raw[:at] + bytes([raw[at] ^ 1 << rng.randrange(8)]) + raw[at + 1 :], "a bit turned"
    if kind == 1:
        return raw[:at], "cut off"
    if kind == 2:
        odd = rng.choice([b"\0", b"\r", b"\xff", b"\x1b[2J", b"\xed\xa0\x80", b'"', b"\x0c", b"\xe2\x80\xa8"])
        return raw[:at] + odd + raw[at:], f"{odd!r} added"
    if kind == 3:
        return text.encode(rng.choice(["utf-16", "utf-32", "utf-16-le"]), "surrogatepass"), "UTF-16 or 32"
    if kind == 4:
        return b"\xef\xbb\xbf" + raw, "BOM"
    if kind == 5:
        return raw.replace(b"\n", b"\r\n"), "CRLF"
    if kind == 6:
        return raw.replace(b"\n", b"\r"), "CR"
    if kind == 7:
        return rng.choice([b"", b"\n\n", b"\0" * 100, b"#\n", b"\xff" * 50, b'"' * 999]), "hardly anything"
    if kind == 8:
        return raw.replace(b",", rng.choice([b";", b"\t", b"|", b", "])), "another separator"
    if kind == 9:
        return raw.replace(
            b"../query", rng.choice([b"..\\query", b"../query/.", b".//../query", b"../query\0"])
        ), "paths"
    return raw * 300, "300 times"


_TEXT_CHANGES: tuple[tuple[float, Callable[[random.Random, str], tuple[str | bytes, str]]], ...] = (
    (2, _lines),
    (4, _cell),
    (2, _bytes),
)


def changed(rng: random.Random, name: str) -> tuple[bytes, str]:
    """The changed content of the honest file ``name``, and what was changed."""
    data = HONEST[name]
    if name.endswith(".npy"):
        return arrays.changed(rng, arrays.read(data))
    if name.endswith(".json") and rng.random() < 0.7:
        return values.changed(rng, json.loads(data))
    weights, changes = zip(*_TEXT_CHANGES, strict=True)
    made, told = rng.choices(changes, weights)[0](rng, data.decode())
    return (made.encode("utf-8", "surrogatepass") if isinstance(made, str) else made), told
