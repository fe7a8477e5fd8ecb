"""Compression of a model: fewer bits and fewer synapses, quantised again from its learned float weights."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.cluster.tasks import Pool
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.registers.synapses import lateral_synapse
from lava_vpr.engine.gains import learned_under
from lava_vpr.engine.inference import quantise
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import ConfigError, NetworkLimitError, shown
from lava_vpr.loihi import SIGNED_WEIGHT_LIMIT
from lava_vpr.model import IntegerModel, Model, integer_model
from lava_vpr.training.measuring import calibrated, remeasured, shown_references

PURPOSE = "a board"


@dataclass(frozen=True)
class CompressionFigures:
    """Figures of a model on calibration images: recall as fractions in 0..1, and the synaptic operations of a query."""

    recall_at_1: float
    recall_at_100_precision: float
    auc: float
    operations: float


@dataclass(frozen=True)
class CompressionPoint:
    """A way to compress: bits of a weight, share of pruned weights, and the expected operations of a query's inputs."""

    weight_bits: int
    prune: float
    input_operations: float
    memory_bits: int


@dataclass(frozen=True)
class Compressed:
    """A model as it is to be deployed.

    Attributes:
        model: The model as it is to be deployed: quantised again, unless nothing had to be done.
        original: The model that it was made from.
        prune: Share of each neuron's weights that was set to 0.
        notes: Differences from the original that were not requested, as text.
        before, after: Figures on the calibration images; None without such images.
        max_loss: Largest loss of R@1 allowed; None if nothing was searched.
        tried: What was searched, in that order.
    """

    model: Model = field(repr=False)
    original: Model = field(repr=False)
    prune: float
    notes: tuple[str, ...] = ()
    before: CompressionFigures | None = None
    after: CompressionFigures | None = None
    max_loss: float | None = None
    tried: tuple[tuple[CompressionPoint, CompressionFigures], ...] = field(default=(), repr=False)

    @property
    def unchanged(self) -> bool:
        """Whether the model is the original one."""
        return self.model is self.original

    def as_json(self) -> dict[str, Any] | None:
        """The compression and its effects as plain values; None if nothing was changed or measured."""
        if self.unchanged and self.before is None:
            return None
        values: dict[str, Any] = {
            "weight_bits": {"before": self.original.weight_bits, "after": self.model.weight_bits},
            "prune": self.prune,
            "zero_weights": {"before": _zeros(self.original), "after": _zeros(self.model)},
        }
        if self.before is not None and self.after is not None:
            values["calibration"] = {"before": asdict(self.before), "after": asdict(self.after)}
        if self.max_loss is not None:
            values["search"] = {
                "max_loss": self.max_loss,
                "tried": [
                    {"weight_bits": point.weight_bits, "prune": point.prune, **asdict(figures)}
                    for point, figures in self.tried
                ],
            }
        return values


class Changes(NamedTuple):
    """Changes to a model; None leaves the choice to the model, the board or a search.

    Attributes:
        weight_bits: Bits of a weight's magnitude, 1..8, signed 1..7.
        prune: Share of each neuron's weights that is set to 0, the smallest (`LifNetwork.prune`).
        input_mode: ``injected`` or ``bias``.
    """

    weight_bits: int | None = None
    prune: float | None = None
    input_mode: str | None = None


UNCHANGED = Changes()


def requantised(model: Model, changes: Changes = UNCHANGED, *, threads: int = 1) -> Model:
    """``model`` quantised again from its float weights, its responses measured; with nothing changed, the equal model.

    Args:
        model: With float weights (`Model.learned`).
        changes: What to change.
        threads: For the references' responses; does not change the result.
    Raises:
        ConfigError: no float weights, or a value outside its range.
        NetworkLimitError: the network could overflow.
    """
    source = with_settings(model, changes)
    return remeasured(replace(source, network=_quantised(source, distinctive(source))), Pool(threads))


def under_gains(model: Model, gains: NDArray[np.uint8], *, threads: int = 1) -> Model:
    """``model`` with what it learned of each input times its gain (inputs,), quantised, measured and calibrated again.

    Raises:
        ConfigError: no float weights, or no gain is above 0.
    """
    source = with_settings(model, UNCHANGED)
    source = replace(source, learned=learned_under(source.learned, gains))
    return calibrated(requantised(source, threads=threads), Pool(threads))


def with_settings(model: Model, changes: Changes) -> Model:
    """``model`` with the settings of ``changes``, but still its old weights and network.

    Raises:
        ConfigError: it cannot be quantised again, or a value is outside its range.
    """
    integer_model(model, PURPOSE)
    if model.learned.size == 0:
        at = "" if model.bundle is None else f"{shown(model.bundle)}: "
        raise ConfigError(
            f"{at}there are no float weights to quantise again (a bundle keeps none); use the model file that was "
            "deployed"
        )
    chosen = {name: value for name, value in changes._asdict().items() if value is not None}
    return replace(model, config=update(model.config, {"network": chosen}))


def distinctive(model: Model) -> NDArray[np.float64]:
    """Weights to quantise, from those that ``model`` has learned, under its settings."""
    network = integer_model(model, PURPOSE).config.network
    parts = shown_references(model.stretches, model.activity, model.config) if network.surroundings else ()
    return quantise.distinctive(model.learned, network, parts)


