"""Stand-in for a kind of channel that nothing here uses."""


class PyNcChannel:
    """Not made."""
