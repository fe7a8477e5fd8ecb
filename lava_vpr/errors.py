"""Every error that a user can cause, as one line that says what is wrong, with what, and what to do.

The command line turns a `LavaVprError` into that line and exit code 1; anything else is a defect of ours.
"""

from __future__ import annotations


class LavaVprError(Exception):
    """Base of all errors whose cause lies outside this program."""


class InputError(LavaVprError):
    """Images, lists, videos, ground truth or descriptors that cannot be used."""


class ConfigError(LavaVprError):
    """A setting outside its range, or settings that contradict each other."""


class ModelFileError(LavaVprError):
    """A model or checkpoint file that is missing, damaged, foreign or does not fit what it is used for."""


class BundleError(ModelFileError):
    """A bundle that is missing, damaged, altered, foreign or not for the board that is to run it."""


class NetworkLimitError(LavaVprError):
    """A network that would overflow the chip's registers, or exceed another of its limits."""


class BackendUnavailableError(LavaVprError):
    """A backend whose software or device is not here."""


class LavaRunError(LavaVprError):
    """A run of Lava that failed, was killed or took too long.

    Attributes:
        traceback: The traceback inside Lava, or what its log said last; empty if there is none.
    """

    def __init__(self, message: str, traceback: str = "") -> None:
        super().__init__(message)
        self.traceback = traceback
