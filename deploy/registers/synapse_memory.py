"""Synapse memory word by word: rows are packed into 64-bit words and read back, and every contradiction is refused.

The layout is described in `lava_vpr.deploy.registers.synapses`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.memory import row_words
from lava_vpr.deploy.registers.synapses import COUNT_BITS, ID_BITS, SynapseFormat, SynapseRows
from lava_vpr.errors import ModelFileError
from lava_vpr.kernelcache import compiled
from lava_vpr.loihi import BLOCK_HEADER_BITS, BLOCK_SYNAPSES, CORE_FORMATS, WORD_BITS


def _widths(formats: Sequence[SynapseFormat | None]) -> NDArray[np.int64]:
    """Index bits and weight bits of every format number, int64 (16, 2).

    Formats that are not in use have 0 weight bits.
    """
    widths = np.zeros((CORE_FORMATS, 2), np.int64)
    for number, form in enumerate(formats):
        if form is not None:
            widths[number] = form.index_bits, form.weight_bits
    return widths


@compiled(inline="always")
def _put(words: NDArray[np.uint64], at: int, value: int, bits: int) -> int:
    """Write ``value`` into the bits from ``at`` on, which are 0; returns the position after it."""
    word, offset = at >> 6, at & 63
    words[word] |= np.uint64(value) << np.uint64(offset)
    if offset + bits > 64:
        words[word + 1] |= np.uint64(value) >> np.uint64(64 - offset)
    return at + bits


@compiled(inline="always")
def _get(words: NDArray[np.uint64], at: int, bits: int) -> Any:
    """The value of the bits from ``at`` on."""
    word, offset = at >> 6, at & 63
    value = words[word] >> np.uint64(offset)
    if offset + bits > 64:
        value |= words[word + 1] << np.uint64(64 - offset)
    return np.int64(value & ((np.uint64(1) << np.uint64(bits)) - np.uint64(1)))


@compiled(nogil=True)
def _pack(
    starts: NDArray[np.int64],
    compartments: NDArray[np.int32],
    weights: NDArray[np.int32],
    formats: NDArray[np.uint8],
    widths: NDArray[np.int64],
    firsts: NDArray[np.int64],
    words: NDArray[np.uint64],
) -> None:
    """Write all rows into ``words``; row r begins at word ``firsts[r]``."""
    for r in range(formats.size):
        index_bits, weight_bits = widths[formats[r], 0], widths[formats[r], 1]
        at = firsts[r] << 6
        for begin in range(starts[r], starts[r + 1], BLOCK_SYNAPSES):
            end = min(begin + BLOCK_SYNAPSES, starts[r + 1])
            at = _put(words, (at + 63) & ~63, formats[r], ID_BITS)
            at = _put(words, at, end - begin - 1, COUNT_BITS)
            for s in range(begin, end):
                if index_bits > 0:
                    at = _put(words, at, compartments[s], index_bits)
                at = _put(words, at, weights[s] & ((1 << weight_bits) - 1), weight_bits)


def pack(rows: SynapseRows, formats: Sequence[SynapseFormat | None]) -> tuple[NDArray[np.uint64], NDArray[np.int32]]:
    """Synapse memory with ``rows`` in their order and without gaps.

    Args:
        rows: The rows to store; compartments of a dense row are 0, 1, 2 ..
        formats: Formats of the core, by number.
    Returns:
        Words uint64 (words,), and first word, words and synapses of each row, int32 (rows, 3).
    Raises:
        ValueError: a format cannot hold its rows.
    """
    widths, sizes = _widths(formats), np.diff(rows.starts)
    index_bits, weight_bits = np.repeat(widths[rows.formats], sizes, axis=0).T
    ranks = np.arange(len(rows.weights)) - np.repeat(rows.starts[:-1], sizes)
    placed = np.where(index_bits == 0, rows.compartments == ranks, rows.compartments >> index_bits == 0)
    spread = rows.weights + (1 << weight_bits >> 1)  # two's complement, from 0 on
    if not (widths[rows.formats, 1] > 0).all() or not (placed & (spread >> weight_bits == 0)).all():
        raise ValueError("a synapse does not fit the format of its row")
    lengths = row_words(sizes, widths[rows.formats].sum(axis=1))
    firsts = np.cumsum(lengths) - lengths
    words = np.zeros(int(lengths.sum()), np.uint64)
    _pack(rows.starts, rows.compartments, rows.weights, rows.formats, widths, firsts, words)
    return words, np.stack([firsts, lengths, sizes], axis=1).astype(np.int32)


_PROBLEMS = (
    "",
    "runs beyond the {words} words that the synapse map gives it",
    "names synapse format {value}, which the core does not have",
    "changes from one synapse format to another within the row",
    "holds {value} synapses or more, but the synapse map says {synapses}",
    "reaches compartment {value}, but the core has {compartments}",
    "fills {value} words, but the synapse map says {words}",
    "has bits behind its last synapse",
)
_RUNS_OUT, _NO_FORMAT, _MIXED, _TOO_MANY, _NO_COMPARTMENT, _TOO_FEW_WORDS, _TRAILING = range(1, 8)


@compiled(nogil=True)
def _unpack_row(
    words: NDArray[np.uint64],
    entry: NDArray[np.int32],
    widths: NDArray[np.int64],
    limit: int,
    compartments: NDArray[np.int32],
    weights: NDArray[np.int32],
) -> tuple[Any, int]:
    """Read the row at ``entry`` of the synapse map; returns its format and 0, or what was found and the problem's
    number."""
    at, end, done, form = np.int64(entry[0]) << 6, (np.int64(entry[0]) + entry[1]) << 6, 0, 0
    while done < entry[2]:
        if at >= end:
            return at, _RUNS_OUT
        number, count = _get(words, at, ID_BITS), _get(words, at + ID_BITS, COUNT_BITS) + 1
        index_bits, weight_bits = widths[number, 0], widths[number, 1]
        if weight_bits == 0:
            return number, _NO_FORMAT
        if done > 0 and number != form:
            return number, _MIXED
        form = number
        if done + count > entry[2]:
            return done + count, _TOO_MANY
        at += BLOCK_HEADER_BITS
        if at + count * (index_bits + weight_bits) > end:
            return at, _RUNS_OUT
        for _ in range(count):
            compartments[done] = _get(words, at, index_bits) if index_bits > 0 else done
            if compartments[done] >= limit:
                return compartments[done], _NO_COMPARTMENT
            weights[done] = _get(words, at + index_bits, weight_bits)
            if weights[done] >> (weight_bits - 1):  # below 0
                weights[done] -= 1 << weight_bits
            at += index_bits + weight_bits
            done += 1
        rest = -at & 63
        if rest > 0 and _get(words, at, rest) != 0:
            return at, _TRAILING
        at += rest
    return (form, 0) if at == end else ((at >> 6) - entry[0], _TOO_FEW_WORDS)


@compiled(nogil=True)
def _unpack(
    words: NDArray[np.uint64],
    entries: NDArray[np.int32],
    widths: NDArray[np.int64],
    limit: int,
    starts: NDArray[np.int64],
    compartments: NDArray[np.int32],
    weights: NDArray[np.int32],
    formats: NDArray[np.uint8],
) -> tuple[int, int, int]:
    """Read all rows; returns the first row with a problem, what was found there and the problem's number, 0 without
    one."""
    for r in range(formats.size):
        row = slice(starts[r], starts[r + 1])
        value, problem = _unpack_row(words, entries[r], widths, limit, compartments[row], weights[row])
        if problem != 0:
            return r, value, problem
        formats[r] = value
    return 0, 0, 0


def unpack(
    words: NDArray[np.uint64],
    axons_in: NDArray[np.int32],
    formats: Sequence[SynapseFormat | None],
    compartments: int,
    where: str = "synapse memory",
) -> SynapseRows:
    """The rows of all input axons.

    Args:
        words: Synapse memory, uint64 (words,).
        axons_in: First word, words and synapses of each, int32 (axons, 3).
        formats: Formats of the core, by number.
        compartments: Number of compartments of the core.
        where: The core's name, for messages.
    Raises:
        ModelFileError: the memory contradicts the synapse map.
    """
    first, length, sizes = axons_in.T.astype(np.int64)
    outside = (first < 0) | (length < 0) | (sizes < 0) | (first + length > len(words)) | (sizes > length * WORD_BITS)
    if outside.any():
        axon = int(np.argmax(outside))
        raise ModelFileError(
            f"{where}: input axon {axon} has words {first[axon]} to {first[axon] + length[axon] - 1} of a memory of "
            f"{len(words)} for {sizes[axon]} synapses; deploy the model again"
        )
    starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(sizes)])
    reached, weights, numbers = *np.zeros((2, int(starts[-1])), np.int32), np.zeros(len(sizes), np.uint8)
    entries = np.ascontiguousarray(axons_in, np.int32)
    axon, value, problem = _unpack(words, entries, _widths(formats), compartments, starts, reached, weights, numbers)
    if problem:
        words_, synapses = entries[axon, 1:]
        text = _PROBLEMS[problem].format(value=value, words=words_, synapses=synapses, compartments=compartments)
        raise ModelFileError(f"{where}: the row of input axon {axon} {text}; deploy the model again")
    return SynapseRows(starts, reached, weights, numbers)


def stored_rows(
    words: NDArray[np.uint64], axons_in: NDArray[np.int32], where: str = "synapse memory"
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """The rows of a memory; a row that several axons share is listed once.

    Returns:
        The rows' entries of the synapse map, int32 (rows, 3), and the row of each axon, int64 (axons,).
    Raises:
        ModelFileError: rows overlap, or words belong to no row.
    """
    entries, row_of = np.unique(axons_in.reshape(-1, 3), axis=0, return_inverse=True)
    ends = entries[:, 0].astype(np.int64) + entries[:, 1]
    if not np.array_equal(np.append(entries[:, 0], len(words)), np.append(0, ends)):
        raise ModelFileError(f"{where}: the rows of its input axons do not tile its memory; deploy the model again")
    return entries.astype(np.int32), row_of.reshape(-1).astype(np.int64)
