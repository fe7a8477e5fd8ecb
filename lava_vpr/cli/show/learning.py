"""How the commands show that a route is being learned."""

from __future__ import annotations

from lava_vpr.cli.common import progress_bar, stage, stderr
from lava_vpr.training.stretches import Monitor

TERMINAL = Monitor(stderr.print, progress_bar, stage)
"""Notes on stderr; bars and stages on a terminal."""
