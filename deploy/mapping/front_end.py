"""Placement of the spiking front end's populations on cores of their own, with rows that share no weights.

No board's program runs them yet (docs/network.md): this counts what they take of its public limits. Each population is
on as few cores as hold its neurons in order; compartments, input axons and synapse memory limit the neurons of a core.
Rows are sparse: a synapse is a weight, its sign and an index. A weight of more bits is stored as two synapses, its
upper part in a separate row with an exponent, so that no row has two synapses to one neuron.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.memory import row_words
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_network import all_weights, event_synapses, populations
from lava_vpr.loihi import WEIGHT_EXPONENT_LIMIT

Integers = NDArray[np.int64]
Way = tuple[str, str, int]
"""Source, target and exponent of synapses: a row has one exponent."""
Rows = Mapping[Way, csr_matrix]
"""Weights of synapses by way, int32 (post, pre), none of them 0: each source neuron has a row on each core."""
EVENTS = "events"
"""The source of synapses whose spikes come from a camera."""
NO_AXONS = "no public source shows how events of a camera come to axons of the chip"
"""The reason why no bundle holds a front end that events drive."""
LIMITS = ("compartments", "axons in", "synapse memory")
"""Limits of a core, as `PlacedPopulation.binds` names them."""


@dataclass(frozen=True)
class PlacedPopulation:
    """A population on cores of its own.

    Attributes:
        neurons: Its neurons.
        stored: Stored synapses to them; two for a weight of too many bits.
        starts: The first neuron of each core, int64 (cores,).
        binds: The limit that one more neuron on its fullest core would exceed; empty if one core holds all.
        compartments, axons_in, memory, axons_out: Largest use of a core; memory as a share, 0..1.
    """

    neurons: int
    stored: int
    starts: Integers = field(repr=False)
    binds: str
    compartments: int
    axons_in: int
    memory: float
    axons_out: int = 0

    @property
    def cores(self) -> int:
        """The number of its cores."""
        return len(self.starts)

    @property
    def sizes(self) -> Integers:
        """Neurons of each core, int64 (cores,)."""
        return np.diff(np.append(self.starts, self.neurons))


@dataclass(frozen=True)
class PlacedFrontEnd:
    """The front end on a board.

    Attributes:
        board: The board.
        populations: Each population by name.
        steps: Steps of a presentation.
        rows: The rows of all cores.
    """

    board: Board
    populations: Mapping[str, PlacedPopulation]
    steps: int
    rows: Rows = field(repr=False)

    @property
    def cores(self) -> int:
        """Cores of all populations."""
        return sum(each.cores for each in self.populations.values())

    def exceeded(self, others: int = 0) -> str:
        """The limit that the front end exceeds beside a network on ``others`` cores, or on any core; empty if it
        fits."""
        have = self.board.chips * self.board.cores
        for name, each in self.populations.items():
            if each.axons_out > self.board.axons_out:
                return f"a core of {name} has {each.axons_out:,} axons out, of {self.board.axons_out:,}"
        if self.cores + others > have:
            return f"{self.cores} cores and {others} of the network, but {self.board.title} has {have}"
        return ""

    def as_json(self, others: int) -> dict[str, Any]:
        """The figures by name, beside a network on ``others`` cores."""
        keys = ("neurons", "stored", "cores", "binds", "compartments", "axons_in", "memory", "axons_out")
        exceeded = self.exceeded(others)
        return {
            "fits": None if not (exceeded or self.board.memory.public) else not exceeded,
            "exceeded": exceeded or None,
            "cores": self.cores,
            "steps": self.steps,
            "populations": {name: {key: getattr(each, key) for key in keys} for name, each in self.populations.items()},
        }


def placed(spec: FrontEnd, board: Board) -> PlacedFrontEnd:
    """Place the front end on cores of ``board``, each population separately."""
    rows = stored_rows(spec, board)
    most = dict.fromkeys(spec.populations, board.compartments)
    to = {name: [each for way, each in rows.items() if way[1] == name] for name in most}
    found = {name: _on_cores(board, size, most[name], to[name]) for name, size in spec.populations.items()}
    while True:
        axons = {name: _axons_out(name, rows, found) for name in found}
        many = [name for name, out in axons.items() if out > board.axons_out and found[name].compartments > 1]
        if not many:
            break
        for name in many:  # fewer neurons of a core send to fewer others
            fewer = found[name].compartments * board.axons_out // axons[name]
            found[name] = replace(_on_cores(board, found[name].neurons, max(1, fewer), to[name]), binds="axons out")
    return PlacedFrontEnd(
        board, {name: replace(each, axons_out=axons[name]) for name, each in found.items()}, spec.steps, rows
    )


def _axons_out(name: str, rows: Rows, found: Mapping[str, PlacedPopulation]) -> int:
    """Most output axons of a population's core: one for each row of each neuron; counters have none."""
    sent = [on_cores(row, found[target].starts) for (source, target, _), row in rows.items() if source == name]
    if not sent:
        return 0
    axons = sum(np.asarray(cores.astype(bool).sum(axis=0)).ravel() for cores in sent)
    return int(np.add.reduceat(axons, found[name].starts).max())


