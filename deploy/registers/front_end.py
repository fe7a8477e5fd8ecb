"""Register-level simulation of the cores of a spiking front end, from pixels to every spike.

Before each image the host clears current and membrane of every compartment and writes the biases of pixels, their grey
levels, once. Where neurons of places hear the cells, it also writes the bias of the clock's first neuron and, if each
presentation has its own, those of the neurons of places. It writes nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.registers.core_images import CoreImage
from lava_vpr.deploy.registers.simulator import Wired
from lava_vpr.deploy.registers.simulator_kernels import present
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.loihi import BIAS_EXPONENT_LIMIT


@dataclass(frozen=True)
class FrontEndChips:
    """Chips whose cores hold a front end.

    Attributes:
        wired: The cores.
        places: Positions of each population's neurons among all compartments, int64 (neurons,), by name.
        exponents: Of the biases of pixels, int64 (pixels,).
        steps: Steps of a presentation.
    """

    wired: Wired
    places: Mapping[str, NDArray[np.int64]] = field(repr=False)
    exponents: NDArray[np.int64] = field(repr=False)
    steps: int

    @staticmethod
    def of(images: Sequence[CoreImage], tables: Mapping[str, NDArray[np.int32]], steps: int) -> FrontEndChips:
        """The chips whose cores hold ``images``.

        Args:
            images: Images of all cores.
            tables: Chip, core and compartment of every neuron of each population, int32 (neurons, 3), by name.
            steps: Steps of a presentation.
        Raises:
            ModelFileError: the memory of a core contradicts its synapse map.
        """
        wired = Wired.of(images)
        places = {name: wired.at(table) for name, table in tables.items()}
        exponents = np.concatenate([image.compartments[:, 3] for image in images]).astype(np.int64)
        return FrontEndChips(wired, places, exponents[places["pixels"]], steps)

    def present(self, images: PixelBlock) -> dict[str, NDArray[np.uint8]]:
        """Every spike of each population by name, uint8 (n, steps, neurons).

        Args:
            images: Some images.
        Raises:
            NetworkLimitError: an accumulator overflows.
            ModelFileError: spikes are in flight after the last step.
        """
        grey, bias = images
        films = {name: np.zeros((len(grey), self.steps, len(at)), np.uint8) for name, at in self.places.items()}
        nothing = np.zeros(self.steps + 1, np.int64), np.zeros(0, np.int64)
        for number, levels in enumerate(grey.reshape(len(grey), -1).astype(np.int64)):
            state = self.wired.rested()
            pixels = self.places["pixels"]
            state.bias[pixels] = levels << self.exponents
            state.bias[self.places["clock"][0]] = 1 << BIAS_EXPONENT_LIMIT
            if bias is not None:
                state.bias[self.places["exc"]] = bias[number]
            film = np.zeros((self.steps, len(state.bias)), np.uint8)
            stopped = present(self.wired.wiring, state, self.wired.threshold, pixels, self.steps, *nothing, film)
            self.wired.check(state, number, *stopped)
            for name, at in self.places.items():
                films[name][number] = film[:, at]
        return films
