"""How a core stores its rows: sparse, with indices, or dense, without; dense only as far as memory demands it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.mapping.sizing import GRAIN, Floats, Sizing


@dataclass(frozen=True)
class StoredRows:
    """How a core stores the rows of its excitatory neurons.

    Attributes:
        dense_inputs: Rows of the inputs that are dense, bool (inputs,).
        dense_lateral: Whether the rows of the neurons' own relays are dense.
        words: Words of all rows but those to relays.
        added: Synaptic operations in a step that a dense row costs more than a sparse one, summed.
        dense, sparse: Synaptic operations in a step of all rows but those to relays.
    """

    dense_inputs: NDArray[np.bool_] = field(repr=False)
    dense_lateral: bool
    words: int
    added: float
    dense: float
    sparse: float


def choose_formats(sizing: Sizing, first: int, end: int, words: int) -> StoredRows | None:
    """How a core stores the rows of neurons ``first`` .. ``end - 1`` in at most ``words``; None: it cannot.

    All rows are sparse but those without a zero. Where that is too much, rows turn dense in the order of words saved
    per operation added; what that saves beyond need is given back, the last to turn first.
    """
    size, counts = end - first, sizing.counts(first, end)
    dense_lateral = sizing.sparse_bits(size) is None
    dense = (counts > 0) & ((counts == size) | dense_lateral)
    used = 0
    if sizing.board.synapse_words is not None:
        fewest_operations, _ = sizing.row_tables
        row, dense_row = fewest_operations[size, counts], fewest_operations[size, size]
        lateral_sparse, lateral_dense = (int(table[size]) for table in sizing.lateral_words)
        used = int(row.sum()) + (lateral_dense if dense_lateral else lateral_sparse)
    if used > words:
        # The rows of the neurons' own relays turn together; they stand behind those of the inputs.
        saved = np.append(np.where(dense | (counts == 0), 0.0, row - dense_row), lateral_sparse - lateral_dense)
        if dense_lateral:
            saved[-1] = 0
        added = np.append(sizing.grains * (size - counts), size * sizing.spiking)
        turned = _cheapest_choice(saved, np.maximum(added, 0.5 / GRAIN), used - words)
        if turned is None:
            return None
        used -= int(saved[turned].sum())
        chosen = np.append(dense, dense_lateral)
        chosen[turned] = True
        dense, dense_lateral = chosen[:-1], bool(chosen[-1])
    more_dense, more_sparse = sizing.lateral_operations(np.array(size), np.array(dense_lateral))
    dense_spikes = sizing.grains * dense
    more = 0.0
    if not sizing.all_dense:
        more = float(dense_spikes @ (size - counts))
        if dense_lateral and sizing.inhibits and size > 1:
            more += size * sizing.spiking
    return StoredRows(
        dense,
        dense_lateral,
        used,
        more,
        float(dense_spikes.sum()) * size + float(more_dense),
        float((sizing.grains - dense_spikes) @ counts) + float(more_sparse),
    )


def _cheapest_choice(saved: Floats, added: Floats, need: int) -> list[int] | None:
    """What to choose so that ``saved`` sums to ``need``, by most saved per ``added``; None: there is not so much."""
    candidates = np.flatnonzero(saved > 0)
    order = candidates[np.argsort(-saved[candidates] / added[candidates], kind="stable")]
    sums = np.cumsum(saved[order])
    last = int(np.searchsorted(sums, need))
    if last == order.size:
        return None
    chosen, spare = order[: last + 1].tolist(), sums[last] - need
    for number in range(last, -1, -1):
        if spare <= 0:
            break
        if saved[chosen[number]] <= spare:
            spare -= saved[chosen[number]]
            del chosen[number]
    return chosen
