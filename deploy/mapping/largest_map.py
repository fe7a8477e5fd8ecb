"""The largest map that fits a board.

The largest map is computed for two networks: a typical one, with as many weights that are not 0 as real ones have, and
the most expensive one, in which every input has a weight to every neuron. Rows are counted in two ways: only *sparse*,
each synapse with its index, as public sources show; or also *dense*, without indices, which no public source shows on a
board. No public source shows weights of fewer than 8 bits, sign included, either.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np

from lava_vpr.config import Config, IntegerConfig, integer_config
from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.mapping.partition import cause, fewest_cores
from lava_vpr.deploy.mapping.placing import reach
from lava_vpr.deploy.mapping.sizing import Floats, Pattern, Sizing, check, check_without_weights, least_cores
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.quantise import scaled
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.loihi import WEIGHT_BITS
from lava_vpr.training.loop import split

RowKind = Literal["sparse", "dense", "unknown"]
Fullness = Literal["typical", "every"]
NETWORKS: tuple[Fullness, ...] = ("typical", "every")

_SIGNED = (
    (0.00, 0.01, 0.01, 0.02, 0.03, 0.04, 0.06, 0.11),
    (0.03, 0.09, 0.11, 0.13, 0.15, 0.17, 0.35, 0.69),
    (0.07, 0.16, 0.63, 0.75, 0.79, 0.82, 0.86, 0.92),
    (0.33, 0.86, 0.89, 0.90, 0.92, 0.93, 0.95, 0.97),
    (0.56, 0.93, 0.94, 0.95, 0.96, 0.97, 0.98, 0.99),
    (0.75, 0.96, 0.97, 0.98, 0.98, 0.99, 0.99, 1.00),
    (0.89, 0.98, 0.98, 0.99, 0.99, 0.99, 1.00, 1.00),
)
_UNSIGNED = (
    (0.00, 0.01, 0.02, 0.03, 0.04, 0.06, 0.08, 0.18),
    (0.04, 0.10, 0.14, 0.17, 0.20, 0.25, 0.31, 0.48),
    (0.08, 0.18, 0.24, 0.28, 0.32, 0.38, 0.45, 0.63),
    (0.12, 0.24, 0.30, 0.35, 0.41, 0.47, 0.55, 0.72),
    (0.15, 0.29, 0.35, 0.41, 0.47, 0.53, 0.61, 0.77),
    (0.18, 0.33, 0.40, 0.46, 0.52, 0.58, 0.66, 0.81),
    (0.20, 0.35, 0.43, 0.49, 0.55, 0.61, 0.69, 0.83),
    (0.21, 0.36, 0.44, 0.51, 0.56, 0.62, 0.70, 0.84),
)
"""Share of an input's weights that are not 0, in each eighth of the inputs, by bits of a magnitude from 1 on: measured
with 200 places of Nordland that the default preset learned, with signs and without."""

MEAN_MAGNITUDE = 0.13
"""Mean magnitude of these weights, in units of the largest integer weight; without signs 0.10."""

DRIVE = 0.35
"""Additional input of a neuron from an input spike of its own place, compared with the mean of all places, in the same
units."""

_KINDS = 8
"""Kinds of inputs per eighth of a typical network: enough that all cores are alike."""

_MOST = 1 << 17
"""Most neurons of a map that is considered."""


@dataclass(frozen=True)
class Capacity:
    """The largest map that fits.

    Attributes:
        weight_bits: Bits of a weight's magnitude.
        rows: ``sparse`` rows alone, as public sources count them; or also ``dense`` ones, unproven; ``unknown``: how
            the board stores rows is not public.
        weights: ``typical``, or ``every`` weight is stored.
        share: Share of the weights that are not 0.
        places, neurons, cores: The map's size; 0 if not even two places fit.
        limit: What one more place would exceed.
        narrow: Whether weights have fewer than 8 bits, sign included, which no public program writes to a board.
    """

    weight_bits: int
    rows: RowKind
    weights: Fullness
    share: float
    places: int
    neurons: int
    cores: int
    limit: str
    narrow: bool = False

    @property
    def proven(self) -> bool:
        """Whether public sources show rows stored in this way."""
        return self.rows == "sparse" and not self.narrow


def shares(config: IntegerConfig, weights: Fullness) -> Floats:
    """Share of an input's weights that are not 0, in each eighth of the inputs, float64 (8,)."""
    network = config.network
    if weights == "every":
        return np.ones(8)
    typical = np.array((_SIGNED if network.signed else _UNSIGNED)[network.weight_bits - 1])
    return np.asarray(typical * min(1.0, (1 - network.prune) / typical.mean()))


def network_of(config: IntegerConfig, neurons: int) -> FixedNetwork:
    """A network of so many neurons, all of whose weights are of the mean magnitude.

    Raises:
        ConfigError: a presentation would be all silence.
    """
    network, inputs = config.network, config.encoder.inputs
    top = (1 << network.weight_bits) - 1
    weights = np.full((inputs, 1), max(1, round(MEAN_MAGNITUDE * top)), np.int16)
    if network.signed:
        weights[::2] *= -1
    return scaled(network, np.broadcast_to(weights, (inputs, neurons)), DRIVE * top * config.encoder.query_spikes)


