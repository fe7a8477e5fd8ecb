"""Events of a board for each query, counted by step and core from every spike and the mapping.

The register-level simulation counts the same from registers and memory; `tests/deploy/cost/test_events.py` holds the
two against each other. A message belongs to the step of its spike: it is sent, received and meets its row in that step,
and the sum counts in the next.

**What is an update.** Every mapped compartment is accessed in every step, and updated under one of two definitions:

- `EventCounts.updates`, as the register-level simulation counts: the sum that arrived, the membrane or the bias is not
  0. A neuron with a bias is updated in every step.
- `EventCounts.touched`, as SANA-FE 2.2.9 counts (``models.cpp``, ``LoihiLifModel::update``): a stored synapse was
  delivered to the compartment, even if its weight or the sum of all is 0, or membrane or bias is not 0.

The two differ by a handful in a million. Inhibitory neurons, and relays of injected spikes, have no memory: they are
updated when a spike arrives, and spike in that step. Directly injected inputs have no compartments, so none are
accessed or updated.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.cost.event_kernels import KINDS, Counts, Routes, count_presentation
from lava_vpr.deploy.mapping.partition import tiles
from lava_vpr.engine.inference import counting, fixed
from lava_vpr.engine.inference.membranes import membranes
from lava_vpr.engine.presentations import Trains


@dataclass(frozen=True)
class EventCounts:
    """Events of some queries, int64 (n, steps, cores) in the order of the plan's cores; steps include the silent ones.

    Attributes:
        messages_in: Spikes that arrive, those of inputs included.
        input_messages: The messages in that carry an input's spike: injected, or sent by an input's compartment, and
            then among ``messages_out`` of its core, too.
        injected_messages: The messages in that are injected: no core of the plan sends them.
        operations_dense, operations_sparse: Synaptic operations by the format of the row that was met: all stored
            synapses of a dense row, the weights that are not 0 of a sparse one.
        updates, touched: Compartments updated, by two definitions; see the module.
        spikes: Spikes of compartments.
        messages_out: Messages sent, one for each target core of a spike, its own core included.
        read_outs: The messages out that go to counters; 0 where the vendor's library reads spikes out.
        crossings: Messages out to another chip.
        hops_east_west, hops_north_south: Tiles that messages out cross; 0 where the mesh is not public.
        input_hops_east_west, input_hops_north_south: Tiles that input messages cross, by destination.
        injected_hops_east_west, injected_hops_north_south: Tiles that injected messages cross, by destination.
        input_updates: The ``updates`` of input compartments.
        accesses: Compartments mapped (a read-only view: the same in every step).
        input_accesses: The accesses of input compartments.
        input_spikes, exc_spikes, inh_spikes: int64 (n, steps).
        injected: Whether input spikes are injected.
        tiles: Tiles in use; None: the mesh is not public.
    """

    messages_in: Counts = field(repr=False)
    input_messages: Counts = field(repr=False)
    injected_messages: Counts = field(repr=False)
    operations_dense: Counts = field(repr=False)
    operations_sparse: Counts = field(repr=False)
    updates: Counts = field(repr=False)
    touched: Counts = field(repr=False)
    spikes: Counts = field(repr=False)
    messages_out: Counts = field(repr=False)
    read_outs: Counts = field(repr=False)
    crossings: Counts = field(repr=False)
    hops_east_west: Counts = field(repr=False)
    hops_north_south: Counts = field(repr=False)
    input_hops_east_west: Counts = field(repr=False)
    input_hops_north_south: Counts = field(repr=False)
    injected_hops_east_west: Counts = field(repr=False)
    injected_hops_north_south: Counts = field(repr=False)
    input_updates: Counts = field(repr=False)
    accesses: Counts = field(repr=False)
    input_accesses: Counts = field(repr=False)
    input_spikes: Counts = field(repr=False)
    exc_spikes: Counts = field(repr=False)
    inh_spikes: Counts = field(repr=False)
    injected: bool
    tiles: int | None

    @property
    def queries(self) -> int:
        """The number of queries that were counted."""
        return int(self.updates.shape[0])

    @property
    def steps(self) -> int:
        """The steps of a presentation, silent ones included."""
        return int(self.updates.shape[1])

    def each(self, name: str) -> NDArray[np.int64]:
        """The sum over steps and cores of the events ``name``, int64 (n,)."""
        values = getattr(self, name)
        return np.asarray(values.sum(axis=tuple(range(1, values.ndim)), dtype=np.int64))


def routes(plan: Plan, entry: tuple[int, int] | None = None) -> Routes:
    """Target cores and rows of every spike; see `count_events`."""
    network, total = plan.network, len(plan.cores)
    homes = {"exc": network.neurons, "counters": network.neurons, "inh": network.inhibitory, "inputs": network.inputs}
    home = {name: np.full(size, -1, np.int64) for name, size in homes.items()}
    for k, core in enumerate(plan.cores):
        for part in core.parts:
            home[part.population][part.first : part.first + part.size] = k
    stored = np.zeros(network.weights.shape, np.uint8)
    input_rows, root_rows = np.zeros((network.inputs, total, 2), np.int64), np.zeros((total, 2), np.int64)
    for k, core in enumerate(plan.cores):
        here = home["exc"] == k
        present = network.weights[:, here] != 0
        kept = present | (core.dense_inputs & present.any(axis=1))[:, None]
        stored[:, here] = kept
        synapses = kept.sum(axis=1)
        input_rows[:, k, 0] = np.where(core.dense_inputs, synapses, 0)
        input_rows[:, k, 1] = np.where(core.dense_inputs, 0, synapses)
        if network.inhibition:
            root_rows[k, 1] = here.sum()
    return Routes(
        home["exc"],
        np.repeat(home["inh"], fixed.FAN_IN)[: network.neurons],
        plan.board.counters,
        home["inh"][:-1],
        int(home["inh"][-1]),
        home["inputs"],
        network.relayed,
        input_rows,
        root_rows,
        stored,
        (network.bias != 0).astype(np.uint8),
        *_ways(plan, entry),
    )


def _ways(plan: Plan, entry: tuple[int, int] | None) -> tuple[Counts, Counts]:
    """The hops and crossings between all cores of the plan: ``ways`` and ``entry`` of `Routes`."""
    board, count = plan.board, len(plan.cores)
    cores = np.array([(core.chip, core.core) for core in plan.cores], np.int64).reshape(-1, 2)
    ways, first = np.zeros((count, count, 3), np.int64), np.zeros((count, 2), np.int64)
    ways[..., 0] = cores[:, None, 0] != cores[None, :, 0]
    if board.mesh is not None:
        positions = tiles(cores, board)
        ways[..., 1:] = np.abs(positions[:, None] - positions[None, :])
        corner = np.stack([cores[:, 0] * board.mesh.columns, np.zeros(count, np.int64)], axis=1)
        first = np.abs(positions - (corner if entry is None else np.array(entry)))
    return ways, first


def _bits(trains: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """``trains`` in the type that the kernels take."""
    return np.ascontiguousarray(trains).view(np.uint8)


def count_events(
    plan: Plan,
    trains: Trains,
    *,
    entry: tuple[int, int] | None = None,
    bias: NDArray[np.int32] | None = None,
) -> EventCounts:
    """Count the events on the cores of ``plan`` for given spikes.

    Args:
        plan: The network on its cores.
        trains: Every spike of exc and inputs, uint8 (n, interval, width); those of inh follow from exc.
        entry: Column and row of the tile from which input spikes are injected; None: tile 0 of the chip they go to.
        bias: Biases of each presentation, int32 (n, neurons); None: always the network's.
    Raises:
        ValueError: the trains are not those of this network.
    An input compartment whose start membrane and bias are both exactly 0 counts as updated (a start membrane has
    512,000 values).
    """
    network, inputs, exc = plan.network, trains.inputs, trains.exc
    shapes = [(network.interval, network.inputs), (network.interval, network.neurons)]
    if inputs is None or [inputs.shape[1:], exc.shape[1:]] != shapes:
        raise ValueError("trains hold no input spikes, or are not those of the plan's network")
    where, shape = routes(plan, entry), (*exc.shape[:2], len(plan.cores))
    counted = np.zeros((*shape, len(KINDS)), np.int64)
    inh = counting.inhibitory_spikes(network, _bits(exc))
    for query, (spikes, fired, pulled) in enumerate(zip(_bits(inputs), _bits(exc), inh, strict=True)):
        own = network.bias if bias is None else np.ascontiguousarray(bias[query])
        replayed, where = membranes(network, spikes, pulled, own), where._replace(biased=(own != 0).astype(np.uint8))
        differ = (replayed.fired != (fired != 0)).any(axis=1)
        if differ.any():
            step = int(differ.argmax())
            raise ValueError(f"query {query}: the spikes of step {step} are not those of the plan's network")
        count_presentation(where, network.steps, spikes, fired, pulled, replayed.after, counted[query])
    mesh, places = plan.board.mesh, [(core.chip, core.core) for core in plan.cores]
    mapped = np.array([sum(part.size for part in core.parts) for core in plan.cores], np.int64)
    mapped_inputs = np.array([core.part("inputs").size for core in plan.cores], np.int64)
    arrays: dict[str, Any] = {name: np.ascontiguousarray(counted[..., kind]) for kind, name in enumerate(KINDS)}
    return EventCounts(
        **arrays,
        accesses=np.broadcast_to(mapped, shape),
        input_accesses=np.broadcast_to(mapped_inputs, shape),
        input_spikes=inputs.sum(axis=2, dtype=np.int64),
        exc_spikes=exc.sum(axis=2, dtype=np.int64),
        inh_spikes=inh.sum(axis=2, dtype=np.int64),
        injected=not network.bias_input,
        tiles=None if mesh is None else len({(chip, core // mesh.tile_cores) for chip, core in places}),
    )
