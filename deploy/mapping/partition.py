"""Assignment of neurons to cores: fewest cores, then fewest operations, then the least load on the busiest core.

The strategy, for k cores that hold excitatory neurons in consecutive ranges:

1. **The least k.** The needs of a range (compartments, axons, words with each row in its smaller format) grow with the
   range. So k cores reach the farthest neuron if each takes as many neurons as fit.
2. **Even ranges.** The k ranges are equal where that fits, else the longest is as short as possible.
3. **Inhibitory neurons**, then **input compartments** (relays, or what integrates a bias) are placed beside them as far
   as there is room, the others on cores of their own.

Larger k are tried as long as they can reduce the total of cores: more cores with excitatory neurons leave more room
beside these. Of the layouts on the fewest cores the one with the fewest operations is chosen, then the one with the
least busy core. If no layout fits, `refusal` names the resource that is exceeded, and remedies.

Then the cores are placed on the mesh of tiles, with few hops between them. Tile t of a chip is at column t // rows, row
t % rows, as SANA-FE 2.2.9 numbers them; core c is on tile c // 4. A message crosses as many tiles as there are columns
and rows between. How the chips of a board are connected is not public: they are assumed to be side by side, the second
chip's column 0 beside the first one's last.
"""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.memory import UNLIMITED, ByteBudget, PackedRows
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.mapping.layout import layout_of
from lava_vpr.deploy.mapping.placing import Placed, balanced, even, longest, place
from lava_vpr.deploy.mapping.sizing import EXC_SPIKES, Integers, Sizing, check, host_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError

_UNITS = 1 << 20
"""Levels of traffic between two cores, from none to the most, when exchanges are compared."""


