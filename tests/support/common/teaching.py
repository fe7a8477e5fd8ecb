"""Answers that teach on a drive of a few images. Used by backends, bench, benchmarks, cli and deploy."""

from __future__ import annotations

import pytest

from lava_vpr.backends import teaching
from lava_vpr.engine import gains


def teach_quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Until the end of the test answers of all sorts teach, and two are enough."""
    monkeypatch.setattr(gains, "EPOCH", 2)
    monkeypatch.setattr(gains, "ENOUGH", 1)
    monkeypatch.setattr(teaching, "ALONE", 0.0)
    monkeypatch.setattr(teaching, "TRACKED", 0.0)
