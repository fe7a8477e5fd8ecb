"""Modelled costs of a presentation of the spiking front end, by population; nothing was measured.

Counted are its spikes and what follows from them: synaptic operations in the board's storage of synapses, messages (one
for each target row of a spike), accesses of neurons (all of them in each step, silent ones included), and an upper
bound of updates, which a neuron has from the first step with an arriving spike or a bias on. Cores are those of
`deploy.mapping.front_end`; hops of messages are left out, since these cores have no positions on the mesh.

Costs between two presentations are separate: the registers of an image's pixels, states that are cleared, and the
counts of cells, which the host reads to compute rates.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, identity

from lava_vpr.deploy.boards.board import LifReset
from lava_vpr.deploy.boards.constants import CostConstants, Estimate, Level, total
from lava_vpr.deploy.cost.embedded import BIAS_ACCESSES, ROOM, Accesses, received, sent
from lava_vpr.deploy.mapping.front_end import EVENTS, PlacedFrontEnd, Rows, on_cores
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_network import populations
from lava_vpr.loihi import NO_MEMORY_DECAY

COUNTS_OF_CELLS, COUNTS_OF_EXC, BIASES_OF_EXC = "counts of cells", "counts of exc", "biases of exc"
"""Names of the registers that are read after a presentation: counts of cells, or of the neurons of places that hear
these; and of those that are written before it where the network adapts."""
Floats = NDArray[np.float64]
Films = Mapping[str, NDArray[np.uint8]]


class LayerEvents(NamedTuple):
    """Events of a population in a presentation, means over the images, with its neurons and stored synapses.

    Attributes:
        neurons, synapses: Their numbers.
        active: Steps in which any of its neurons spikes.
        spikes, operations, accesses, updates, messages: Events of a presentation.
    """

    neurons: int
    synapses: int
    active: float
    spikes: float
    operations: float
    accesses: int
    updates: float
    messages: float

    def microjoules(self, constants: CostConstants) -> Estimate:
        """Dynamic energy, uJ."""
        counted = (
            (constants.synapse_sparse, self.operations),
            (constants.access, self.accesses),
            (constants.update, self.updates),
            (constants.spike, self.spikes),
            (constants.message, self.messages),
        )
        return total(constant * (events / 1e6) for constant, events in counted)


@dataclass(frozen=True)
class FrontEndCosts:
    """A presentation of the front end on a board; energies and times None where its constants are not public.

    Attributes:
        board: The name of the board.
        images: Images that were counted.
        steps: Steps of a presentation.
        cores: Cores of all populations, none of which share a core.
        layers: Events of each population by name.
        registers: Registers written or read for an image, by purpose: ``pixels`` (or ``events``, spikes that are sent),
            ``clearing of states``, ``counts of cells`` (or ``counts of exc``), ``biases of exc``.
        packets: Packets of the host for an image: those of the pixels or events, and of the counts.
        dynamic_microjoules: Of the steps, by population.
        between_microjoules: Of the registers, by purpose, without hops on the mesh.
        step_microseconds: Of a step, mean: the busiest core and the barrier.
        milliseconds: Of all steps.
        between_milliseconds: Of the registers, by purpose, while the cores wait; packets of the host included.
        static_millijoules: Energy that all chips draw in all this time.
    """

    board: str
    images: int
    steps: int
    cores: int
    layers: Mapping[str, LayerEvents]
    registers: Mapping[str, int]
    packets: int
    dynamic_microjoules: Mapping[str, Estimate] | None = None
    between_microjoules: Mapping[str, Estimate] | None = None
    step_microseconds: Estimate | None = None
    milliseconds: Estimate | None = None
    between_milliseconds: Mapping[str, Estimate] | None = None
    static_millijoules: Estimate | None = None

    @property
    def all(self) -> LayerEvents:
        """The events of all populations; active in every step that has a spike of any, as the clock has."""
        summed = LayerEvents(*map(sum, zip(*self.layers.values(), strict=True)))
        return summed._replace(active=max(each.active for each in self.layers.values()))

    def as_json(self) -> dict[str, Any]:
        """The figures by name, as scripts read them."""
        values = {key: value for key, value in vars(self).items() if key != "board"}
        return values | {"layers": {name: each._asdict() for name, each in self.layers.items()}}


AT_ONCE = 20
"""Images whose spikes are in memory at once, twice 2 MB each."""


def front_end_costs(spec: FrontEnd, plan: PlacedFrontEnd, images: PixelBlock) -> FrontEndCosts:
    """Modelled costs of a presentation on the board of ``plan``.

    Args:
        spec: The front end.
        plan: The placed front end.
        images: At least one.
    """
    board, constants, grey = plan.board, plan.board.constants, images.grey
    blocks = [_counted(spec, plan, block) for block in images.in_parts(AT_ONCE)]
    found = {
        name: _Counted._make(map(np.concatenate, zip(*(each[name] for each in blocks), strict=True)))
        for name in plan.populations
    }
    layers = {name: found[name].events(plan.populations[name].stored, len(grey)) for name in found}
    events = float(spec.events(grey).sum()) / len(grey) if spec.window else 0.0
    registers = registers_between(spec, plan, events, adapted=images.bias is not None)
    packets = sum(-(-words // ROOM) for words in _words(spec, registers).values())
    costs = FrontEndCosts(board.name, len(grey), spec.steps, plan.cores, layers, registers, packets)
    if constants is None or board.mesh is None:
        return costs
    tiles = -(-plan.cores // board.mesh.tile_cores)
    step = Estimate.of(lambda level: float(np.mean(_step_microseconds(found.values(), constants, tiles, level))))
    between = _between_milliseconds(spec, registers, constants)
    steps = step * (spec.steps / 1e3)
    chips = (constants.static + constants.embedded) * board.chips
    time = steps + total(between.values())
    write = constants.message + constants.access + constants.update
    return replace(
        costs,
        dynamic_microjoules={name: each.microjoules(constants) for name, each in layers.items()},
        between_microjoules={what: write * (count / 1e6) for what, count in registers.items()},
        step_microseconds=step,
        milliseconds=steps,
        between_milliseconds=between,
        static_millijoules=Estimate.of(lambda level: chips.at(level) * time.at(level) / 1e3),
    )


def registers_between(spec: FrontEnd, plan: PlacedFrontEnd, events: float, *, adapted: bool) -> dict[str, int]:
    """Registers of cores that are written or read for an image, by purpose.

    A bias is read and written; each of the ``events`` is a spike that is sent. All states that last are cleared,
    membranes and currents separately, unless the board resets its neurons. Where the network is ``adapted``, so are the
    biases of the neurons of places, which follow from counts of cells.
    """
    sizes, kept = spec.populations, 0
    for group in populations(spec).values():
        kept += group.size * ((group.du != NO_MEMORY_DECAY) + (group.dv != NO_MEMORY_DECAY))
    pixels = BIAS_ACCESSES * sizes["pixels"] + plan.populations["pixels"].cores
    adaptation = {}
    if adapted:
        biases = BIAS_ACCESSES * sizes["exc"] + plan.populations["exc"].cores
        adaptation = {COUNTS_OF_CELLS: sizes["cells"], BIASES_OF_EXC: biases}
    return {
        **({EVENTS: round(events)} if spec.window else {"pixels": pixels}),
        "clearing of states": 0 if isinstance(plan.board.clearing, LifReset) else kept,
        COUNTS_OF_EXC if "exc" in sizes else COUNTS_OF_CELLS: sizes.get("exc", sizes["cells"]),
        **adaptation,
    }


class _Counted(NamedTuple):
    """Events of a population's cores in every step, (n, steps, cores) each."""

    operations: Floats
    messages_in: Floats
    messages_out: Floats
    spikes: Floats
    updates: Floats
    accesses: Floats

    def events(self, stored: int, images: int) -> LayerEvents:
        """Events of a presentation, mean over the images."""
        active = float(self.spikes.any(axis=2).sum()) / images
        spikes, operations, updates, messages = (
            float(each.sum()) / images for each in (self.spikes, self.operations, self.updates, self.messages_out)
        )
        neurons, accesses = int(self.accesses[0, 0].sum()), int(self.accesses[0].sum())
        return LayerEvents(neurons, stored, active, spikes, operations, accesses, updates, messages)


