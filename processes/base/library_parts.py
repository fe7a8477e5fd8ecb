"""Parts of a place network from Lava's own library that its library networks have in common."""

from __future__ import annotations

import numpy as np
from lava.proc.lif.process import LIFReset
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode
from scipy.sparse import identity

from lava_vpr.loihi import NO_MEMORY_DECAY
from lava_vpr.processes.base.wiring import RELAY_WEIGHT


def reset_each(interval: int) -> dict[str, int]:
    """The arguments by which a LIFReset falls back to 0 in the steps 1, ``interval`` + 1, and so on."""
    return {"reset_interval": interval, "reset_offset": 1}


def relays(neurons: int, interval: int, floating: bool = False) -> tuple[Sparse, LIFReset]:
    """The synapses from exc to inh, one to one, and inh: relays without memory, reset each ``interval`` steps.

    Args:
        neurons: Number of relays.
        interval: Steps of a presentation.
        floating: For a run with the tag ``floating_pt``, whose models take decays as fractions.
    """
    weights = RELAY_WEIGHT * identity(neurons, dtype=float if floating else np.int32, format="csr")
    no_memory = 1.0 if floating else NO_MEMORY_DECAY
    inh = LIFReset(shape=(neurons,), du=no_memory, dv=no_memory, vth=0, **reset_each(interval))
    return Sparse(weights=weights, sign_mode=SignMode.EXCITATORY), inh
