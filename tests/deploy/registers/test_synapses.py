"""Synapse memory: the layout bit by bit, its size, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from lava_vpr.deploy.boards.memory import row_words
from lava_vpr.deploy.registers.synapse_memory import pack, stored_rows, unpack
from lava_vpr.deploy.registers.synapses import Formats, SynapseFormat, SynapseRows, index_bits, joined
from lava_vpr.errors import ModelFileError

DENSE = SynapseFormat(5, 0, -4)
SPARSE = SynapseFormat(8, 6, -1)


def rows_of(*rows: tuple[int, list[int], list[int]]) -> SynapseRows:
    """Rows of (format, compartments, weights)."""
    sizes = [0, *(len(weights) for _, _, weights in rows)]
    return SynapseRows(
        np.cumsum(sizes),
        np.array([c for _, compartments, _ in rows for c in compartments], np.int32),
        np.array([w for _, _, weights in rows for w in weights], np.int32),
        np.array([form for form, _, _ in rows], np.uint8),
    )


def literal(rows: SynapseRows, formats: list[SynapseFormat | None]) -> tuple[list[int], list[list[int]]]:
    """The same memory with Python's numbers as bit strings."""
    words: list[int] = []
    entries = []
    for r, number in enumerate(rows.formats):
        form = formats[number]
        synapses = list(zip(rows.compartments, rows.weights, strict=True))[rows.starts[r] : rows.starts[r + 1]]
        first = len(words)
        for begin in range(0, len(synapses), 64):
            block = synapses[begin : begin + 64]
            text = f"{len(block) - 1:06b}{number:04b}"
            for compartment, weight in block:
                if form.index_bits:
                    text = f"{compartment:0{form.index_bits}b}" + text
                text = f"{weight % (1 << form.weight_bits):0{form.weight_bits}b}" + text
            value = int(text, 2)
            words += [value >> 64 * k & (1 << 64) - 1 for k in range(-(-len(text) // 64))]
        entries.append([first, len(words) - first, len(synapses)])
    return words, entries


def random_rows(seed: int) -> tuple[SynapseRows, list[SynapseFormat | None], int]:
    """Rows in random formats for a core with so many compartments."""
    rng = np.random.default_rng(seed)
    compartments = int(rng.choice([1, 3, 64, 65, 200]))
    need = index_bits(np.array([compartments - 1]))
    formats: list[SynapseFormat | None] = [None]
    for _ in range(int(rng.integers(1, 6))):
        width = 0 if rng.random() < 0.5 else int(rng.integers(need, 13))
        formats.append(SynapseFormat(int(rng.choice([1, 2, 3, 4, 5, 6, 8])), width, int(rng.integers(-7, 8))))
    rows = []
    for _ in range(int(rng.integers(0, 9))):
        number = int(rng.integers(1, len(formats)))
        form = formats[number]
        size = compartments if form.index_bits == 0 else int(rng.integers(1, compartments + 1))
        reached = np.sort(rng.choice(compartments, size, replace=False))
        least = -(1 << form.weight_bits - 1)
        rows.append((number, list(reached), list(least + rng.integers(0, 1 << form.weight_bits, size))))
    return rows_of(*rows), formats, compartments


def same(a: SynapseRows, b: SynapseRows) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in vars(a))


def test_the_layout_bit_by_bit() -> None:
    words, entries = pack(rows_of((1, [0, 1, 2], [9, 0, -16]), (2, [5], [-127])), [None, DENSE, SPARSE])
    dense = 1 | 2 << 4 | 9 << 10 | 0 << 15 | 16 << 20
    sparse = 2 | 0 << 4 | 5 << 10 | 129 << 16
    assert words.tolist() == [dense, sparse]
    assert entries.tolist() == [[0, 1, 3], [1, 1, 1]]
    assert (words.dtype, entries.dtype) == (np.uint64, np.int32)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 2**31))
