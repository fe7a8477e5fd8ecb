"""What a bundle's manifest says of its files, held against types and limits before one of them is opened."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

from lava_vpr.errors import brief
from lava_vpr.settings.ranges import whole
from lava_vpr.storage.limits import excess
from lava_vpr.storage.reading import parse_json

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]*(/[A-Za-z0-9_][A-Za-z0-9._-]*)*")
_DIGEST = re.compile(r"[0-9a-f]{64}")
_LONGEST = 200


class Facts(NamedTuple):
    """The length of a file, and its SHA-256 in hexadecimal."""

    length: int
    digest: str


class BundleLimitError(ValueError):
    """A bundle is beyond a limit; the message says how that is raised."""


def strict_json(data: bytes) -> Any:
    """The value of JSON of which two readers cannot think differently.

    Raises:
        ValueError: no JSON, or one that breaks its reader (`lava_vpr.storage.reading.parse_json`), or an object that
            says a key twice.
    """
    return parse_json(data, object_pairs_hook=_without_repeats)


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("an object says a key twice")
    return found


def listed_files(value: object, reserved: str) -> dict[str, Facts]:
    """The files that a manifest lists, by name.

    Names are of plain letters, digits, ``.``, ``_`` and ``-``, lead below the folder, and differ by more than case.

    Args:
        value: What the manifest says.
        reserved: A name that none may have.
    Raises:
        BeyondError: it is beyond the limits.
        ValueError: it is no such list; fit for a message, as in "FILE: lists ..".
    """
    if not isinstance(value, dict):
        raise ValueError(f"lists {brief(value)} instead of its files")
    beyond = excess("bundle_files", len(value))
    if beyond is not None:
        raise BundleLimitError(f"lists {beyond}")
    known, seen = {}, {reserved.lower()}
    for name, facts in value.items():
        if not _NAME.fullmatch(name) or len(name) > _LONGEST or name.lower() in seen:
            raise ValueError(f"names {brief(name)}, which is not in the bundle")
        seen.add(name.lower())
        known[name] = _facts(name, facts)
    beyond = excess("bundle_bytes", sum(facts.length for facts in known.values()))
    if beyond is not None:
        raise BundleLimitError(f"lists {beyond}")
    return known


def _facts(name: str, value: object) -> Facts:
    """What the manifest says of the file ``name``."""
    if not isinstance(value, dict) or set(value) != {"bytes", "sha256"}:
        raise ValueError(f"says {brief(value)} of {name}, not its bytes and sha256")
    length, digest = value["bytes"], value["sha256"]
    if not whole(length) or length < 0:
        raise ValueError(f"says that {name} has {brief(length)} bytes")
    if not isinstance(digest, str) or not _DIGEST.fullmatch(digest):
        raise ValueError(f"says the SHA-256 {brief(digest)} of {name}")
    return Facts(length, digest)