def tiles(cores: Integers, board: Board) -> Integers:
    """Column and row of the tiles of ``cores`` (n, 2: chip, core), int64 (n, 2); columns go on from chip to chip.

    Raises:
        ValueError: the board's mesh is not public.
    """
    mesh = board.mesh
    if mesh is None:
        raise ValueError(f"the mesh of {board.title} is not public")
    tile = cores[:, 1] // mesh.tile_cores
    return np.stack([cores[:, 0] * mesh.columns + tile // mesh.rows, tile % mesh.rows], axis=1)


def distances(cores: Integers, board: Board) -> Integers:
    """Hops between any two of ``cores`` (n, 2: chip, core), int64 (n, n)."""
    positions = tiles(cores, board)
    return np.asarray(np.abs(positions[:, None] - positions[None, :]).sum(axis=2))


def assign_cores(traffic: NDArray[np.float64], board: Board) -> tuple[Integers, float | None]:
    """Chip and core of each of a plan's cores.

    The assignment starts with the tiles of a corner, as near to a square as possible, in the order given. Then the
    exchange of two cores that saves most is made, until none saves any. The first chip is filled before the second is
    used.

    Args:
        traffic: Expected messages in a step from core to core, float64 (cores, cores).
        board: The board; it has at least so many cores.
    Returns:
        Chip and core, int64 (cores, 2); and expected hops of messages in a step, None if the mesh is not public.
    """
    count = len(traffic)
    if board.mesh is None:
        numbers = np.arange(count)
        return np.stack([numbers // board.cores, numbers % board.cores], axis=1), None
    candidates = _candidates(count, board, board.mesh.tile_cores)
    between = distances(candidates, board).astype(np.float64)
    # Whole numbers have exact sums, so ties are the same on every machine.
    scale = _UNITS / max(float(traffic.max(initial=0.0)), 1e-12)
    flow = np.zeros((len(candidates), len(candidates)))
    flow[:count, :count] = np.round((traffic + traffic.T) * scale)
    np.fill_diagonal(flow, 0)
    order = _exchanged(flow, between)[:count]
    return candidates[order], float((traffic * between[np.ix_(order, order)]).sum())


def _candidates(count: int, board: Board, tile_cores: int) -> Integers:
    """Candidate chips and cores for ``count`` cores, int64 (>= count, 2): whole chips, then a growing square."""
    chips, left = [], count
    numbers = np.arange(board.cores)
    positions = tiles(np.stack([np.zeros_like(numbers), numbers], axis=1), board)
    by_square = np.lexsort((numbers, positions.sum(axis=1), positions.max(axis=1)))
    for chip in range(-(-count // board.cores)):
        cores = by_square[: -(-left // tile_cores) * tile_cores]
        chips.append(np.stack([np.full(cores.size, chip), cores], axis=1))
        left -= board.cores
    return np.concatenate(chips)


def _exchanged(flow: NDArray[np.float64], between: NDArray[np.float64]) -> Integers:
    """The candidate of each core after exchanges, int64 (cores,); ``flow`` is symmetric."""
    order = np.arange(len(flow))
    while True:
        near = between[np.ix_(order, order)]
        reach = flow @ near
        now = np.diag(reach)
        change = reach + reach.T - now[:, None] - now[None, :] + 2 * flow * near
        best = int(np.argmin(change))
        i, k = divmod(best, len(flow))
        if change[i, k] >= 0:
            return order
        order[[i, k]] = order[[k, i]]


_EQUALLY_FEW = 4
"""Most layouts on equally few cores that are compared."""

_EVERY = 8
"""Up to this number of cores with excitatory neurons, every number is tried; above it, fewer and fewer."""


def partition(
    network: FixedNetwork,
    board: Board,
    rates: NDArray[np.float64],
    *,
    exc_spikes: float = EXC_SPIKES,
    dense_rows: bool = False,
) -> Plan:
    """Place ``network`` on the cores of ``board``.

    Args:
        network: The network.
        board: The board.
        rates: Expected spikes of each input in a step, float64 (inputs,), at least 0.
        exc_spikes: Expected spikes of all excitatory neurons together in a step.
        dense_rows: Whether rows of inputs may be stored dense, without indices, which no public source shows.
    Raises:
        NetworkLimitError: it does not fit; the message names resource, need, limit and remedy.
        ValueError: ``rates`` are not those of the network's inputs.
    """
    if rates.shape != (network.inputs,) or not (rates >= 0).all():
        raise ValueError(f"rates of shape {rates.shape} for {network.inputs} inputs, or below 0")
    sizing = Sizing(network, board, rates, exc_spikes, dense_rows)
    check(sizing)
    found = [layout_of(sizing, balanced(sizing, placed)) for placed in ways(sizing)]
    layouts = [layout for layout in found if layout is not None]
    if not layouts:
        raise refusal(sizing)
    layout = min(layouts, key=attrgetter("costs"))
    positions, hops = assign_cores(layout.traffic(), board)
    order = np.lexsort((positions[:, 1], positions[:, 0]))
    cores = tuple(layout.core_plan(int(number), *positions[number].tolist()) for number in order)
    spikes = host_spikes(network, rates)
    return Plan(network, board, cores, sizing.weight_bits, sizing.inhibition_bits, hops, spikes)


def ways(sizing: Sizing) -> list[Placed]:
    """Layouts on the fewest cores found, by the number of cores with excitatory neurons."""
    found: list[Placed] = []
    most = sizing.board.chips * sizing.board.cores
    greedy = longest(sizing, most, sizing.largest)
    if greedy is None:
        return found
    least = cores = greedy.size - 1
    while cores <= min(most, sizing.network.neurons):
        for bounds in [even(sizing, cores, greedy)] + [greedy] * (cores == least):
            placed = place(sizing, bounds, most)
            if placed is not None and placed.cores < most:
                found, most = [], placed.cores
            if placed is not None and len(found) < _EQUALLY_FEW:
                found.append(placed)
        cores += 1 + max(0, cores - least - _EVERY) // 2
        if len(found) == _EQUALLY_FEW and cores >= most:
            break
    return found


def fewest_cores(sizing: Sizing) -> int | None:
    """Number of cores of a plan; None if the network does not fit."""
    found = ways(sizing)
    return found[0].cores if found else None


_TITLES = {
    "axons_in": "input axons",
    "axons_out": "output axons",
    "synapse_words": "words of synapse memory",
}
"""The limits of a core that more cores relieve, by their names in messages."""

_STARTS = 1 << 10
"""Ranges that are sized at once."""

_SHARES = (0.5, 0.6, 0.7, 0.8, 0.9)
"""Shares of pruned weights that are tried as a remedy."""


def refusal(sizing: Sizing) -> NetworkLimitError:
    """Why a network does not fit, with remedies, each of which has been tried."""
    return NetworkLimitError(f"{cause(sizing)}; {_remedy(sizing)}")


def cause(sizing: Sizing) -> str:
    """The resource that a network exceeds, with need and limit."""
    network, board = sizing.network, sizing.board
    cores = board.chips * board.cores
    total = (1 + sizing.counters) * network.neurons + network.inhibitory + network.input_compartments
    if total > cores * board.compartments:
        members = ["neurons"] + ["their counters"] * sizing.counters + ["inputs"] * bool(network.input_compartments)
        what = ", ".join(members[:-1]) + " and " * (len(members) > 1) + members[-1]
        have = cores * board.compartments
        return f"{what} need {total:,} compartments, but the {cores:,} cores of {board.title} have {have:,}"
    if isinstance(board.memory, ByteBudget):
        return (
            f"the weights of {network.neurons:,} neurons, some of which stand on a core together, need more than the "
            f"{cores:,} cores of {board.memory.core_bytes:,} bytes of {board.title}"
        )
    limits = {"axons_in": board.axons_in, "axons_out": board.axons_out, "synapse_words": board.memory.capacity}
    listened = int(sizing.listened.max())
    for name in ("axons_in", "synapse_words"):
        if listened > limits[name]:
            return (
                f"an inhibitory neuron that listens to {listened:,} others needs {listened:,} {_TITLES[name]}, but a "
                f"core of {board.title} has {limits[name]:,}"
            )
    share = -(-network.neurons // cores)
    for name, need in _least_needs(sizing, share).items():
        if need > limits[name]:
            return (
                f"a core with {share:,} of {network.neurons:,} neurons needs {need:,} {_TITLES[name]}, but a core of "
                f"{board.title} has {limits[name]:,}"
            )
    # The resource without whose limit the network would fit on the fewest cores; if there is none, cores.
    without = {name: fewest_cores(replace(sizing, board=_without(board, name))) for name in _TITLES}
    lacking = {many: name for name, many in reversed(without.items()) if many}
    many = fewest_cores(replace(sizing, board=replace(board, cores=8 * board.cores)))
    needed = f"{many:,}" if many else f"more than {8 * cores:,}"
    name = lacking.get(min(lacking, default=0), "")
    of_each = f" of {limits[name]:,} {_TITLES[name]}" if name else ""
    return f"{network.neurons:,} neurons need {needed} cores{of_each}, but {board.title} has {cores:,}"


def _without(board: Board, name: str) -> Board:
    """``board`` without its limit ``name``."""
    if name == "synapse_words":
        return replace(board, memory=PackedRows(UNLIMITED, board.memory.index_bits))
    return replace(board, **{name: UNLIMITED})  # type: ignore[arg-type]


def _least_needs(sizing: Sizing, neurons: int) -> dict[str, int]:
    """The least needs of a core with any so many neurons and nothing else."""
    least = {"axons_in": UNLIMITED, "axons_out": 2 * neurons, "synapse_words": UNLIMITED}
    mask, count = sizing.pattern.mask, sizing.network.neurons
    if neurons > sizing.largest:
        return {"axons_out": 2 * neurons}
    for begin in range(0, count - neurons + 1, _STARTS):
        part = np.cumsum(mask[:, begin : begin + _STARTS + neurons - 1], axis=1, dtype=np.int32)
        part = np.concatenate([np.zeros((len(mask), 1), np.int32), part], axis=1)
        counts = part[:, neurons:] - part[:, :-neurons]
        active, words = sizing.taken(np.full(counts.shape[1], neurons), counts)
        least["axons_in"] = min(least["axons_in"], int(active.min()) + sizing.inhibits + sizing.counters * neurons)
        least["synapse_words"] = min(least["synapse_words"], int(words.min()))
    return least


def _remedy(sizing: Sizing) -> str:
    """The remedies that help; each has been tried."""
    network, board, remedies = sizing.network, sizing.board, []
    spikes = host_spikes(replace(network, bias_input=False), sizing.rates)
    if network.bias_input and spikes <= board.host_spikes and fewest_cores(_with(sizing, bias_input=False)):
        remedies.append("--input-mode injected")
    for bits in range(network.bits - 1, 0, -1):
        less = network.bits - bits
        weights = (np.sign(network.weights) * (np.abs(network.weights) >> less)).astype(np.int16)
        inhibition = network.inhibition >> less
        if _says_something(weights) and fewest_cores(_with(sizing, bits=bits, weights=weights, inhibition=inhibition)):
            remedies.append(f"--weight-bits {bits}")
            break
    order = np.argsort(np.abs(network.weights), axis=0, kind="stable")
    for share in _SHARES:
        weights = np.array(network.weights)
        np.put_along_axis(weights, order[: round(share * network.inputs)], 0, axis=0)
        if _says_something(weights) and fewest_cores(_with(sizing, weights=weights)):
            remedies.append(f"--prune {share:g}")
            break
    if not sizing.dense_rows and board.memory.public and fewest_cores(replace(sizing, dense_rows=True)):
        remedies.append("--dense-rows (unproven)")
    if remedies:
        return "use " + " or ".join(remedies)
    low, high = 0, network.neurons
    while high - low > 1:
        middle = (low + high) // 2
        weights, bias = np.ascontiguousarray(network.weights[:, :middle]), network.bias[:middle]
        fits = fewest_cores(_with(sizing, weights=weights, bias=bias))
        low, high = (middle, high) if fits else (low, middle)
    return (
        f"use at most {low:,} neurons, so fewer places or network.neurons_per_place" if low else "use another --target"
    )


def _says_something(weights: NDArray[np.int16]) -> bool:
    """Whether every neuron keeps a weight after pruning."""
    return bool(weights.any(axis=0).all())


def _with(sizing: Sizing, **changes: object) -> Sizing:
    """The sizing of the network with ``changes``, on the same board."""
    return replace(sizing, network=replace(sizing.network, **changes))  # type: ignore[arg-type]
