"""A stand-in for Intel's closed lava-loihi, for tests alone: a "chip" that runs Lava's own bit-accurate models.

Written from what lava-nc 0.10 and public examples show of lava-loihi: where Lava looks for its modules, which classes
they must have, and how its run configurations, compiler and runtime treat them. Nothing here is Intel's. Put this
folder's parent on the search path for modules, ahead of lava-nc's, and Lava takes it for lava-loihi.

The environment variable STANDIN_LOIHI names a JSON file with options: ``weights`` (a .npy file that the excitatory
Dense must hold), ``log`` (a file that is told what was placed and run), ``refuse`` (a list: Vars are not "set", neurons
take no "arrays" of values, "reset" clears nothing), ``step`` and ``fault`` (what goes wrong in which step: see
`standin_chip.chip.FAULTS`).
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any


def options() -> dict[str, Any]:
    """The options of STANDIN_LOIHI; none without it."""
    path = os.environ.get("STANDIN_LOIHI")
    return dict(json.loads(Path(path).read_text(encoding="utf-8"))) if path else {}


def note(line: str) -> None:
    """Add a line to the log, if there is one."""
    path = options().get("log")
    if path:
        with Path(path).open("a", encoding="utf-8") as log:
            log.write(line + "\n")
