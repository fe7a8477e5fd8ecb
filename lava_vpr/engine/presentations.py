"""What all engines share: checks of their input arrays, threads, and recorded spikes.

Compiled code does not check the bounds of arrays, so shapes are checked first. Its kernels release Python's lock, and
no result depends on how threads share the presentations.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lava_vpr.errors import InputError


def check_array(array: NDArray[Any], name: str, dtype: DTypeLike, shape: tuple[int, ...], remedy: str) -> None:
    """Refuse an ``array`` whose type is not ``dtype`` or whose shape is not ``shape``.

    Raises:
        InputError: naming both, and the remedy.
    """
    if array.dtype != dtype or array.shape != shape:
        raise InputError(
            f"{name} of type {array.dtype} and shape {array.shape}, where {np.dtype(dtype)} {shape} is needed; {remedy}"
        )


def check_rates(rates: NDArray[Any], dtype: DTypeLike, shape: tuple[int, ...]) -> None:
    """Refuse rates of another type or shape than those of one presentation, (inputs,), or of many, (n, inputs).

    Raises:
        InputError: naming both.
    """
    check_array(rates, "rates", dtype, shape, "encode the images with the model's settings")


def check_presentations(rates: NDArray[Any], keys: NDArray[Any], dtype: DTypeLike, inputs: int) -> None:
    """Refuse rates that are not (n, inputs), or keys that are not one for each presentation.

    Raises:
        InputError: naming what does not fit.
    """
    check_rates(rates, dtype, (len(rates), inputs))
    check_array(keys, "keys", np.uint64, (len(rates),), "make one for each presentation")


T = TypeVar("T")


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def share(run: Callable[[slice], T], n: int, threads: int) -> list[T]:
    """Call ``run`` on consecutive slices of 0..n-1, one per thread; results in order."""
    size = max(1, -(-n // max(1, threads)))
    parts = [slice(start, min(n, start + size)) for start in range(0, n, size)]
    if len(parts) <= 1:
        return [run(part) for part in parts]
    with ThreadPoolExecutor(len(parts)) as pool:
        return list(pool.map(run, parts))


class PixelBlock(NamedTuple):
    """Some images that a spiking front end is shown.

    Attributes:
        grey: What its pixels take of each, uint8 (n, height, width).
        bias: Biases of the neurons that hear its cells in each presentation, int32 (n, neurons); None: their own.
    """

    grey: NDArray[np.uint8]
    bias: NDArray[np.int32] | None = None

    def part(self, chosen: slice) -> PixelBlock:
        """Some of the images."""
        return PixelBlock(self.grey[chosen], None if self.bias is None else self.bias[chosen])

    def in_parts(self, most: int) -> list[PixelBlock]:
        """The images, at most ``most`` at a time."""
        return [self.part(slice(start, start + most)) for start in range(0, len(self.grey), most)]


@dataclass(frozen=True)
class Trains:
    """Spikes of each population, uint8 (n, interval, width); None where a backend has no such spikes."""

    exc: NDArray[np.uint8] = field(repr=False)
    inputs: NDArray[np.uint8] | None = field(default=None, repr=False)
    inh: NDArray[np.uint8] | None = field(default=None, repr=False)

    POPULATIONS: ClassVar[tuple[str, ...]] = ("inputs", "exc", "inh")
    DECIDED: ClassVar[tuple[str, ...]] = ("exc", "inh")
    """The populations whose spikes the network decides; those of inputs are drawn from rates and key."""

    @property
    def films(self) -> dict[str, NDArray[np.uint8]]:
        """The trains of the populations that have some, by name."""
        return {name: film for name in self.POPULATIONS if (film := getattr(self, name)) is not None}

    def part(self, presentations: slice) -> Trains:
        """The spikes of some of the presentations."""
        inputs = None if self.inputs is None else self.inputs[presentations]
        inh = None if self.inh is None else self.inh[presentations]
        return Trains(self.exc[presentations], inputs, inh)
