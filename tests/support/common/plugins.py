"""Packages of plug-ins for tests: how one is installed, and the code of one that reads.

Used by core.
"""

from __future__ import annotations

from collections.abc import Callable

Install = Callable[..., None]

READER = """
import numpy as np
from lava_vpr.images.sampling import Sample
from lava_vpr.readers import Found, Reader

def found(wanted):
    def walk():
        for number in range(9 if wanted.live else 7):
            yield Sample(number, number * wanted.every, lambda: np.full((40, 40), number, np.uint8))

    return Found((str(wanted.path),), walk, "scan")

SCANS = Reader("scans", "scans of a lidar", found, lambda path: path.suffix == ".scan", (".scan",))
"""
