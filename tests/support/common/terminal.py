"""A terminal in the place of this process's streams.

Used by cli.
"""

from __future__ import annotations

import io
import re
import sys

import pytest

from lava_vpr.cli import common


class Terminal(io.StringIO):
    """What a terminal was sent."""

    def isatty(self) -> bool:
        return True

    @property
    def said(self) -> str:
        """The text, without colours and moves."""
        return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", self.getvalue())


def opened(monkeypatch: pytest.MonkeyPatch, width: int = 200) -> Terminal:
    """A terminal of so many columns until the end of the test; not from a fixture: pytest puts its own streams back.

    The console of the commands stays the same object, in another state: a module that is loaded meanwhile keeps it.
    """
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    other = common.PlainConsole(file=shown, width=width, force_terminal=True)
    monkeypatch.setattr(common.stderr, "__dict__", vars(other))
    return shown
