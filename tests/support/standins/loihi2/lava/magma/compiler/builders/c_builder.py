"""Stand-in for the builder of C Processes."""

from standin_chip.building import BoardBuilder


class CProcessBuilder(BoardBuilder):
    """A C Process on the board."""