def _counted(spec: FrontEnd, plan: PlacedFrontEnd, images: PixelBlock) -> dict[str, _Counted]:
    """The events of every population."""
    grey = images.grey
    films, found, homes = spec.trains(*images), dict[str, _Counted](), dict[str, csr_matrix]()
    if spec.window:
        films[EVENTS] = spec.events(grey).astype(np.uint8)
    spiked = {name: csr_matrix(film.reshape(-1, film.shape[2]), dtype=np.int32) for name, film in films.items()}
    for name, each in plan.populations.items():
        shape = (len(grey), spec.steps, each.cores)
        homes[name] = on_cores(identity(each.neurons, np.int32, "csr"), each.starts)
        spikes = (spiked[name] @ homes[name].T).toarray().reshape(shape).astype(np.float64)
        first = _first_updates(spec, name, films, plan.rows)
        begun = np.zeros((len(grey), spec.steps + 1, each.cores))
        np.add.at(begun, (np.arange(len(grey))[:, None], first, np.repeat(np.arange(each.cores), each.sizes)), 1)
        sizes = np.broadcast_to(each.sizes.astype(np.float64), shape)
        found[name] = _Counted(
            np.zeros(shape), np.zeros(shape), np.zeros(shape), spikes, begun.cumsum(axis=1)[:, :-1], sizes
        )
    for (source, target, _), row in plan.rows.items():
        to = on_cores(row, plan.populations[target].starts)
        reached = to.astype(bool).astype(np.int32)
        for values, kept in ((to, found[target].operations), (reached, found[target].messages_in)):
            kept[:, 1:] += (spiked[source] @ values.T).toarray().reshape(kept.shape)[:, :-1]
        if source == EVENTS:
            continue
        sent = homes[source].multiply(reached.sum(axis=0)).tocsr()
        found[source].messages_out[:] += (spiked[source] @ sent.T).toarray().reshape(found[source].spikes.shape)
    return found


