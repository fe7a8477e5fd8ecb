"""What differs between two records, and where two captures differ first."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from golden.record import parts_of

MOST = 8  # lines or keys that are shown of a part
WIDEST = 160  # characters of a line


def differing(old: dict[str, Any], new: dict[str, Any], captures: Sequence[Path] = ()) -> Iterator[str]:
    """Lines on every part of every case whose entries in two records are not equal.

    Args:
        old, new: The records.
        captures: The folders that they are of: the lines, keys or bytes of each part that differ first are shown.
    """
    for key in sorted(old.keys() | new.keys()):
        before, after = old.get(key), new.get(key)
        if before == after:
            continue
        if before is None or after is None:
            yield f"{key}: is {'new' if before is None else 'not there any more'}"
            continue
        yield f"{key}: {one_line(after['command'])}"
        if captures:
            before, after = (
                _whole(entry, folder, key) for entry, folder in zip((before, after), captures, strict=True)
            )
        for name in {**before, **after}:
            if before.get(name) != after.get(name):
                yield f"  {name}"
                yield from (f"    {line}" for line in _part(before.get(name), after.get(name)))


def _whole(entry: dict[str, Any], captured: Path, key: str) -> dict[str, Any]:
    """The entry of a case with what its streams and files hold."""
    told = {name: entry[name] for name in ("command", "code", "lost", "left behind") if name in entry}
    return told | dict(parts_of(captured / key, key))


def _part(before: Any, after: Any) -> list[str]:
    """Where two parts differ first: keys of JSON, lines of text, or bytes."""
    if not isinstance(before, bytes) or not isinstance(after, bytes):
        return ["is new"] if isinstance(after, bytes) else ["is gone"] if after is None else _lines(before, after)
    try:
        texts = before.decode(), after.decode()
    except UnicodeDecodeError:
        return [f"differs from byte {_common(before, after)} on; {len(before)} -> {len(after)} bytes"]
    try:
        old, new = (_flat(json.loads(text)) for text in texts)
    except ValueError:
        return _lines(*(text.splitlines() for text in texts))
    keys = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    shown = [one_line(f"{key}: {old.get(key, 'absent')} -> {new.get(key, 'absent')}") for key in keys[:MOST]]
    return shown + [f"... {len(keys)} keys differ"] * (len(keys) > MOST or not keys)


def _flat(value: Any, path: str = "") -> dict[str, Any]:
    """The values of a JSON object by their paths."""
    if isinstance(value, (dict, list)) and value:
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        below = (_flat(part, f"{path}.{name}" if path else f"{name}") for name, part in pairs)
        return {key: one for found in below for key, one in found.items()}
    return {path: value}


def _lines(before: Any, after: Any) -> list[str]:
    """The first lines that differ of two texts, or two values; a long one from where it differs."""
    old, new = ([] if one is None else one if isinstance(one, list) else [str(one)] for one in (before, after))
    found = [line for line in difflib.unified_diff(old, new, n=0, lineterm="") if line[:3] not in ("---", "+++")]
    found = [line for line in found if not line.startswith("@@")]
    common = _common(*(line[1:] for line in found)) if len(found) == 2 else 0
    start = max(0, common - WIDEST // 2)
    shown = [f"{line[0]}{'...' if start else ''}{line[1 + start :]}" for line in found[:MOST]]
    return [one_line(line) for line in shown] + ["..."] * (len(found) > MOST)


def _common(one: Sequence[object], other: Sequence[object]) -> int:
    """Up to where two sequences are equal."""
    pairs = enumerate(zip(one, other, strict=False))
    return next((k for k, (a, b) in pairs if a != b), min(len(one), len(other)))


def one_line(text: str) -> str:
    """A text on one line that is not too long."""
    line = " ".join(text.split())
    return line if len(line) <= WIDEST else f"{line[:WIDEST]}..."
