"""What the spiking front end costs a query, layer by layer, by the constants of Kapoho Bay; nothing was measured.

    LAVA_VPR_DATA=... python -m benchmarks front_end.costs [--record]

Spikes of winter images of Nordland are counted, and what they make: synaptic operations, accesses of neurons (each in
each step, silent ones included), and updates, which a neuron takes from the first step on in which something arrives
or it has a bias, so at most. Every row of synapses counts as sparse. Messages, their ways and what writes pixels wait
for neurons on cores, so no figure has them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.places import FOLDERS, images_of
from benchmarks.program import BenchmarkTable, Printed, program
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.boards.constants import CostConstants, Level
from lava_vpr.errors import ConfigError
from lava_vpr.inputs.front_end import FRONT_END, FrontEnd
from lava_vpr.inputs.front_end_network import populations, synapses
from lava_vpr.traverse import open_traverse

IMAGES = slice(0, 500, 25)
FORMS = {
    "all": FRONT_END,
    "all, with 16 levels and a race of 8 steps": dataclasses.replace(FRONT_END, levels=16, race=8),
}
"""What totals are printed of: the front end, and the shortest of the forms of `benchmarks.front_end.table`."""
LEVELS: tuple[Level, ...] = ("nominal", "low", "high")


class LayerEvents(NamedTuple):
    """What a population of neurons does in a presentation: neurons and synapses to them; the rest are means of images.

    Attributes:
        neurons, synapses: Their numbers.
        spikes, operations, accesses, updates: Events of a presentation.
    """

    neurons: int
    synapses: int
    spikes: float
    operations: float
    accesses: int
    updates: float

    def microjoules(self, constants: CostConstants, level: Level) -> float:
        """Dynamic energy, uJ."""
        counted = (
            (constants.synapse_sparse, self.operations),
            (constants.access, self.accesses),
            (constants.update, self.updates),
            (constants.spike, self.spikes),
        )
        return sum(constant.at(level) * events for constant, events in counted) / 1e6


def events_of(spec: FrontEnd, grey: NDArray[np.uint8]) -> Mapping[str, LayerEvents]:
    """The events of each population, for what its pixels take of each image, uint8 (n, height, width)."""
    films, (n, steps) = spec.trains(grey), (len(grey), spec.steps)
    found: dict[str, LayerEvents] = {}
    to = {name: [each for each in synapses(spec) if each.target == name] for name in films}
    for name, group in populations(spec).items():
        operations, first = 0.0, np.full((n, group.size), steps)
        if name == "pixels" or group.bias is not None:
            first[:, np.ones(group.size, bool) if group.bias is None else group.bias != 0] = 0
        for each in to[name]:
            fan_out = np.diff(each.weights.tocsc().indptr)
            operations += float((films[each.source].sum(axis=1) @ fan_out).sum())
            reached = each.weights.astype(bool).astype(np.int32)
            for number, film in enumerate(films[each.source]):
                times = np.where(film.any(axis=0), film.argmax(axis=0) + 1, steps)
                arrive = reached.multiply(steps - times).max(axis=1).toarray().ravel()
                first[number] = np.minimum(first[number], steps - arrive)
        spikes, updates = float(films[name].sum()) / n, float((steps - first).sum()) / n
        count = sum(each.weights.nnz for each in to[name])
        found[name] = LayerEvents(group.size, count, spikes, operations / n, group.size * steps, updates)
    return found


@program("nordland")
def main() -> Printed:
    """Neurons, synapses, spikes, operations, accesses, updates and energy of each layer."""
    constants = KAPOHO_BAY.constants
    winter = list(open_traverse(images_of("nordland", FOLDERS["nordland"][1])).images())[IMAGES]
    if constants is None:
        raise ConfigError(f"no costs of {KAPOHO_BAY.name} are known")
    grey = np.stack([FRONT_END.seen(image) for image in winter])
    found: dict[str, LayerEvents] = {}
    for title, spec in FORMS.items():
        layers = events_of(spec, grey)
        found |= layers if spec is FRONT_END else {}
        found[title] = LayerEvents(*map(sum, zip(*layers.values(), strict=True)))
    rows = []
    for name, one in found.items():
        energy = {level: one.microjoules(constants, level) for level in LEVELS}
        cell = f"{energy['nominal']:.1f} ({energy['low']:.1f} to {energy['high']:.1f})"
        rows.append([name, *(f"{value:,.0f}" for value in one), cell])
    heads = ("neurons", "synapses", "spikes", "synaptic operations", "accesses", "updates, at most")
    yield BenchmarkTable(["population", *heads, "dynamic, modelled, µJ"], rows, record="front-end-costs")
