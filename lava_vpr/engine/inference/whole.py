"""From pixels to places in one run: the spiking front end, and the neurons of places that hear its cells themselves.

The populations are those of the front end, then the neurons of places, ``exc``, and the one that inhibits them,
``inh``. What Lava's Processes and boards are made of; a query needs the kernels beside alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference import counting
from lava_vpr.engine.inference.direct import SILENCING
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError
from lava_vpr.inputs.front_end import BURST, FrontEnd
from lava_vpr.loihi import NO_MEMORY_DECAY, THRESHOLD_LIMIT

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

    from lava_vpr.inputs.front_end_network import NeuronGroup

COUNTED = 2
"""What a spike adds to its counter, in units of a weight; no presentation is long enough for one to spike."""


@dataclass(frozen=True)
class WholeNetwork(FrontEnd):
    """A front end, and the network that hears its cells.

    Attributes:
        network: The network (`FixedNetwork.direct`).
        counted: Whether each neuron of places has a counter, ``counters``, whose membrane a board reads.
    """

    network: FixedNetwork | None = field(default=None, repr=False, compare=False)
    counted: bool = False

    @classmethod
    def of(cls, spec: FrontEnd, network: FixedNetwork, *, counted: bool = False) -> WholeNetwork:
        """``spec`` with the ``network`` of places.

        Raises:
            NetworkLimitError: the network is of another front end.
        """
        cells = spec.populations["cells"]
        if (network.inputs, network.steps, network.rising) != (cells, spec.ticks, spec.rising):
            raise NetworkLimitError("the network does not hear the cells of this front end; train the model again")
        return cls(**settings_of(spec), network=network, counted=counted)

    @cached_property
    def places(self) -> FixedNetwork:
        """The network.

        Raises:
            NetworkLimitError: there is none.
        """
        if self.network is None:
            raise NetworkLimitError("there is no network behind the front end; give one")
        return self.network

    @property
    def populations(self) -> dict[str, int]:
        """See `FrontEnd.populations`."""
        neurons = self.places.neurons
        return super().populations | {"exc": neurons, "inh": 1} | ({"counters": neurons} if self.counted else {})

    def further_groups(self) -> dict[str, NeuronGroup]:
        """The populations that hear the cells; see `lava_vpr.inputs.front_end_network.populations`."""
        from lava_vpr.inputs.front_end_network import NeuronGroup  # a query needs no scipy

        network = self.places
        found = {
            "exc": NeuronGroup(network.neurons, network.threshold, *network.bias_registers, du=0, dv=network.decay),
            "inh": NeuronGroup(1, 0, du=NO_MEMORY_DECAY, dv=0),
        }
        return found | ({"counters": NeuronGroup(network.neurons, THRESHOLD_LIMIT - 1)} if self.counted else {})

    def further_weights(self) -> dict[tuple[str, str], csr_matrix]:
        """Their synapses; see `lava_vpr.inputs.front_end_network.all_weights`."""
        from scipy.sparse import csr_matrix, identity  # see `further_groups`

        network, ones = self.places, np.ones((1, self.places.neurons), np.int64)
        clock = np.zeros((network.neurons, self.populations["clock"]), np.int64)
        clock[:, network.rising - 1 : network.steps - 1] = network.rise
        clock[:, network.steps - 1 :] -= SILENCING // 2
        made = {
            ("clock", "exc"): clock,
            ("cells", "exc"): network.weights.T.astype(np.int64),
            ("exc", "inh"): ones,
            ("inh", "exc"): -network.lateral * ones.T,
        }
        found = {way: csr_matrix(weights) for way, weights in made.items()}
        if self.counted:
            found["exc", "counters"] = COUNTED * identity(network.neurons, np.int64, "csr")
        return found

    def trains(self, grey: NDArray[np.uint8], bias: NDArray[np.int32] | None = None) -> dict[str, NDArray[np.uint8]]:
        """See `FrontEnd.trains`; biases are int32 (n, neurons), by default the network's."""
        films = super().trains(grey)
        cells, step = films["cells"], np.arange(self.steps)[:, None]
        spikes = cells.sum(axis=1, dtype=np.uint16)
        first = np.where(cells > 0, step, self.steps).min(axis=1)
        bursts = np.where(spikes > 0, first * BURST + spikes, 0).astype(np.uint16)
        keys = np.zeros(len(grey), np.uint64)
        _, _, films["exc"] = counting.count_spikes(self.places, bursts, keys, bias=bias, raster=True)
        films["inh"] = counting.inhibitory_spikes(self.places, films["exc"])
        if self.counted:
            films["counters"] = np.zeros_like(films["exc"])
        return films


def counts_of(spec: WholeNetwork, grey: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Spike counts of the neurons of places, int32 (n, neurons); as those of `WholeNetwork.trains`, with less memory.

    Args:
        spec: The network.
        grey: What its pixels take of each image (`FrontEnd.seen`), uint8 (n, height, width).
    """
    made = [spec.burst_codes(spec.bursts_of(shown)).reshape(-1) for shown in grey]
    bursts = np.array(made, np.uint16).reshape(len(grey), spec.places.inputs)
    return counting.count_spikes(spec.places, bursts, np.zeros(len(grey), np.uint64))[0]


def settings_of(spec: FrontEnd) -> dict[str, Any]:
    """The settings of a front end by name, without what hears it."""
    return {each.name: getattr(spec, each.name) for each in fields(FrontEnd)}
