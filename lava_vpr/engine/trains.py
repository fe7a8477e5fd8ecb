"""Every spike of some presentations."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Trains:
    """Spikes of each population, uint8 (n, interval, width); None where a backend has no such spikes."""

    exc: NDArray[np.uint8] = field(repr=False)
    inputs: NDArray[np.uint8] | None = field(default=None, repr=False)
    inh: NDArray[np.uint8] | None = field(default=None, repr=False)

    POPULATIONS: ClassVar[tuple[str, ...]] = ("inputs", "exc", "inh")
    DECIDED: ClassVar[tuple[str, ...]] = ("exc", "inh")
    """The populations whose spikes the network decides; those of inputs are drawn from rates and key."""

    def part(self, presentations: slice) -> Trains:
        """The spikes of some of the presentations."""
        inputs = None if self.inputs is None else self.inputs[presentations]
        inh = None if self.inh is None else self.inh[presentations]
        return Trains(self.exc[presentations], inputs, inh)
