"""The largest map that fits a board.

This is the largest of networks as large and as costly as they can become: every input has a weight to every neuron, so
every row is stored in full. Threshold and inhibition are what `engine.inference.quantise` makes of weights whose 99.9th
percentile is `TOP`, as measured; real networks, two thirds of whose weights are 0, take less synapse memory.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lava_vpr.config import Config
from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.mapping.limits import check
from lava_vpr.deploy.mapping.partition import fewest_cores
from lava_vpr.deploy.mapping.refusal import cause
from lava_vpr.deploy.mapping.sizing import Sizing
from lava_vpr.engine.inference import quantise
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError
from lava_vpr.gate import integer_config
from lava_vpr.training.loop import check_network

TOP = 0.91
"""99.9th percentile of equalised weights (mean 0.1) that the default preset learns: 0.92 of 100 real places, 0.91 of
500."""

_MOST = 1 << 17


@dataclass(frozen=True)
class Capacity:
    """The largest map that fits.

    Attributes:
        weight_bits: Bits of a weight.
        places, neurons, cores: The map's size; 0 if not even two places fit.
        limit: What one more place would exceed.
    """

    weight_bits: int
    places: int
    neurons: int
    cores: int
    limit: str


def typical(config: Config, board: Board, places: int) -> FixedNetwork:
    """The costliest network that ``config`` can learn of so many places, as ``board`` runs it.

    Raises:
        NetworkLimitError: training, quantising or the board's accumulator would refuse it.
    """
    network = integer_config(config, board.title).network
    stretches = check_network(places, config)
    neurons = sum(stretch.neurons for stretch in stretches)
    quantised = quantise.quantise(
        np.repeat([[TOP], [quantise.MEAN_WEIGHT]], neurons, axis=1),
        network,
        config.encoder.query_spikes,
        joined=len(stretches) > 1,
        shift=board.sum_shift,
    )
    quantised.check(board.input_limit, board.title)
    weight = np.uint8(max(1, int(quantised.weights[1, 0])))
    return replace(quantised, weights=np.broadcast_to(weight, (config.encoder.inputs, neurons)))


def largest(config: Config, board: Board) -> Capacity:
    """The largest map that fits ``board``, in whole places and in stretches of ``config.stretch``.

    Where all places are learned at once, ``network.neurons`` says nothing of their number; `neurons_per_place` does.

    Raises:
        ConfigError: ``config`` learns no integer network.
    """
    network = integer_config(config, board.title).network
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
        size = _neurons_and_cores(config, board, places)
        if size is None:
            high = places - 1
        else:
            best, low = (places, *size), places
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


def _neurons_and_cores(config: Config, board: Board, places: int) -> tuple[int, int] | None:
    """Neurons and cores of so many places; None if they do not fit."""
    sizing = _sizing(config, board, places)
    try:
        check(sizing)
    except NetworkLimitError:
        return None
    cores = fewest_cores(sizing)
    return None if cores is None else (sizing.network.neurons, cores)


def _limit(config: Config, board: Board, places: int) -> str:
    """Why so many places do not fit the cores."""
    sizing = _sizing(config, board, places)
    try:
        check(sizing)
    except NetworkLimitError as error:
        return str(error).partition(";")[0]
    return cause(sizing, fewest_cores)


def table(config: Config, board: Board) -> tuple[Capacity, ...]:
    """`largest` for every width of a weight that ``board`` stores.

    Raises:
        ConfigError: ``config`` learns no integer network.
    """
    network = integer_config(config, board.title).network
    return tuple(
        largest(replace(config, network=replace(network, weight_bits=bits)), board) for bits in board.weight_bits
    )
