"""A model in fewer bits and fewer synapses, quantised anew from the float weights that it learned.

Loihi 1 shifts every weight where Lava shifts their sum, so what goes there has a right shift of 0: the finer the
weights, the larger threshold and inhibition become, until inhibition fills the accumulator.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.bundle.references import measured_responses
from lava_vpr.encoding import query_rates
from lava_vpr.engine.inference import quantise
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.quantise import pruned
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.model import Model, as_integer, integer_model
from lava_vpr.training.loop import coverage

PURPOSE = "a board"


@dataclass(frozen=True)
class Figures:
    """A model on calibration images: fractions in 0..1, and synaptic operations of a query (weights that are not 0)."""

    recall_at_1: float
    recall_at_100_precision: float
    auc: float
    operations: float


@dataclass(frozen=True)
class Point:
    """A way to compress: bits of a weight, share of pruned weights, and the expected operations of a query's inputs."""

    weight_bits: int
    prune: float
    input_operations: float
    memory_bits: int


@dataclass(frozen=True)
class Compressed:
    """A model as it is to be deployed.

    Attributes:
        model: Quantised anew, its responses measured again.
        original: The model that it was made from.
        prune: Share of each neuron's weights that was set to 0.
        notes: What differs from the original without having been asked for, for people.
        before, after: Figures on the calibration images; None without such images.
        max_loss: What R@1 was allowed to lose; None if nothing was searched.
        tried: What was searched, in that order.
    """

    model: Model = field(repr=False)
    original: Model = field(repr=False)
    prune: float
    notes: tuple[str, ...] = ()
    before: Figures | None = None
    after: Figures | None = None
    max_loss: float | None = None
    tried: tuple[tuple[Point, Figures], ...] = field(default=(), repr=False)

    def as_json(self) -> dict[str, Any] | None:
        """What was done and what it changed, as plain values; None if nothing was changed or measured."""
        if self.model is self.original and self.before is None:
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


def expected_rates(model: Model) -> NDArray[np.float64]:
    """Spikes per step that each input is expected to bring, float64 (inputs,): the mean over all references."""
    rates = query_rates(model.activity, model.config).astype(np.float64)
    return np.asarray(rates.mean(axis=0) / 65536.0)


def requantised(
    model: Model,
    *,
    weight_bits: int | None = None,
    prune: float = 0.0,
    input_mode: str | None = None,
    shift: int | None = None,
    threads: int = 1,
) -> Model:
    """``model`` quantised anew from its float weights; with nothing changed, the equal model.

    Args:
        model: With float weights (`Model.learned`).
        weight_bits: Bits of a weight, 1..8 (default: the model's).
        prune: Share of each neuron's learned weights that is set to 0 before all else (`quantise.pruned`).
        input_mode: ``injected`` or ``bias`` (default: the model's).
        shift: Right shift of the input sum (default: what `quantise` finds best).
        threads: For the references' responses; does not change the result.
    Raises:
        ConfigError: no float weights, or a value outside its range.
        NetworkLimitError: the network could overflow.
    """
    source = with_settings(model, weight_bits, input_mode)
    learned = pruned(source.learned, prune)
    network = _quantised(source, distinctive(source, learned), shift)
    return _measured(replace(source, learned=learned, network=network), threads)


def with_settings(model: Model, weight_bits: int | None, input_mode: str | None) -> Model:
    """``model`` with other settings, its network still the old one.

    Raises:
        ConfigError: it cannot be quantised anew, or a value is outside its range.
    """
    integer_model(model, PURPOSE)
    if model.learned.size == 0:
        raise ConfigError(
            "there are no float weights to quantise anew (a bundle keeps none); use the model file that was deployed"
        )
    changes = {"weight_bits": weight_bits, "input_mode": input_mode}
    chosen = {name: value for name, value in changes.items() if value is not None}
    return replace(model, config=update(model.config, {"network": chosen}))


def distinctive(model: Model, learned: NDArray[np.float32]) -> NDArray[np.float64]:
    """Weights to quantise, from ``learned`` ones, under the settings of ``model``."""
    return quantise.distinctive(learned, integer_model(model, PURPOSE).config.network)


def _quantised(model: Model, weights: NDArray[np.float64], shift: int | None) -> FixedNetwork:
    """The integer network of equalised ``weights`` under the settings of ``model``."""
    network = integer_model(model, PURPOSE).config.network
    return quantise.quantise(weights, network, model.config.encoder.query_spikes, joined=model.joined, shift=shift)


