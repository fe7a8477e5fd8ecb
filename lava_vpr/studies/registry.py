"""The registry of studies."""

from __future__ import annotations

from lava_vpr.errors import ConfigError
from lava_vpr.rows.registry import Registry
from lava_vpr.studies import decoding, learning, several
from lava_vpr.studies.study import Study

STUDIES: Registry[Study] = Registry("study", ConfigError)
"""All studies by name."""
for _study in (
    learning.PLACES_STUDY,
    learning.NEURONS,
    decoding.WEIGHTING,
    learning.BITS,
    learning.STEPS,
    decoding.SEEDS,
    several.HYPERACTIVE,
    several.ENSEMBLE,
):
    STUDIES.register(_study)
