"""Sources as `lava-vpr watch` takes them. Used by core, images, watch."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lava_vpr.readers import Frame, open_source


def watched(source: str | Path, **options: Any) -> Iterator[Frame]:
    """The images of a source as they come."""
    return open_source(str(source), live=True, **options).frames()
