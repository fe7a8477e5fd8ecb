"""What can be probed."""

from enum import Enum


class ProbeParameter(Enum):
    """Of the whole board."""

    ENERGY = 1
    EXECUTION_TIME = 2
