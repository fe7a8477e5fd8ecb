"""What a walk over the structure of an image or a video raises."""

from __future__ import annotations

from lava_vpr.errors import InputError
from lava_vpr.storage.limits import excess


class DamagedError(Exception):
    """The file's structure is incomplete; the text says how."""


def within(limit_name: str, amount: int) -> None:
    """Refuse a file that has more of something than the limit of this name allows.

    Raises:
        InputError: it has; the text lacks the file's name.
    """
    beyond = excess(limit_name, amount)
    if beyond is not None:
        raise InputError(f"has {beyond}")
