"""What a test asks of the stand-in."""

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