def _first_updates(spec: FrontEnd, name: str, films: Films, rows: Rows) -> NDArray[np.int64]:
    """The step of the first update of each neuron of a population, int64 (n, neurons); the number of steps without
    any."""
    group = populations(spec)[name]
    biased = np.full(group.size, name == "pixels" and not spec.window)
    if group.bias is not None:
        biased |= group.bias != 0
    n = len(films[name])
    first = np.where(biased, 0, np.full((n, group.size), spec.steps))
    for (source, target, _), row in rows.items():
        if target == name:
            film, reached = films[source], np.diff(row.indptr) > 0
            times = np.where(film.any(axis=1), film.argmax(axis=1) + 1, spec.steps)
            arrived = np.minimum.reduceat(times[:, row.indices], row.indptr[:-1][reached], axis=1)
            first[:, reached] = np.minimum(first[:, reached], arrived)
    return first


def _step_microseconds(found: Iterable[_Counted], constants: CostConstants, tiles: int, level: Level) -> Floats:
    """Time of every step, us, float64 (n, steps): that of arriving spikes or of neurons on the busiest core."""
    longest = np.zeros(())
    for each in found:
        arrivals = constants.arrival_nanoseconds(level, each.messages_in, 0.0, each.operations)
        neurons = constants.neuron_nanoseconds(level, each.accesses, each.updates, each.spikes, each.messages_out)
        longest = np.maximum(longest, np.maximum(arrivals, neurons).max(axis=2) / 1e3)
    return np.maximum(longest + constants.barrier(tiles).at(level), constants.step.at(level))


def _words(spec: FrontEnd, registers: Mapping[str, int]) -> dict[str, int]:
    """Words that the host sends or receives, by purpose: one per pixel, event, bias and count."""
    sizes = spec.populations
    words = {"pixels": sizes["pixels"], "clearing of states": 0, BIASES_OF_EXC: sizes.get("exc", 0)}
    return {what: words.get(what, count) for what, count in registers.items()}


def _between_milliseconds(
    spec: FrontEnd, registers: Mapping[str, int], constants: CostConstants
) -> dict[str, Estimate]:
    """Time of an image's registers by purpose: packets of the host, and the work of an embedded processor."""
    found = {}
    for what, words in _words(spec, registers).items():
        handled = sent(words) if what in (COUNTS_OF_CELLS, COUNTS_OF_EXC) else received(words)
        processor = Accesses(registers[what], handled).nanoseconds(constants) * 1e-6
        found[what] = constants.host_message * (-(-words // ROOM) / 1e3) + processor
    return found
