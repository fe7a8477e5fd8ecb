"""The spiking front ends that settings name."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from lava_vpr.inputs.front_end import FrontEnd

FRONT_END = FrontEnd()
"""The front end of the default settings."""
EVENT_FRONT_END = FrontEnd(levels=8, white=20, pixel_octaves=3.0, race=15, window=16)
"""The front end of the input ``frontend-events``, as `benchmarks.events.lens` chose it."""
HEARD: Mapping[str, Any] = {"joined": 2, "needed": 3, "top": 0.85, "pixel_octaves": 4.5}
"""Numbers of a front end whose cells neurons hear directly, as `benchmarks.front_end.direct` chose them; half as many
pairs, for the energy of a step."""


@lru_cache(maxsize=8)
def front_end(levels: int, race: int, reading: int = 0) -> FrontEnd:
    """The front end of these settings, whose numbers are worked out once."""
    return FrontEnd(levels=levels, race=race, reading=reading, **(HEARD if reading else {}))
