"""Stand-in for the builder of Nc Processes."""

from standin_chip.building import BoardBuilder


class NcProcessBuilder(BoardBuilder):
    """A Nc Process on the board."""
