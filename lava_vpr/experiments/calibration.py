"""Recall of compressed models on calibration images, and the search for the cheapest one that is good enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import HostBackend, query_presentations
from lava_vpr.cluster.tasks import Pool
from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.bundle.compression import (
    PURPOSE,
    UNCHANGED,
    Changes,
    Compressed,
    CompressionFigures,
    CompressionPoint,
    adapted,
    distinctive,
    fitting,
    for_board,
    for_inputs,
    with_settings,
)
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError
from lava_vpr.experiments.search import cheapest
from lava_vpr.experiments.task import judged
from lava_vpr.model import Model, integer_model
from lava_vpr.training.measuring import expected_rates

PRUNES = (0.0, 0.3, 0.4, 0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.925, 0.95, 0.97)
"""Shares of pruned weights that `search` tries."""

WORTH = 0.98
"""A way is tried if it costs at most this share of the one with the same bits that is pruned less."""

Calibration = tuple[EncodedTraverse, NDArray[np.bool_]]
"""Images to measure recall on, and their truth, bool (images, places)."""

Begin = Callable[[int], Callable[[str], None]]
"""A function called with the most points to be tried, which returns what is called after each with a note."""


def figures(model: Model, calibration: Calibration, *, threads: int = 1) -> CompressionFigures:
    """How ``model`` does on calibration images and their truth, bool (images, places)."""
    queries, truth = calibration
    counts, events = HostBackend(Pool(threads)).count_spikes(model, query_presentations(model, queries))
    return CompressionFigures(*judged(model, counts, truth), events["synaptic_operations"] / max(1, len(queries)))


def calibrated(compressed: Compressed, calibration: Calibration, *, threads: int = 1) -> Compressed:
    """``compressed`` with the figures of both models on calibration images."""
    before = figures(compressed.original, calibration, threads=threads)
    after = before if compressed.unchanged else figures(compressed.model, calibration, threads=threads)
    return replace(compressed, before=before, after=after)


def candidates(model: Model, board: Board, changes: Changes = UNCHANGED) -> list[CompressionPoint]:
    """Ways to compress that ``board`` can run, from cheap to dear; empty if there is none.

    Bits go up to the model's own, unless ``changes`` fixes them. Points that save nothing against less pruning are left
    out.
    """
    rates, changes = expected_rates(model), for_inputs(model, board, changes)
    most = integer_model(model, PURPOSE).network.bits
    widths = range(1, most + 1) if changes.weight_bits is None else (changes.weight_bits,)
    cheapest: dict[int, float] = {}
    points = []
    for share in PRUNES if changes.prune is None else (changes.prune,):
        source = with_settings(model, Changes(prune=share, input_mode=changes.input_mode))
        weights = distinctive(source)
        for bits in widths:
            try:
                network = fitting(source, board, bits, weights)
            except NetworkLimitError:
                continue
            operations = float(rates @ network.prepared.row_sizes) * network.steps
            if operations <= WORTH * cheapest.get(bits, np.inf):
                cheapest[bits] = operations
                points.append(CompressionPoint(bits, share, operations, _memory_bits(network)))
    return sorted(points, key=lambda point: (point.input_operations, point.memory_bits, point.prune))


def search(
    model: Model,
    board: Board,
    calibration: Calibration,
    max_loss: float,
    changes: Changes = UNCHANGED,
    *,
    threads: int = 1,
    begin: Begin | None = None,
) -> Compressed:
    """The cheapest way to compress under which R@1 stays within ``max_loss`` of the model as it is.

    Points are tried from cheap to dear by the operations of the inputs alone, which those of the whole network exceed:
    once the next point's inputs cost more than a whole network that was found good, that one is the cheapest.

    Args:
        model: The model.
        board: The board that the model is to run on.
        calibration: Images to measure recall on.
        max_loss: What R@1 may lose, a fraction in 0..1.
        changes: What is not to be searched.
        threads: Does not change the result.
        begin: See `Begin`.
    Raises:
        ConfigError: as `for_board`.
        NetworkLimitError: nothing that the board can run is good enough.
    """
    points = candidates(model, board, changes)
    if not points:  # the reason is that of the plainest way
        adapted(model, board, changes)
    advance = begin(len(points)) if begin is not None else None
    before = figures(model, calibration, threads=threads)
    least = before.recall_at_1 - max_loss - 1e-9  # 0.91 - 0.02 is above 0.89

    def measure(point: CompressionPoint) -> tuple[Compressed, CompressionFigures]:
        chosen = Changes(point.weight_bits, point.prune, changes.input_mode)
        compressed = for_board(model, board, chosen, threads=threads)
        return compressed, figures(compressed.model, calibration, threads=threads)

    def cost(point: CompressionPoint, result: tuple[Compressed, CompressionFigures]) -> tuple[float, int] | None:
        return (result[1].operations, point.memory_bits) if result[1].recall_at_1 >= least else None

    tried: list[tuple[CompressionPoint, CompressionFigures]] = []
    best: Compressed | None = None
    for point, (compressed, after), kept in cheapest(points, measure, cost, lambda point: point.input_operations):
        tried.append((point, after))
        best = replace(compressed, after=after) if kept else best
        if advance is not None:
            advance(f"{point.weight_bits} bits, {point.prune:g} pruned: R@1 {100 * after.recall_at_1:.1f}")
    if best is None:
        raise NetworkLimitError(_none_good(board, before, max_loss, tried))
    return replace(best, before=before, max_loss=max_loss, tried=tuple(tried))


def _none_good(
    board: Board, before: CompressionFigures, max_loss: float, tried: list[tuple[CompressionPoint, CompressionFigures]]
) -> str:
    """Why a search found nothing."""
    point, best = max(tried, key=lambda pair: pair[1].recall_at_1)
    enough = before.recall_at_1 - best.recall_at_1 + 5e-4
    return (
        f"nothing that {board.title} can run keeps R@1 within {max_loss:g} of {before.recall_at_1:.3f}; with "
        f"{point.weight_bits} bits, {point.prune:g} pruned, it is {best.recall_at_1:.3f}: use --max-loss {enough:.3f}"
    )


def _memory_bits(network: FixedNetwork) -> int:
    """Bits that the inputs' synapses take, each row dense or sparse, whichever is less; headers aside."""
    index = max(1, network.neurons - 1).bit_length()
    sparse = network.prepared.row_sizes * (network.stored_bits + index)
    return int(np.minimum(sparse, network.neurons * network.stored_bits).sum())
