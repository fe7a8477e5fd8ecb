"""Stand-in for the builder of C Processes."""

from __future__ import annotations

from standin_chip.building import BoardBuilder


class CProcessBuilder(BoardBuilder):
    """A C Process on the board."""
