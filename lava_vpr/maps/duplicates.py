"""Images that a map has already, or would twice: a map that learns them again is half as sure of their places."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Sequence

from lava_vpr.errors import InputError, shown
from lava_vpr.training.loop import LearnedRoute

_NOTES = logging.getLogger("lava_vpr")
NAMED = 3
"""Duplicates that a message names."""


def check_duplicates(routes: Sequence[LearnedRoute], allowed: bool, *, learning: bool = False) -> None:
    """Refuse images that are, as the network sees them, those of a route before theirs.

    Args:
        routes: The parts of a map, in order; blank images are not compared.
        allowed: Whether duplicates are only reported.
        learning: Whether the last route is yet to be learned, so that none may show an image of its own before, either.
    Raises:
        InputError: there are some, and they are not allowed.
    """
    known, again = dict[bytes, str](), list[str]()
    for route in routes:
        first, own = route.references[0], dict[bytes, str]()
        for name, index, seen in zip(first.names, first.indices.tolist(), first.activity, strict=True):
            if seen.any():
                digest = hashlib.blake2b(seen.tobytes(), digest_size=16).digest()
                before = known.get(digest) or (own.get(digest) if learning and route is routes[-1] else None)
                again += [f"{shown(name)} is {before}"] if before else []
                own.setdefault(digest, f"place {index} ({shown(name)})")
        known = own | known
    if not again:
        return
    added, more = sum(len(route.references[0]) for route in routes[1:]), len(again) - NAMED
    named = ", ".join(again[:NAMED]) + (f", and {more:,} more" if more > 0 else "")
    said = f"{len(again):,} of the {added:,} places added show images that the map has already: {named}"
    if not allowed:
        raise InputError(f"{said}; leave them out, or add --allow-duplicates (in Python allow_duplicates=True)")
    _NOTES.warning(said)
