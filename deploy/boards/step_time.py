"""How long a core takes for what it does in one step: the one formula of the mapping and of the cost model.

Nanoseconds by SANA-FE's ``simple`` timing: what arrives on a core, and what its neurons do and send, overlap; a step
lasts as long as the longest of either on any core, and the barrier after it (`deploy.cost.closed_form`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.constants import CostConstants
from lava_vpr.deploy.boards.estimate import Level

Number = float | NDArray[Any]
"""A count, or the counts of many steps and cores."""


def arrival_nanoseconds(
    constants: CostConstants, level: Level, messages_in: Number, operations_dense: Number, operations_sparse: Number
) -> NDArray[np.float64]:
    """The time of messages received, and of their synaptic operations by the format of the rows."""
    return np.asarray(
        constants.message_in_time.at(level) * messages_in
        + constants.synapse_dense_time.at(level) * operations_dense
        + constants.synapse_sparse_time.at(level) * operations_sparse
    )


def neuron_nanoseconds(
    constants: CostConstants, level: Level, accesses: Number, updates: Number, spikes: Number, messages_out: Number
) -> NDArray[np.float64]:
    """The time of compartments accessed and updated, of their spikes, and of messages sent."""
    return np.asarray(
        constants.access_time.at(level) * accesses
        + constants.update_time.at(level) * updates
        + constants.spike_time.at(level) * spikes
        + constants.message_time.at(level) * messages_out
    )