def _measured(model: Model, threads: int) -> Model:
    """``model`` with its network's responses to the references, as training measures them."""
    responses = measured_responses(model, integer_model(model, PURPOSE).network, threads)
    used, covered = coverage(responses)
    figures = {
        "spikes_per_image": float(responses.sum() / len(model.labels)),
        "neurons_used": used,
        "places_covered": covered,
    }
    return replace(model, responses=responses, training={**model.training, **figures})


def fitting(model: Model, board: Board, bits: int, weights: NDArray[np.float64]) -> FixedNetwork:
    """The network of equalised ``weights`` with ``bits`` bits, as ``board`` can run it.

    Raises:
        NetworkLimitError: it cannot; the first part of the message says why.
    """
    if bits not in board.weight_bits:
        sizes = ", ".join(str(size) for size in board.weight_bits)
        raise NetworkLimitError(f"it stores weights of {sizes} bits; choose one of them")
    network = _quantised(with_settings(model, bits, None), weights, board.sum_shift)
    network.check(board.input_limit, "its accumulator of one step")
    return network


def _most_bits(model: Model, board: Board, weights: NDArray[np.float64], wanted: int) -> tuple[int, str]:
    """The most bits up to ``wanted`` that ``board`` can run, and why not ``wanted`` ("" if it can).

    Raises:
        NetworkLimitError: not even one.
    """
    reasons = []
    for bits in range(wanted, 0, -1):
        try:
            fitting(model, board, bits, weights)
        except NetworkLimitError as error:
            reasons.append(str(error).partition(";")[0])
        else:
            return bits, next(iter(reasons), "")
    raise NetworkLimitError(
        f"{board.title}: not even weights of 1 bit fit: {reasons[-1]}; learn fewer places, or lower "
        f"network.{'joined_inhibition' if model.joined else 'inhibition'}"
    )


def for_board(
    model: Model,
    board: Board,
    *,
    weight_bits: int | None = None,
    prune: float = 0.0,
    input_mode: str | None = None,
    threads: int = 1,
) -> Compressed:
    """``model`` as ``board`` can run it: where ``weight_bits`` is not given, the most bits up to the model's own.

    Raises:
        ConfigError: the model cannot be quantised anew where it has to be, or a value is outside its range.
        NetworkLimitError: the board cannot run so many bits; the message names the most that it can.
    """
    wanted = weight_bits if weight_bits is not None else (model.weight_bits or 0)
    mode = getattr(model.config.network, "input_mode", None)
    if wanted == model.weight_bits and prune == 0 and input_mode in (None, mode) and _runs(model, board):
        return Compressed(model, model, 0.0)
    source = with_settings(model, None, input_mode)
    weights = distinctive(model, pruned(model.learned, prune))
    bits, reason = _most_bits(source, board, weights, wanted)
    if weight_bits is not None and bits != weight_bits:
        raise NetworkLimitError(
            f"{board.title} cannot take {weight_bits} bits a weight of this model: {reason}; use at most "
            f"--weight-bits {bits}"
        )
    notes = []
    if bits != wanted:
        notes.append(f"{bits} bits a weight instead of {wanted}, the most that {board.title} can take: {reason}")
    shift = board.sum_shift
    result = requantised(model, weight_bits=bits, prune=prune, input_mode=input_mode, shift=shift, threads=threads)
    if shift == 0 and bits == model.weight_bits and prune == 0 and getattr(model.network, "shift", 0) > 0:
        notes.append(
            f"{board.title} does not shift sums: its units are finer, and single spikes differ from the model's"
        )
    return Compressed(result, model, prune, tuple(notes))


def _runs(model: Model, board: Board) -> bool:
    """Whether ``board`` can run the model's network as it is."""
    integer = as_integer(model)
    if integer is None or integer.network.bits not in board.weight_bits:
        return False
    network = integer.network
    if network.shift > 0 and not board.shifts_sum:
        return False
    try:
        network.check(board.input_limit)
    except NetworkLimitError:
        return False
    return True


def _zeros(model: Model) -> float:
    """Share of a model's integer weights that are 0."""
    return float(1 - np.count_nonzero(model.network.weights) / model.network.weights.size)
