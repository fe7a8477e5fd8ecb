"""Custom Lava Processes, one folder each with ``process.py`` and ``models.py`` (import as `lava_vpr.processes`).

``from lava_vpr.processes import PoissonEncoder, PlaceNetwork``: every Process can be imported from here; Lava itself is
imported only when one is. docs/lava.md lists them.
"""

from __future__ import annotations

import importlib
from typing import Any

_FOLDERS = {
    "PoissonEncoder": "poisson_encoder",
    "BiasInputs": "bias_input",
    "DenseSynapses": "dense_synapses",
    "ExcitatoryLIF": "excitatory_lif",
    "InhibitoryLIF": "inhibitory_lif",
    "OneToOne": "one_to_one",
    "LateralInhibition": "lateral_inhibition",
    "SpikeCounter": "spike_counter",
    "PlaceNetwork": "place_network",
    "LibraryPlaceNetwork": "library_network",
    "FusedPlaceNetwork": "fused_network",
    "PlasticDense": "plastic_dense",
    "LearningPlaceNetwork": "learning_network",
    "LibraryLearningNetwork": "library_learning",
    "FinePoissonEncoder": "fine_poisson_encoder",
    "ConductanceLIF": "conductance_lif",
    "DelayedDense": "delayed_dense",
    "ConductancePlastic": "conductance_plastic",
    "ConductancePlaceNetwork": "conductance_network",
}

__all__ = list(_FOLDERS)


def __getattr__(name: str) -> Any:
    """The Process called ``name``."""
    if name not in _FOLDERS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_FOLDERS[name]}.process"), name)
