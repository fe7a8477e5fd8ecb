"""Phases of a step in which an embedded program runs."""

from enum import Enum


class Phase(Enum):
    """The two that public programs use."""

    EMBEDDED_SPIKING = 1
    EMBEDDED_MGMT = 2
