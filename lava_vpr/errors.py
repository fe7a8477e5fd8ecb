"""Every error that a user can cause, as one line that says what is wrong, with what, and what to do.

The command line turns a `LavaVprError` into that line and exit code 1; anything else is a defect of ours. Values, paths
and texts from files are made fit for that line here.
"""

from __future__ import annotations

import os
import reprlib
from pathlib import Path
from typing import Any


class LavaVprError(Exception):
    """Base of all errors whose cause lies outside this program."""


class InputError(LavaVprError):
    """Images, lists, videos, ground truth or descriptors that cannot be used."""


class UnreadableError(InputError):
    """One image file of many that cannot be read; the others may well be (`lava_vpr.traverse.readable`)."""


class UnplacedError(UnreadableError):
    """A photo that does not say where it was taken; others may."""


class UsageError(InputError):
    """Options or arguments that exclude each other, or that lack one another: wrong usage, whatever the data."""


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


class ClusterError(LavaVprError):
    """A cluster that cannot be reached, has no workers or other ones than it takes, or was lost; or a task that failed
    there."""


class PluginError(LavaVprError):
    """What a package brings failed, and it is to blame; what it raised is the cause."""


class LavaRunError(LavaVprError):
    """A run of Lava that failed, was killed or took too long.

    Attributes:
        traceback: The traceback inside Lava, or what its log said last; empty if there is none.
    """

    def __init__(self, message: str, traceback: str = "") -> None:
        super().__init__(message)
        self.traceback = traceback


class _Brief(reprlib.Repr):
    """What `brief` shows: few elements, few levels, and of whole numbers too long to print their size."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother = 2, 60, 60
        self.maxdict = self.maxlist = self.maxtuple = self.maxset = self.maxfrozenset = self.maxarray = 4

    def repr_int(self, x: int, level: int) -> str:
        """``x``, or how long it is."""
        return f"a number of {x.bit_length()} bits" if x.bit_length() > 128 else repr(x)

    def repr_instance(self, x: Any, level: int) -> str:
        """``x``; of numpy's scalars their value, as numpy 1 shows them, not their type as numpy 2 does."""
        value = x.item() if getattr(x, "shape", None) == () else x
        return super().repr_instance(x, level) if type(value) is type(x) else self.repr1(value, level)


_BRIEF = _Brief()


def brief(value: object) -> str:
    """A ``value`` that a file or a caller gave, for a message: one short printable line whatever it is."""
    text = _BRIEF.repr(value)
    return text if text.isprintable() else repr(text)


_LONGEST = 400


def shown(path: str | Path) -> str:
    """``path`` for a one-line message: characters that would break the line or the terminal are escaped.

    Of what is longer than `_LONGEST` characters then, the middle is left out.
    """
    text = str(path)
    text = text if text.isprintable() else repr(text)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST // 3]}...{text[-_LONGEST // 2 :]}"


def said(error: BaseException) -> str:
    """What an ``error`` says that may quote a file, for a message: one short printable line, its type if it is none."""
    return harmless(" ".join(str(error).split())[:200]) or type(error).__name__


def harmless(text: str) -> str:
    """``text`` with every character that no terminal should be sent (controls, escapes, surrogates) as its escape.

    Line ends and tabs stay.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in text)


def printable(path: str) -> str:
    """The name of a file without its folder; bytes that are no text are replaced, since no JSON, CSV or terminal takes
    the surrogates that stand for them."""
    return os.fsencode(os.path.basename(path)).decode("utf-8", "replace")