def test_memory_is_the_literal_one_and_is_read_back(seed: int) -> None:
    rows, formats, compartments = random_rows(seed)
    words, entries = pack(rows, formats)
    expected_words, expected_entries = literal(rows, formats)
    assert words.tolist() == expected_words
    assert entries.reshape(-1, 3).tolist() == expected_entries
    bits = np.array([form.bits if form else 0 for form in formats])[rows.formats]
    assert entries[:, 1].tolist() == row_words(np.diff(rows.starts), bits).tolist()
    assert same(unpack(words, entries, formats, compartments), rows)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 2**31))
def test_no_flipped_bit_stays_unseen(seed: int) -> None:
    rows, formats, compartments = random_rows(seed)
    words, entries = pack(rows, formats)
    rng = np.random.default_rng(seed)
    for _ in range(20 if len(words) else 0):
        flipped = words.copy()
        flipped[rng.integers(len(words))] ^= np.uint64(1 << int(rng.integers(64)))
        try:
            assert not same(unpack(flipped, entries, formats, compartments), rows)
        except ModelFileError:
            continue


def test_weights_in_units_of_the_current() -> None:
    # A weight k of b bits, one of which is the sign, is k 2^(9 - b) in its register, which is worth 2^(6 + exponent).
    assert DENSE.currents(np.array([1, -16], np.int32)).tolist() == [64, -16 * 64]
    assert SPARSE.currents(np.array([-63, 127], np.int32)).tolist() == [-63 * 64, 127 * 64]
    assert SynapseFormat(3, 6, 1).currents(np.array([3], np.int32)).tolist() == [3 * 64 * 64 * 2]
    assert SynapseFormat(8, 6, -7).currents(np.array([3], np.int32)).tolist() == [3]
    rows = rows_of((2, [5], [-10]), (1, [0, 1], [1, 2]))
    assert rows.currents([None, DENSE, SPARSE]).tolist() == [-640, 64, 128]


def test_formats_as_registers() -> None:
    registers = SPARSE.registers
    shown = ("wgtExp", "wgtBits", "idxBits", "numSynapses", "fanoutType", "compression", "dlyBits", "tagBits")
    assert [registers[name] for name in shown] == [-1, 7, 1, 63, 1, 0, 0, 0]
    assert [DENSE.registers[name] for name in shown] == [-4, 5, 0, 63, 1, 3, 0, 0]
    for form in (SPARSE, DENSE):
        assert SynapseFormat.of(form.registers, "here") == form
    changes: tuple[dict[str, Any], ...] = (
        {"dlyBits": 1},
        {"fanoutType": 0},
        {"fanoutType": 3},
        {"compression": 3},
        {"wgtBits": 0},
        {"wgtBits": 8},
        {"idxBits": "1"},
        {"wgtExp": 8},
        {"wgtExp": None},
        {"more": 0},
    )
    for change in changes:
        with pytest.raises(ModelFileError, match=r"^chip 0 core 1: its registers describe no synapse format of ours;"):
            SynapseFormat.of(registers | change, "chip 0 core 1")
    with pytest.raises(ModelFileError, match="describe no synapse format"):
        SynapseFormat.of({}, "chip 0 core 1")


def test_formats_come_into_use() -> None:
    formats = Formats()
    weights = np.array([[0, 3, 0], [1, 0, 2], [0, 0, 4]])
    rows = formats.rows(weights, np.array([0, 1, 2]), np.array([False, True, False]), replace(SPARSE, weight_bits=4))
    assert [None if form is None else form.index_bits for form in formats] == [None, 0, 6]
    assert same(rows, rows_of((2, [1], [3]), (1, [0, 1, 2], [1, 0, 2]), (2, [2], [4])))
    only = Formats()
    only.rows(weights, np.array([7, 8, 9]), np.zeros(3, bool), SPARSE)
    assert len(only) == 2
    assert [index_bits(np.array([n])) for n in (0, 63, 64, 1023)] == [6, 6, 7, 10]
    assert joined([]).starts.tolist() == [0]


def bad_rows() -> dict[str, tuple[SynapseRows, list[SynapseFormat | None]]]:
    return {
        "above": (rows_of((1, [0], [16])), [None, DENSE]),
        "below": (rows_of((1, [0], [-17])), [None, DENSE]),
        "gap": (rows_of((1, [1], [1])), [None, DENSE]),
        "index": (rows_of((2, [64], [1])), [None, DENSE, SPARSE]),
        "unused": (rows_of((0, [0], [0])), [None, DENSE]),
    }