def _quantised(model: Model, weights: NDArray[np.float64]) -> FixedNetwork:
    """The integer network of ``weights`` of norm 1 under the settings of ``model``."""
    network = integer_model(model, PURPOSE).config.network
    shown = shown_references(model.stretches, model.activity, model.config)
    return quantise.quantise(weights, network, shown, model.config.encoder)


def fitting(model: Model, board: Board, bits: int, weights: NDArray[np.float64]) -> FixedNetwork:
    """The network of ``weights`` of norm 1 with ``bits`` bits, as ``board`` can run it.

    Raises:
        NetworkLimitError: it cannot; the first part of the message says why.
    """
    network = _quantised(with_settings(model, Changes(bits)), weights)
    if board.stored_bits(network) > max(board.weight_bits):
        raise NetworkLimitError(f"it stores weights of at most {max(board.weight_bits)} bits; choose fewer")
    network.check(board.input_limit, "its accumulator of one step")
    return network


def _finest(model: Model, board: Board, weights: NDArray[np.float64], most: int) -> tuple[FixedNetwork, str]:
    """The network of ``weights`` of norm 1 with the most bits up to ``most`` that ``board`` can run, and why it has no
    more ("" if it has ``most``).

    Raises:
        NetworkLimitError: not even one.
    """
    reasons = []
    for bits in range(most, 0, -1):
        try:
            network = fitting(model, board, bits, weights)
        except NetworkLimitError as error:
            reasons.append(str(error).partition(";")[0])
        else:
            return network, next(iter(reasons), "")
    raise NetworkLimitError(
        f"{board.title}: not even weights of 1 bit fit: {reasons[-1]}; use fewer inputs, or lower network.inhibition"
    )


def for_board(model: Model, board: Board, changes: Changes = UNCHANGED, *, threads: int = 1) -> Compressed:
    """``model`` as ``board`` can run it, its responses measured; see `adapted`.

    Args:
        model: The model.
        board: The board that the model is to run on.
        changes: What to change besides.
        threads: For the references' responses; does not change the result.
    """
    compressed = adapted(model, board, changes)
    return (
        compressed if compressed.unchanged else replace(compressed, model=remeasured(compressed.model, Pool(threads)))
    )


def adapted(model: Model, board: Board, changes: Changes = UNCHANGED) -> Compressed:
    """``model`` as ``board`` can run it, but still with its old responses.

    Where ``changes.weight_bits`` is not given, weights have the most bits up to the model's own; where
    ``changes.input_mode`` is not, inputs are as `for_inputs` says.

    Raises:
        ConfigError: the model cannot be quantised again where it has to be, or a value is outside its range.
        NetworkLimitError: the board cannot run so many bits; the message names the most that it can.
    """
    integer = integer_model(model, PURPOSE)
    own, asked = integer.config.network, changes.input_mode
    changes = for_inputs(model, board, changes)
    most = integer.network.bits if changes.weight_bits is None else changes.weight_bits
    same = changes.input_mode in (None, own.input_mode) and changes.prune in (None, own.prune)
    if most == integer.network.bits and same and _runs(integer, board):
        return Compressed(model, model, own.prune)
    prune = own.prune if changes.prune is None else changes.prune
    source = with_settings(model, Changes(prune=prune, input_mode=changes.input_mode))
    network, reason = _finest(source, board, distinctive(source), most)
    if changes.weight_bits is not None and network.bits != most:
        raise NetworkLimitError(
            f"{board.title} cannot take {most} bits a weight of this model: {reason}; use at most "
            f"--weight-bits {network.bits}"
        )
    notes = []
    if asked is None and changes.input_mode not in (None, own.input_mode):
        notes.append(
            f"inputs integrate a bias, as {board.title} is given them unless --input-mode injected asks for spikes "
            "that Python sends step by step"
        )
    if network.lateral != integer.network.lateral and (network.bits, prune) == (integer.network.bits, own.prune):
        notes.append(
            f"inhibition is {network.lateral:,} instead of {integer.network.lateral:,}: its mantissa has the "
            f"{SIGNED_WEIGHT_LIMIT.bit_length()} bits of a synapse that holds its sign"
        )
    if network.bits != most:
        notes.append(f"{network.bits} bits a weight instead of {most}, the most that {board.title} can take: {reason}")
    result = replace(with_settings(source, Changes(network.bits)), network=network)
    return Compressed(result, model, prune, tuple(notes))


def for_inputs(model: Model, board: Board, changes: Changes) -> Changes:
    """``changes`` with the input mode that ``board`` is given where none is asked for (`Board.input_mode`).

    It stays the model's where that cannot be another: of Poisson trains, and of a bundle, which keeps no float weights.
    """
    own = integer_model(model, PURPOSE).config.network
    fixed = own.trains != "regular" or model.learned.size == 0
    if changes.input_mode is not None or board.input_mode is None or fixed:
        return changes
    return changes._replace(input_mode=board.input_mode)


def _runs(model: IntegerModel, board: Board) -> bool:
    """Whether ``board`` can run the model's network as it is."""
    network = model.network
    if board.stored_bits(network) > max(board.weight_bits):
        return False
    try:
        network.check(board.input_limit)
        if not board.memory.one_sign:
            lateral_synapse(network, max(board.weight_bits))
    except NetworkLimitError:
        return False
    return True


def _zeros(model: Model) -> float:
    """Share of a model's integer weights that are 0."""
    return float(1 - np.count_nonzero(model.network.weights) / model.network.weights.size)
