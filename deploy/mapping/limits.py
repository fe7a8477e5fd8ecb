"""What a board refuses: limits of weights, sums, host traffic and registers whatever stands on which core; and why a
network does not fit its cores, and what helps.

Of a board of which little is public, synapses of a chip, bytes and neurons of a core bound a network. One beyond these
bounds cannot fit. One within them may not fit, either: what axons, states and indices take is not public, and is not
counted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.memory import UNLIMITED, ByteBudget, PackedRows
from lava_vpr.deploy.mapping.sizing import Integers, Sizing
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError


def least_cores(sizing: Sizing) -> int:
    """Cores that neurons, and bits of weights, take at least."""
    network, board = sizing.network, sizing.board
    compartments = network.neurons + network.inhibitory + network.input_compartments
    return max(-(-int(_weight_bits(sizing).sum()) // sizing.words), -(-compartments // board.compartments))


def _drawn(sizing: Sizing) -> Integers:
    """Weights from inputs to each excitatory neuron that are not 0, int64 (neurons,)."""
    return np.asarray(sizing.pattern.members @ sizing.pattern.mask, np.int64)


def _weight_bits(sizing: Sizing) -> Integers:
    """Bits of the weights to each excitatory neuron, and of nothing else, int64 (neurons,)."""
    return _drawn(sizing) * sizing.weight_bits + sizing.inhibition_bits * sizing.inhibits


def exceeded(sizing: Sizing) -> str:
    """The public number that a network is beyond; empty if there is none, or if storing is public in full."""
    board, network, memory = sizing.board, sizing.network, sizing.board.memory
    if not isinstance(memory, ByteBudget):
        return ""
    to_relays, most = network.relayed * network.inputs, board.chips * memory.chip_synapses
    synapses = int(_drawn(sizing).sum()) + (1 + sizing.inhibits) * network.neurons + network.leaves + to_relays
    cores, bits, bytes_of = board.chips * board.cores, _weight_bits(sizing), memory.core_bytes
    need, heaviest, least = -(-int(bits.sum()) // 8), -(-int(bits.max()) // 8), least_cores(sizing)
    neurons, have = f"{network.neurons:,} neurons", cores * bytes_of
    told = (
        (synapses, most, f"{neurons} have {synapses:,} synapses, but {board.title} has at most {most:,}"),
        (
            need,
            have,
            f"the weights of {neurons} take {need:,} bytes, but the {cores} cores of {board.title} have {have:,} for "
            "all that they hold",
        ),
        (
            heaviest,
            bytes_of,
            f"the weights of a neuron take {heaviest:,} bytes, but a core of {board.title} has {bytes_of:,} for all "
            "that it holds",
        ),
        (least, cores, f"{neurons} need {least} cores, but {board.title} has {cores}"),
    )
    return next((said for amount, limit, said in told if amount > limit), "")


DEVIATIONS = 6
"""Standard deviations by which input spikes of a step may exceed their mean: with 20 spikes of 500 inputs, one query of
64 steps in a million has a step with more."""


def host_spikes(network: FixedNetwork, rates: NDArray[np.float64]) -> float:
    """Spikes that the host sends to a chip in one step, mean plus `DEVIATIONS` standard deviations; 0 if it sends none.

    Whatever the trains, inputs spike in a given step independently of each other: by draws of their own, or by regular
    trains whose phases are drawn. So where an input spikes with probability p, the variance is the sum of p (1 - p).
    That a train is regular makes its sum over many steps nearly constant, not one step's sum over many inputs. p is the
    rate r of a draw; of a regular train it is r / (1 - r / 2) in all steps of an interval but the last, since start
    membranes, not phases, are uniform.
    """
    return 0.0 if network.bias_input else _most_spikes(network, rates, 1.0)


def _most_spikes(network: FixedNetwork, rates: NDArray[np.float64], scale: float) -> float:
    """Mean plus `DEVIATIONS` standard deviations of the spikes of inputs with ``scale`` times ``rates``."""
    p = np.minimum(rates * scale, 1.0)
    p = np.minimum(p / (1 - p / 2), 1.0) if network.regular else p
    return float(p.sum() + DEVIATIONS * (p * (1 - p)).sum() ** 0.5)


def _allowed_spikes(network: FixedNetwork, rates: NDArray[np.float64], limit: int) -> float:
    """The largest sum of rates in proportion to ``rates`` that stays within ``limit``, rounded down to tenths."""
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if _most_spikes(network, rates, middle) <= limit else (low, middle)
    return int(10 * low * float(rates.sum())) / 10


def check(sizing: Sizing) -> None:
    """Refuse what no choice of cores could help.

    Raises:
        NetworkLimitError: naming resource, need, limit and remedy.
    """
    sizing.network.check(sizing.board.input_limit, sizing.board.title)
    check_without_weights(sizing)


def check_without_weights(sizing: Sizing) -> None:
    """What `check` refuses, but for the sums of weights.

    Raises:
        NetworkLimitError: naming resource, need, limit and remedy.
    """
    network, board = sizing.network, sizing.board
    board.clearing.check(network)
    _ = sizing.weight_bits, sizing.inhibition_bits  # refuse what they cannot hold
    if board.memory.indexable == 0:
        raise NetworkLimitError(
            f"synapses to inhibitory neurons need index bits, but {board.title} has none; use another --target"
        )
    beyond = exceeded(sizing)
    if beyond:
        raise NetworkLimitError(f"{beyond}; use fewer --weight-bits, --prune, or fewer places")
    spikes = host_spikes(network, sizing.rates)
    if spikes > board.host_spikes:
        most = _allowed_spikes(network, sizing.rates, board.host_spikes)
        raise NetworkLimitError(
            f"the host would have to send up to {spikes:.1f} input spikes a step, but {board.title} takes "
            f"{board.host_spikes} a chip; lower encoder.query_spikes to {most:g}, or use --input-mode bias"
        )
    populations = 2 + sizing.counters + bool(network.input_compartments)
    kinds = 2 + sizing.counters + sizing.inhibits + network.relayed
    for name, need in (("profiles", populations), ("thresholds", populations), ("formats", kinds)):
        limit = getattr(board, name)
        if need > limit:
            injected_helps = (
                network.bias_input
                and network.neurons <= fixed.DIRECT
                and name != "formats"
                and limit >= 2 + sizing.counters
            )
            remedy = "--input-mode injected" if injected_helps else "another --target"
            raise NetworkLimitError(f"a core needs {need} {name}, but {board.title} has {limit}; use {remedy}")


Solve = Callable[[Sizing], int | None]
"""Cores that a network takes, None if it does not fit."""

_TITLES = {
    "axons_in": "input axons",
    "axons_out": "output axons",
    "synapse_words": "words of synapse memory",
}
"""The limits of a core that more cores relieve, as messages call them."""

_STARTS = 1 << 10
"""Ranges that are sized at once."""

_SHARES = (0.5, 0.6, 0.7, 0.8, 0.9)
"""Shares of the weights that are tried to be pruned."""


def refusal(sizing: Sizing, solve: Solve) -> NetworkLimitError:
    """Why a network does not fit, and what helps; every remedy that is named has been tried."""
    return NetworkLimitError(f"{cause(sizing, solve)}; {_remedy(sizing, solve)}")


def cause(sizing: Sizing, solve: Solve) -> str:
    """The resource that a network lacks, its need and its limit."""
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
    limits = {"axons_in": board.axons_in, "axons_out": board.axons_out, "synapse_words": sizing.words}
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
    without = {name: solve(replace(sizing, board=_without(board, name))) for name in _TITLES}
    lacking = {many: name for name, many in reversed(without.items()) if many}
    many = solve(replace(sizing, board=replace(board, cores=8 * board.cores)))
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
    """What a core with so many neurons takes at least, whichever they are, without anything beside them."""
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


def _remedy(sizing: Sizing, solve: Solve) -> str:
    """The remedies that help, each tried."""
    network, board, remedies = sizing.network, sizing.board, []
    spikes = host_spikes(replace(network, bias_input=False), sizing.rates)
    if network.bias_input and spikes <= board.host_spikes and solve(_with(sizing, bias_input=False)):
        remedies.append("--input-mode injected")
    for bits in range(network.bits - 1, 0, -1):
        less = network.bits - bits
        weights = (np.sign(network.weights) * (np.abs(network.weights) >> less)).astype(np.int16)
        inhibition = network.inhibition >> less
        if _says_something(weights) and solve(_with(sizing, bits=bits, weights=weights, inhibition=inhibition)):
            remedies.append(f"--weight-bits {bits}")
            break
    order = np.argsort(np.abs(network.weights), axis=0, kind="stable")
    for share in _SHARES:
        weights = np.array(network.weights)
        np.put_along_axis(weights, order[: round(share * network.inputs)], 0, axis=0)
        if _says_something(weights) and solve(_with(sizing, weights=weights)):
            remedies.append(f"--prune {share:g}")
            break
    if not sizing.dense_rows and board.memory.public and solve(replace(sizing, dense_rows=True)):
        remedies.append("--dense-rows (unproven)")
    if remedies:
        return "use " + " or ".join(remedies)
    low, high = 0, network.neurons
    while high - low > 1:
        middle = (low + high) // 2
        weights, bias = np.ascontiguousarray(network.weights[:, :middle]), network.bias[:middle]
        fits = solve(_with(sizing, weights=weights, bias=bias))
        low, high = (middle, high) if fits else (low, middle)
    return (
        f"use at most {low:,} neurons, so fewer places or network.neurons_per_place" if low else "use another --target"
    )


def _says_something(weights: NDArray[np.int16]) -> bool:
    """Whether every neuron keeps a weight."""
    return bool(weights.any(axis=0).all())


def _with(sizing: Sizing, **changes: object) -> Sizing:
    """The sizing of the network with ``changes``, on the same board."""
    return replace(sizing, network=replace(sizing.network, **changes))  # type: ignore[arg-type]
