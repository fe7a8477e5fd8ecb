"""How a core stores the rows of inputs: sparse, with indices, or, where that is allowed, dense, without indices."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.mapping.sizing import GRAIN, Floats, Sizing


@dataclass(frozen=True)
class StoredRows:
    """How a core stores the rows to its excitatory neurons.

    Attributes:
        dense_inputs: Rows of the inputs that are dense, bool (inputs,).
        words: Words of these rows, of the root's and of the counters'.
        added: Synaptic operations in a step that dense rows cost more than sparse ones, summed.
        dense, sparse: Synaptic operations of the inputs in a step.
    """

    dense_inputs: NDArray[np.bool_] = field(repr=False)
    words: int
    added: float
    dense: float
    sparse: float


def choose_formats(sizing: Sizing, first: int, end: int, words: int) -> StoredRows | None:
    """How a core stores the rows to neurons ``first`` .. ``end - 1`` in at most ``words``; None: it cannot.

    All rows are sparse, unless `Sizing.may_be_dense`: then those without a zero are dense, and where memory demands
    more, rows turn dense in the order of words saved per operation added; what that saves beyond need is given back,
    the last to turn first. Where there is no index for so many neurons, all count as dense.
    """
    size, counts = end - first, sizing.counts(first, end)
    all_dense = sizing.board.memory.sparse_bits(size) is None
    dense = (counts > 0) & ((counts == size) & sizing.may_be_dense | all_dense)
    operations, least = (table[size, counts] for table in sizing.row_tables)
    used = int(operations.sum() + sizing.root_row[size]) + sizing.counters * size
    if used > words:
        added = np.maximum(sizing.grains * (size - counts), 0.5 / GRAIN)
        saved = operations - least
        turned = _cheapest_choice(saved, added, used - words)
        if turned is None:
            return None
        used -= int(saved[turned].sum())
        dense[turned] = True
    dense_spikes = sizing.grains * dense
    return StoredRows(
        dense,
        used,
        0.0 if all_dense else float(dense_spikes @ (size - counts)),
        float(dense_spikes.sum()) * size,
        float((sizing.grains - dense_spikes) @ counts),
    )


def _cheapest_choice(saved: NDArray[np.int64], added: Floats, need: int) -> list[int] | None:
    """What to choose so that ``saved`` sums to ``need``, by most saved per ``added``; None: there is not so much."""
    candidates = np.flatnonzero(saved > 0)
    order = candidates[np.argsort(-saved[candidates] / added[candidates], kind="stable")]
    sums = np.cumsum(saved[order])
    last = int(np.searchsorted(sums, need))
    if last == order.size:
        return None
    chosen, spare = order[: last + 1].tolist(), int(sums[last]) - need
    for number in range(last, -1, -1):
        if spare <= 0:
            break
        if saved[chosen[number]] <= spare:
            spare -= int(saved[chosen[number]])
            del chosen[number]
    return chosen