def largest_weight(board: Board) -> int:
    """The largest weight of a synapse, whose sign takes one of its bits unless a row has one sign."""
    return (1 << (max(board.weight_bits) - (not board.memory.one_sign))) - 1


def stored_rows(spec: FrontEnd, board: Board) -> dict[Way, csr_matrix]:
    """Weights of either sign as rows of ``board`` store them: the stored weights of a synapse, times 2^exponent, add up
    to its weight.

    The chip has no threshold of 0: it becomes 1, and excitatory weights to its neurons are doubled. A weight that
    silences for a presentation becomes the largest of one synapse, so that an accumulator holds it with everything else
    of a step.
    """
    groups, largest, found = populations(spec), largest_weight(board), {}
    events = {(EVENTS, "pixels"): event_synapses(spec)} if spec.window else {}
    for (source, target), weights in {**events, **all_weights(spec)}.items():
        whole = weights if groups[target].threshold else weights + weights.maximum(0)
        whole = whole.maximum(-(largest << WEIGHT_EXPONENT_LIMIT))
        size = abs(whole.data)
        upper = np.where(size > largest, size >> WEIGHT_EXPONENT_LIMIT, 0)
        for exponent, part in ((0, size - (upper << WEIGHT_EXPONENT_LIMIT)), (WEIGHT_EXPONENT_LIMIT, upper)):
            data = (np.sign(whole.data) * part).astype(np.int32)
            row = csr_matrix((data, whole.indices, whole.indptr), whole.shape, copy=True)
            row.eliminate_zeros()
            if row.nnz:
                found[source, target, exponent] = row
    return found


def on_cores(synapses: csr_matrix, starts: Integers) -> csr_matrix:
    """Number of ``synapses`` (post, pre) that end on each core, (cores, pre); ``starts`` are the cores' first
    neurons."""
    ends = np.append(starts, synapses.shape[0])
    members = csr_matrix((np.ones(ends[-1], np.int32), np.arange(ends[-1]), ends))
    return members @ synapses.astype(bool)


def _on_cores(board: Board, neurons: int, at_once: int, rows: Sequence[csr_matrix]) -> PlacedPopulation:
    """A population with these rows, in order on as few cores as hold it, at most ``at_once`` neurons each."""
    starts, most, binds, start = [], np.zeros(3), "", 0
    while start < neurons:
        least, end = start + 1, min(neurons, start + at_once)
        while least < end and _exceeded(board, _taken(board, rows, start, end)):  # more neurons take more of everything
            middle = (least + end + 1) // 2
            least, end = (least, middle - 1) if _exceeded(board, _taken(board, rows, start, middle)) else (middle, end)
        starts.append(start)
        most = np.maximum(most, _taken(board, rows, start, end))
        if end < neurons and not binds:
            binds = _exceeded(board, _taken(board, rows, start, end + 1))
        start = end
    compartments, axons_in, memory = most.tolist()
    stored = sum(each.nnz for each in rows)
    share = memory / board.memory.capacity
    return PlacedPopulation(neurons, stored, np.array(starts), binds, int(compartments), int(axons_in), share)


def _taken(board: Board, rows: Sequence[csr_matrix], start: int, end: int) -> tuple[int, int, int]:
    """Compartments, input axons and memory that the neurons ``start`` .. ``end - 1`` take of a core."""
    counts = []
    for each in rows:
        sizes = np.bincount(each.indices[slice(*each.indptr[[start, end]])])
        counts.append(sizes[sizes > 0])
    bits, index = max(board.weight_bits), board.memory.sparse_bits(end - start)
    words = sum(int((bits * each if index is None else row_words(each, bits + index)).sum()) for each in counts)
    return end - start, sum(map(len, counts)), words


def _exceeded(board: Board, taken: tuple[int, int, int]) -> str:
    """The first limit of a core that is exceeded; empty if none."""
    limits = (board.compartments, board.axons_in, board.memory.capacity)
    return next((name for name, need, limit in zip(LIMITS, taken, limits, strict=True) if need > limit), "")
