"""Memory that Processes share with their models, which Lava runs in forks."""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray


def shared_array(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Zeros in anonymous memory that forked processes share with this one.

    Lava runs every model in a fork, and reading a Var back takes 23 us per element; what a model writes here is simply
    there. The memory lives as long as the array.

    Args:
        shape: Shape of the array, which may be empty.
        dtype: Type of its elements.
    """
    kind = np.dtype(dtype)
    size = int(np.prod(shape, dtype=np.int64)) * kind.itemsize
    if size == 0:
        return np.zeros(shape, kind)
    return np.frombuffer(mmap.mmap(-1, size), kind).reshape(shape)
