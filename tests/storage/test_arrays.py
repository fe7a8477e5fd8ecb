"""Arrays in ``.npy`` files: read as NumPy reads them, and a file of a stranger costs nothing beyond its limit."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray

from lava_vpr.errors import InputError
from lava_vpr.storage.arrays import array_of, read_array


def npy(array: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


KINDS = st.sampled_from(["?", "i1", "u1", "<i2", "<u4", "<i8", "<u8", "<f2", "<f4", "<f8"])


@given(
    array=KINDS.flatmap(lambda kind: arrays(kind, array_shapes(min_dims=0, max_dims=4, min_side=0))),
    turned=st.booleans(),
)
@settings(deadline=None, max_examples=200, derandomize=True)
def test_it_reads_what_numpy_reads(array: NDArray[Any], turned: bool) -> None:
    data = npy(array.T if turned else array)
    wanted, found = np.load(io.BytesIO(data)), array_of(data)
    assert found.dtype == wanted.dtype
    assert found.shape == wanted.shape
    assert found.tobytes() == wanted.tobytes()
    assert found.flags.f_contiguous == wanted.flags.f_contiguous


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f4', 'fortran_order': False, 'shape': (2,3), }",  # libnpy, NPZ.jl
        "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3)}\n",
        "{'descr':'<f4','fortran_order':False,'shape':(2,3),}",
    ],
)
def test_other_writers_are_read(header: str) -> None:
    """Their headers end where they like, so the numbers are out of step with the machine's words."""
    content = np.arange(6, dtype=np.float32)
    data = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + content.tobytes()
    found = array_of(data)
    assert found.flags.aligned
    assert np.array_equal(found, content.reshape(2, 3))


def test_a_view_can_be_written_if_its_memory_can() -> None:
    data = bytearray(npy(np.zeros(3, np.int32)))
    array_of(memoryview(data))[1] = 7
    assert np.array_equal(array_of(bytes(data)), [0, 7, 0])
    with pytest.raises(ValueError, match="read-only"):
        array_of(bytes(data))[0] = 1


def test_what_it_may_cost_is_bounded_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "long.npy"
    path.write_bytes(npy(np.zeros(4)))
    with path.open("r+b") as file:
        file.truncate(5 << 30)  # takes no space on the disk
    with pytest.raises(
        InputError, match=r"has 5,368,709,120 bytes, more than the 4,294,967,296 allowed; .*ARRAY_BYTES"
    ):
        read_array(path, "write it anew")
    path.write_bytes(npy(np.zeros(4)))
    monkeypatch.setenv("LAVA_VPR_MAX_ARRAY_BYTES", "100")
    with pytest.raises(InputError, match="has 160 bytes, more than the 100 allowed"):
        read_array(path, "write it anew")