def sizing_of(config: Config, board: Board, places: int, rows: RowKind, weights: Fullness) -> Sizing:
    """The typical or the costliest network that ``config`` learns of so many places, on ``board``.

    Raises:
        ConfigError: ``config`` learns no integer network, or not of so many places.
    """
    settings = integer_config(config, board.title)
    neurons = sum(stretch.neurons for stretch in split(places, config))
    network = network_of(settings, neurons)
    kinds = np.repeat(shares(settings, weights), _KINDS)
    random = np.random.default_rng(0).random((kinds.size, 1 << 10))  # repeated: a core holds no more
    mask = np.take(random < kinds[:, None], np.arange(neurons), axis=1, mode="wrap")
    kind = np.arange(network.inputs) * kinds.size // network.inputs
    rates = np.full(network.inputs, config.encoder.query_spikes / network.inputs)
    return Sizing(network, board, rates, dense_rows=rows != "sparse", given=Pattern(mask, kind))


def largest(config: Config, board: Board, rows: RowKind = "sparse", weights: Fullness = "typical") -> Capacity:
    """The largest map that fits ``board``, in whole places and in stretches of ``config.stretch``.

    Where all places are learned at once, ``network.neurons`` says nothing of their number; `neurons_per_place` does.

    Raises:
        ConfigError: ``config`` learns no integer network.
    """
    settings = integer_config(config, board.title)
    rows = rows if board.memory.public else "unknown"
    if config.stretch == 0:
        config = replace(config, network=replace(settings.network, neurons=0))
    low, sizes = 1, (0, 0)
    high = places = _at_most(config, board, rows, weights)
    step = max(1, high // 128)
    while low < high:  # the largest is little below what all cores hold without anything else
        sizing = _sizing(config, board, places, rows, weights)
        cores = None if isinstance(sizing, str) else _cores(sizing)
        if isinstance(sizing, str) or cores is None:
            high = places - 1
        else:
            low, sizes = places, (sizing.network.neurons, cores)
        places, step = (max(2, high - step), 2 * step) if low == 1 else ((low + high + 1) // 2, step)
    share = round(float(shares(settings, weights).mean()), 3)
    beyond = _sizing(config, board, low + 1, rows, weights)
    if isinstance(beyond, str):
        limit = beyond
    elif _cores(beyond):
        limit = f"more than {_MOST:,} neurons are not looked for"
    else:
        limit = cause(beyond)
    stored = settings.network.weight_bits + (settings.network.signed or not board.memory.one_sign)
    narrow = rows != "unknown" and any(stored <= bits < WEIGHT_BITS for bits in board.weight_bits)
    return Capacity(settings.network.weight_bits, rows, weights, share, low if sizes[0] else 0, *sizes, limit, narrow)


def _at_most(config: Config, board: Board, rows: RowKind, weights: Fullness) -> int:
    """Upper bound of the places: all cores hold only excitatory neurons."""
    many = 1000
    neurons = sum(stretch.neurons for stretch in split(many, config))
    held = board.chips * board.cores * board.compartments // (1 + board.counters)
    most = many * min(_MOST, held) // max(many, neurons)
    if not board.memory.public:
        return max(2, most)
    sizing = _sizing(config, board, max(2, most), rows, weights)
    if isinstance(sizing, str):
        return 2
    reached = int(reach(sizing, board.chips * board.cores, sizing.largest)[-1])
    return max(2, min(many * reached // neurons + 1 + config.stretch, most))


def _sizing(config: Config, board: Board, places: int, rows: RowKind, weights: Fullness) -> Sizing | str:
    """The network of so many places, or the limit that forbids it on any cores."""
    try:
        sizing = sizing_of(config, board, places, rows, weights)
        if places == 2:
            check(sizing)
        check_without_weights(sizing)
    except (ConfigError, NetworkLimitError) as error:
        return str(error).partition(";")[0]
    return sizing


def _cores(sizing: Sizing) -> int | None:
    """Cores of a network, or a lower bound where little of the board is public; None: it does not fit."""
    return fewest_cores(sizing) if sizing.board.memory.public else least_cores(sizing)


MapCase = tuple[Config, RowKind, Fullness]
"""Settings, a way of counting rows, and a network, for which `largest` computes a map."""


def cases(config: Config, board: Board, weight_bits: int | None) -> tuple[MapCase, ...]:
    """All cases on ``board``: every way of counting rows, and both networks.

    Args:
        config: The settings.
        board: The board.
        weight_bits: Bits of a weight's magnitude; None: every width that ``board`` stores.
    Raises:
        ConfigError: ``config`` learns no integer network.
    """
    settings = integer_config(config, board.title)
    stored = range(1, max(board.weight_bits) - settings.network.signed + 1)
    widths = stored if weight_bits is None else (weight_bits,)
    wide = [replace(config, network=replace(settings.network, weight_bits=bits)) for bits in widths]
    kinds: tuple[RowKind, ...] = ("sparse", "dense") if board.memory.public else ("unknown",)
    return tuple(product(wide, kinds, NETWORKS))


def table(
    config: Config, board: Board, weight_bits: int | None = None, told: Callable[[str], None] = lambda text: None
) -> tuple[Capacity, ...]:
    """`largest` of all `cases`, those that public sources show first; ``told`` is called with a description of each."""
    found: list[Capacity] = []
    for own, rows, weights in cases(config, board, weight_bits):
        found.append(largest(own, board, rows, weights))
        told(f"{found[-1].weight_bits} bits, rows {rows}, weights {weights}: {found[-1].places:,} places")
    return tuple(sorted(found, key=lambda row: not row.proven))
