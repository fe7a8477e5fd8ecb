"""What fits a board: the largest map, and why a network does not fit and what helps.

The largest map is that of networks as large and as costly as they can become: every input has a weight to every neuron,
so every row is stored in full. Threshold and inhibition are what `engine.inference.quantise` makes of weights whose
99.9th percentile is `TOP`, as measured; real networks, two thirds of whose weights are 0, take less synapse memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config, LifNetwork
from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.mapping.sizing import UNLIMITED, Sizing, limit_of
from lava_vpr.engine.inference import quantise
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.training.loop import check_size

TOP = 0.91
"""99.9th percentile of equalised weights (mean 0.1) that the default preset learns: 0.92 of 100 real places, 0.91 of
500."""

DEVIATIONS = 6
"""Standard deviations by which input spikes of a step may exceed their mean."""

Solve = Callable[[Sizing], int | None]
"""Cores that a network takes, None if it does not fit."""

_NAMES = {
    "axons_in": "input axons",
    "axons_out": "output axons",
    "synapse_words": "words of synapse memory",
}
_MOST = 1 << 17
_SHARES = (0.5, 0.6, 0.7, 0.8, 0.9)


@dataclass(frozen=True)
class Capacity:
    """The largest map that fits.

    Attributes:
        weight_bits: Bits of a weight.
        places, neurons, cores: Its size; 0 if not even two places fit.
        limit: What one more place would exceed.
    """

    weight_bits: int
    places: int
    neurons: int
    cores: int
    limit: str


def host_spikes(network: FixedNetwork, rates: NDArray[np.float64]) -> float:
    """Spikes that the host sends to a chip in one step, mean plus `DEVIATIONS` standard deviations."""
    total = 0.0 if network.regular else float(rates.sum())
    return total + DEVIATIONS * total**0.5


def check(sizing: Sizing) -> None:
    """Refuse what no choice of cores could help.

    Raises:
        NetworkLimitError: naming resource, need, limit and remedy.
    """
    network, board = sizing.network, sizing.board
    if network.shift > 0 and not board.shifts_sum:
        bits = network.bits - network.shift
        fewer = f" or use --weight-bits {bits}" if bits > 0 else ""
        raise NetworkLimitError(
            f"weights of {network.bits} bits need their sum shifted right by {network.shift}, but {board.title} shifts "
            f"each weight; quantise the model anew with `lava-vpr deploy`{fewer}"
        )
    network.check(board.input_limit, board.title)
    _ = sizing.weight_bits, sizing.lateral_bits  # refuse what they cannot hold
    if sizing.indexable == 0:
        raise NetworkLimitError(f"synapses to relays need index bits, but {board.title} has none; use another --target")
    spikes = host_spikes(network, sizing.rates)
    if spikes > limit_of(board.host_spikes):
        # Rounded down: the mean m with m + 6 sqrt(m) at the limit.
        most = int(10 * ((DEVIATIONS**2 / 4 + limit_of(board.host_spikes)) ** 0.5 - DEVIATIONS / 2) ** 2) / 10
        raise NetworkLimitError(
            f"the host would have to send up to {spikes:.1f} input spikes a step, but {board.title} takes "
            f"{board.host_spikes} a chip; lower encoder.query_spikes to {most:g}, or use --input-mode bias"
        )
    populations, kinds = 2 + network.regular, 2 + (network.inhibition > 0)
    for name, need in (("profiles", populations), ("thresholds", populations), ("formats", kinds)):
        limit = limit_of(getattr(board, name))
        if need > limit:
            helps = network.regular and name != "formats" and limit >= 2
            remedy = "--input-mode injected" if helps else "another --target"
            raise NetworkLimitError(f"a core needs {need} {name}, but {board.title} has {limit}; use {remedy}")


def refusal(sizing: Sizing, solve: Solve) -> NetworkLimitError:
    """Why a network does not fit, and what helps; every remedy that is named has been tried."""
    return NetworkLimitError(f"{cause(sizing, solve)}; {_remedy(sizing, solve)}")


def cause(sizing: Sizing, solve: Solve) -> str:
    """The resource that a network lacks, its need and its limit."""
    network, board = sizing.network, sizing.board
    cores = board.chips * board.cores
    total = 2 * network.neurons + network.regular * network.inputs
    if total > cores * board.compartments:
        what = "neurons, relays and inputs" if network.regular else "neurons and relays"
        have = cores * board.compartments
        return f"{what} need {total:,} compartments, but the {cores:,} cores of {board.title} have {have:,}"
    share = -(-network.neurons // cores)
    for name, need in _least_needs(sizing, share).items():
        limit = limit_of(getattr(board, name))
        if need > limit:
            return (
                f"a core with {share:,} of {network.neurons:,} neurons needs {need:,} {_NAMES[name]}, but a core of "
                f"{board.title} has {limit:,}"
            )
    # The resource without whose limit the network would fit; if there is none, cores.
    lacking = [name for name in _NAMES if solve(replace(sizing, board=_without(board, name)))]
    many = solve(replace(sizing, board=replace(board, cores=8 * board.cores)))
    wanted = f"{many:,}" if many else f"more than {8 * cores:,}"
    of_each = f" of {getattr(board, lacking[0]):,} {_NAMES[lacking[0]]}" if lacking else ""
    return f"{network.neurons:,} neurons need {wanted} cores{of_each}, but {board.title} has {cores:,}"


def _without(board: Board, name: str) -> Board:
    """The same without one limit."""
    return replace(board, **{name: UNLIMITED})  # type: ignore[arg-type]


def _least_needs(sizing: Sizing, neurons: int) -> dict[str, int]:
    """What a core with so many neurons takes at least, whichever they are, without relays on it."""
    starts = range(sizing.network.neurons - neurons + 1)
    ranges = [sizing.ranges(first, np.array([first + neurons])) for first in starts]
    return {
        "axons_in": min(int(own.active[0]) for own in ranges) + sizing.relay_axons_of(neurons),
        "axons_out": 2 * neurons,
        "synapse_words": min(int(own.least_words[0]) for own in ranges),
    }


def _remedy(sizing: Sizing, solve: Solve) -> str:
    """What was found to help."""
    network, board, found = sizing.network, sizing.board, []
    spikes = host_spikes(replace(network, regular=0), sizing.rates)
    if network.regular and spikes <= limit_of(board.host_spikes) and solve(_with(sizing, regular=0)):
        found.append("--input-mode injected")
    for bits in range(network.bits - 1, 0, -1):
        less = network.bits - bits
        weights, inhibition = (network.weights >> less).astype(np.uint8), network.inhibition >> less
        if _says_something(weights) and solve(_with(sizing, bits=bits, weights=weights, inhibition=inhibition)):
            found.append(f"--weight-bits {bits}")
            break
    order = np.argsort(network.weights, axis=0, kind="stable")
    for share in _SHARES:
        weights = np.array(network.weights)
        np.put_along_axis(weights, order[: round(share * network.inputs)], 0, axis=0)
        if _says_something(weights) and solve(_with(sizing, weights=weights)):
            found.append(f"--prune {share:g}")
            break
    if found:
        return "use " + " or ".join(found)
    low, high = 0, network.neurons
    while high - low > 1:
        middle = (low + high) // 2
        fits = solve(_with(sizing, weights=np.ascontiguousarray(network.weights[:, :middle])))
        low, high = (middle, high) if fits else (low, middle)
    return (
        f"use at most {low:,} neurons, so fewer places or network.neurons_per_place" if low else "use another --target"
    )


def _says_something(weights: NDArray[np.uint8]) -> bool:
    """Whether every neuron keeps a weight."""
    return bool(weights.any(axis=0).all())


def _with(sizing: Sizing, **changes: object) -> Sizing:
    """The same with another network."""
    return replace(sizing, network=replace(sizing.network, **changes))  # type: ignore[arg-type]


def typical(config: Config, board: Board, places: int) -> FixedNetwork:
    """The costliest network that ``config`` can learn of so many places, as ``board`` runs it.

    Raises:
        NetworkLimitError: training, quantising or the board's accumulator would refuse it.
    """
    network = _lif(config)
    stretches = check_size(places, config)
    neurons = sum(stretch.neurons for stretch in stretches)
    made = quantise.quantise(
        np.repeat([[TOP], [quantise.MEAN_WEIGHT]], neurons, axis=1),
        network,
        config.encoder.query_spikes,
        joined=len(stretches) > 1,
        shift=None if board.shifts_sum else 0,
    )
    made.check(board.input_limit, board.title)
    weight = np.uint8(max(1, int(made.weights[1, 0])))
    return replace(made, weights=np.broadcast_to(weight, (config.encoder.inputs, neurons)))


def _lif(config: Config) -> LifNetwork:
    """The settings of the integer network.

    Raises:
        ConfigError: there is none.
    """
    if not isinstance(config.network, LifNetwork):
        raise ConfigError("only integer networks run on a board; use --preset loihi")
    return config.network


def largest(config: Config, board: Board) -> Capacity:
    """The largest map that fits ``board``, in whole places and in stretches of ``config.stretch``.

    Where all places are learned at once, ``network.neurons`` says nothing of their number; `neurons_per_place` does.

    Raises:
        ConfigError: ``config`` learns no integer network.
    """
    network = _lif(config)
    if config.stretch == 0:
        config = replace(config, network=replace(network, neurons=0))
    limit = ""
    # One stretch and several joined ones inhibit differently, so each have a limit of their own.
    for first, last in ((config.stretch + 1, _MOST), (2, config.stretch)) if config.stretch else ((2, _MOST),):
        sizes, limit = _search(config, board, first, last, limit)
        if sizes is not None:
            return Capacity(network.weight_bits, *sizes, limit)
    return Capacity(network.weight_bits, 0, 0, 0, limit)


def _search(config: Config, board: Board, first: int, last: int, limit: str) -> tuple[tuple[int, int, int] | None, str]:
    """Places, neurons and cores of the largest map of ``first`` to ``last`` places, and what one more would exceed.

    What fits the accumulator is known at once, so cores are looked for only within that.
    """
    low, high = first - 1, first
    while low < high:
        refused = _refused(config, board, high)
        if refused is not None:
            limit, last = refused, high - 1
        else:
            low = high
        high = min(2 * high, last) if refused is None and 2 * high < last else (low + last + 1) // 2
    best, high, places = None, low, low
    low = first - 1
    while low < high:
        found = _placed(config, board, places)
        if found is None:
            high = places - 1
        else:
            best, low = (places, *found), places
        places = (low + high + 1) // 2
    return best, _limit(config, board, low + 1) if low < last else limit


def _refused(config: Config, board: Board, places: int) -> str | None:
    """Why so many places cannot be quantised for ``board``; None if they can."""
    try:
        typical(config, board, places)
    except NetworkLimitError as error:
        return str(error).partition(";")[0]
    return None


def _sizing(config: Config, board: Board, places: int) -> Sizing:
    """The costliest network of so many places."""
    network = typical(config, board, places)
    return Sizing(network, board, np.full(network.inputs, config.encoder.query_spikes / network.inputs))


def _placed(config: Config, board: Board, places: int) -> tuple[int, int] | None:
    """Neurons and cores of so many places; None if they do not fit."""
    from lava_vpr.deploy.mapping.partition import fewest  # which asks this module why a network does not fit

    sizing = _sizing(config, board, places)
    try:
        check(sizing)
    except NetworkLimitError:
        return None
    cores = fewest(sizing)
    return None if cores is None else (sizing.network.neurons, cores)


def _limit(config: Config, board: Board, places: int) -> str:
    """Why so many places do not fit the cores."""
    from lava_vpr.deploy.mapping.partition import fewest

    sizing = _sizing(config, board, places)
    try:
        check(sizing)
    except NetworkLimitError as error:
        return str(error).partition(";")[0]
    return cause(sizing, fewest)


def table(config: Config, board: Board) -> tuple[Capacity, ...]:
    """`largest` for every width of a weight that ``board`` stores.

    Raises:
        ConfigError: ``config`` learns no integer network.
    """
    network = _lif(config)
    return tuple(
        largest(replace(config, network=replace(network, weight_bits=bits)), board) for bits in board.weight_bits
    )
