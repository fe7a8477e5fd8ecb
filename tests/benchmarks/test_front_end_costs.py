"""What a presentation of the spiking front end costs, counted anew synapse by synapse."""

from __future__ import annotations

import numpy as np

from benchmarks.front_end.costs import events_of
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_network import populations, synapses


def test_events_of_each_layer_are_those_that_its_spikes_make() -> None:
    """In an image with an edge, one after the other: a spike reaches every target of its neuron in the step after."""
    spec = FrontEnd(width=8)
    grey = np.tile(np.array([20, 20, 20, 30, 200, 200, 220, 220], np.uint8), (2, spec.height, 1))
    grey[1] = grey[1, :, ::-1]
    films, found = spec.trains(grey), events_of(spec, grey)
    arrived = {name: np.zeros((len(grey), spec.steps + 1, n), bool) for name, n in spec.populations.items()}
    operations = dict.fromkeys(spec.populations, 0)
    for each in synapses(spec):
        targets, sources = each.weights.nonzero()
        for target, source in zip(targets, sources, strict=True):
            spikes = films[each.source][:, :, source].astype(bool)
            operations[each.target] += int(spikes.sum())
            arrived[each.target][:, 1:, target] |= spikes
    arrived["pixels"][:, 0] = True  # which integrate their grey level
    arrived["clock"][:, 0, 0] = True
    for name, one in found.items():
        assert one.neurons == populations(spec)[name].size
        assert one.spikes == films[name].sum() / 2
        assert one.operations == operations[name] / 2
        updated = np.maximum.accumulate(arrived[name][:, : spec.steps], axis=1)
        assert one.updates == updated.sum() / 2
    assert sum(one.accesses for one in found.values()) == spec.accesses
    assert found["cells"].spikes > 0
    constants = KAPOHO_BAY.constants
    assert constants is not None
    pairs = found["pairs"]
    expected = constants.access.nominal * pairs.accesses + constants.update.nominal * pairs.updates
    expected += constants.spike.nominal * pairs.spikes + constants.synapse_sparse.nominal * pairs.operations
    assert np.isclose(pairs.microjoules(constants, "nominal"), expected / 1e6)