def test_the_formats_that_hold_weights() -> None:
    for bits, stored in ((5, 6), (6, 8), (7, 8), (1, 2)):
        form, top = SynapseFormat.of_whole_numbers(stored, 6), (1 << bits) - 1
        extremes = np.array([-top, top], np.int32)
        assert form.currents(extremes).tolist() == (64 * extremes).tolist()
        assert abs(form.exponent) <= 7
        words, entries = pack(rows_of((1, [0, 1], extremes.tolist())), [None, form])
        assert unpack(words, entries, [None, form], 2).weights.tolist() == extremes.tolist()


@pytest.mark.parametrize("name", bad_rows())
def test_rows_that_their_format_cannot_hold(name: str) -> None:
    with pytest.raises(ValueError, match="a synapse does not fit"):
        pack(*bad_rows()[name])


def with_entry(entries: NDArray[np.int32], *values: int) -> NDArray[np.int32]:
    changed = entries.copy()
    changed[1] = values
    return changed


def test_what_cannot_be_read() -> None:
    formats: list[SynapseFormat | None] = [None, DENSE, SPARSE]
    long = list(range(63))
    words, entries = pack(rows_of((1, [0], [1]), (2, long, long)), formats)
    last = len(words) - 1  # 63 (8 + 6) + 10 bits: 892 of 896

    def refused(text: str, words: Any = words, entries: Any = entries, compartments: int = 63) -> None:
        with pytest.raises(ModelFileError, match=f"^chip 1 core 2: {text}; deploy the model again$"):
            unpack(words, entries, formats, compartments, "chip 1 core 2")

    def changed(word: int, bits: int) -> NDArray[np.uint64]:
        copy = words.copy()
        copy[word] ^= np.uint64(bits)
        return copy

    row = "the row of input axon 1"
    refused(f"{row} names synapse format 7, which the core does not have", changed(1, 5))
    refused(f"{row} holds 63 synapses or more, but the synapse map says 62", entries=with_entry(entries, 1, last, 62))
    refused(f"{row} reaches compartment 62, but the core has 62", compartments=62)
    refused(f"{row} has bits behind its last synapse", changed(last, 1 << 63))
    refused(f"{row} runs beyond the 13 words that the synapse map gives it", entries=with_entry(entries, 1, 13, 63))
    refused(f"{row} runs beyond the 14 words that the synapse map gives it", entries=with_entry(entries, 1, 14, 64))
    refused(f"{row} fills 1 words, but the synapse map says 2", entries=with_entry(entries, 0, 2, 1))
    refused("input axon 1 has words 2 to 15 of a memory of 15 for 63 synapses", entries=with_entry(entries, 2, 14, 63))
    refused("input axon 1 has words -1 to 0 of a memory of 15 for 1 synapses", entries=with_entry(entries, -1, 2, 1))
    refused("input axon 1 has words 0 to 0 of a memory of 15 for 999 synapses", entries=with_entry(entries, 0, 1, 999))
    two, entry = pack(rows_of((1, list(range(65)), [1] * 65)), formats)
    two[-1] ^= np.uint64(3)
    with pytest.raises(ModelFileError, match="axon 0 changes from one synapse format to another within the row"):
        unpack(two, entry, formats, 65)


def test_rows_are_stored_once_and_tile_the_memory() -> None:
    words, entries = pack(rows_of((1, [0], [1]), (1, [0, 1], [1, 2]), (1, [0], [3])), [None, DENSE])
    shared = entries[[1, 0, 1, 2]]
    stored, row_of = stored_rows(words, shared)
    assert stored.tolist() == entries.tolist()
    assert row_of.tolist() == [1, 0, 1, 2]
    for lost in (shared[:3], shared[[1, 3]], np.concatenate([shared, [[0, 2, 1]]])):
        with pytest.raises(ModelFileError, match=r"^there: the rows of its input axons do not tile its memory;"):
            stored_rows(words, lost, "there")
    assert stored_rows(words[:0], entries[:0])[1].size == 0
