"""The spiking front end: an image becomes spike counts of cells, by populations of integer neurons alone.

An image is brought to ``width`` x ``width / 2`` grey pixels; events come as they are. From then on everything is
spikes of the neurons that
`lava_vpr.engine.general` simulates (docs/network.md has their equations)::

    clock --> pixels --> filters --> pairs --> onsets --> cells <--> pools
          \\____________^

1. **Pixels** integrate their grey level as a bias, and spike once: the brighter, the earlier, a step for each of
   ``levels`` levels of the logarithm. The clock sees to it: neuron s of this chain spikes in step s. Or **events** are
   spikes that pixels add up in the ``window`` steps before.
2. **Filters** are derivatives in ``2 orientations`` directions at every pixel of every other column. Their currents
   keep what pixels add, so that membranes integrate weight times level. Then the clock raises all membranes alike, so
   that a filter spikes the earlier the larger the logarithm of its response: once, in one of ``race`` steps.
3. A **pair** needs two filters, 67.5 degrees to either side of its direction: an edge's is the later of both spikes. Or
   it hears those of ``joined`` sites, and needs ``needed`` spikes.
4. An **onset** spikes once, with the first pair of its cell and channel, whatever the sign of contrast. Its **cell**
   then spikes in every step, ``most`` times at most.
5. A **pool** counts the spikes of all cells around, and silences its own once these have spent their budget. So time
   is divided by what is around, and a cell's count is the logarithm of a ratio.

The counts are the activity. The kernel beside makes them, for each cell those of the populations.

With ``reading`` steps the network of places hears the cells themselves, as they spike (``--input frontend-direct``;
`lava_vpr.engine.inference.direct`): a presentation then ends with these steps, and its bursts are the activity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError
from lava_vpr.inputs.front_end_kernels import RaceNumbers, counted, lasting, pair_steps
from lava_vpr.inputs.patches import averaged, grey_levels
from lava_vpr.loihi import INPUT_SHIFT, STATE_LIMIT, WEIGHT_EXPONENT_LIMIT, WEIGHT_LIMIT

BURST = 8
"""A burst is the step of its first spike times this, plus the number of its spikes, which is less."""
BURST_STEPS = 10
"""Steps of the race in which nearly all spikes of cells fall."""
_FRACTION = 128
"""Steps that a burst's fraction is in units of; more than twice those of a presentation."""
COLUMNS = 2
"""Every other column of pixels has filters."""
LONGEST = 64
"""Most steps of a presentation: a neuron that has silenced itself by a spike stays so for twice as many."""
SPARE = 16
"""What rounding can add to a filter's current, and more, in units of a weight."""


@dataclass(frozen=True)
class FrontEnd:
    """Everything about the front end, in integers but for the numbers that these are made from.

    Attributes:
        width: Pixels of a row; there are half as many rows.
        cell: Columns of pixels of a cell, which has half as many rows.
        orientations: Channels, evenly spaced over 180 degrees: a multiple of 8.
        reach: Cells to each side that a pool listens to.
        levels: Levels of a pixel, one a step.
        white: The least grey level, or number of events, that spikes in the first of these steps.
        pixel_octaves: Octaves below it that the levels span.
        across, down: Weights that a filter smooths with along a row and along a column, before it takes differences.
        unit: What a filter's weights are made whole with.
        race: Steps in which filters spike.
        race_octaves: Octaves of response that they span.
        top: The response that spikes first, as a share of half the product of the weights' sums, ``unit`` and levels.
        budget: Spikes around after which a pool spikes; of those at the edge of the image, in proportion.
        most: Most spikes of a cell.
        window: Steps in which events arrive, before those of the levels; 0: images of grey levels are shown.
        axons: Rows and columns of axons of a pixel, which events arrive on.
        joined: Sites side by side, a divisor of those of a cell, whose filters a pair hears.
        needed: Spikes of these that a pair needs.
        reading: Steps after the cells' last spikes in which neurons of places, which hear the cells directly, spike;
            0: none hears them.
    """

    width: int = 64
    cell: int = 4
    orientations: int = 8
    reach: int = 2
    levels: int = 26
    white: int = 255
    pixel_octaves: float = 4.0
    across: tuple[int, ...] = (1, 3, 4, 3, 1)
    down: tuple[int, ...] = (1, 4, 1)
    unit: int = 20
    race: int = 14
    race_octaves: float = 7.0
    top: float = 1.0
    budget: int = 120
    most: int = 7
    window: int = 0
    axons: int = 2
    joined: int = 1
    needed: int = 2
    reading: int = 0

    def __post_init__(self) -> None:
        for name, value, unit in (
            ("width", self.width, self.cell),
            ("cell", self.cell, max(2, self.joined) * COLUMNS),
            ("orientations", self.orientations, 8),
        ):
            if value % unit:
                raise ConfigError(f"a front end's {name} is {value}, but must be a multiple of {unit}")
        if self.reading and self.most >= BURST:
            raise ConfigError(f"cells that neurons hear have at most {BURST - 1} spikes, not {self.most}; use fewer")
        if self.steps > LONGEST:
            raise ConfigError(f"a presentation of {self.steps} steps is longer than {LONGEST}; use fewer levels")

    @property
    def height(self) -> int:
        """Rows of pixels."""
        return self.width // 2

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of what `seen` makes of an image."""
        each = self.axons if self.window else 1
        return self.height * each, self.width * each

    @property
    def grid(self) -> int:
        """Cells of a row, and of a column."""
        return self.width // self.cell

    @property
    def directions(self) -> int:
        """Directions of filters and pairs, over 360 degrees."""
        return 2 * self.orientations

    @property
    def apart(self) -> int:
        """Directions between a pair and either of its filters: 67.5 degrees."""
        return 3 * self.orientations // 8

    @property
    def steps(self) -> int:
        """Steps of a presentation: those in which neurons can spike, and two until nothing is in flight."""
        return self.ticks + 2

    @property
    def ticks(self) -> int:
        """Steps in which the clock spikes: in the last it silences cells, or who hears them."""
        return self.end + self.reading

    @property
    def begin(self) -> int:
        """The first step of the race, in which neurons that hear cells directly get their biases."""
        return self.window + self.levels

    @property
    def rising(self) -> int:
        """The last step of the race, from which on the clock raises neurons that hear cells directly."""
        return self.begin + self.race

    @property
    def end(self) -> int:
        """The step in which the clock silences all cells: pixels, race, and what its last spike takes to the cells."""
        return self.window + self.levels + self.race + 3

    @property
    def populations(self) -> dict[str, int]:
        """The number of neurons of each population."""
        sites, cells = self.height * self.width // COLUMNS * self.directions, self.grid**2 * self.orientations
        return {
            "clock": self.ticks + (self.reading > 0),  # two silence neurons that hear cells directly
            "pixels": self.height * self.width,
            "filters": sites,
            "pairs": sites // self.joined,
            "onsets": cells,
            "cells": cells,
            "pools": self.grid**2,
        }

    def further_groups(self) -> dict[str, Any]:
        """Populations behind the front end, as `lava_vpr.inputs.front_end_network.populations` has them: none."""
        return {}

    def further_weights(self) -> dict[tuple[str, str], Any]:
        """Synapses to them, as `lava_vpr.inputs.front_end_network.all_weights` has them: none."""
        return {}

    @property
    def accesses(self) -> int:
        """Neurons times steps of a presentation."""
        return sum(self.populations.values()) * self.steps

    @cached_property
    def filters(self) -> NDArray[np.int64]:
        """Weights of the filters, (directions, rows, columns); each sums to 0.

        Rows are twice as far apart as columns are, so that the difference along a column counts half.
        """
        across, down = np.array(self.across), np.array(self.down)
        shape = len(down) + 2, len(across) + 2
        x, y = np.zeros(shape), np.zeros(shape)
        x[1:-1] = np.outer(down, np.convolve(across, (-1, 0, 1)))
        y[:, 1:-1] = np.outer(np.convolve(down, (-1, 0, 1)), across) / 2
        angles = 2 * math.pi * np.arange(self.directions) / self.directions
        made = self.unit * (np.cos(angles)[:, None, None] * x + np.sin(angles)[:, None, None] * y)
        return np.rint(np.round(made, 6)).astype(np.int64)

    @cached_property
    def grey_levels(self) -> NDArray[np.int64]:
        """The least grey level, or number of events, that spikes in each step, (levels,): all do in the last."""
        shares = np.arange(self.levels - 1, 0, -1) / self.levels
        least = np.ceil(self.white * 2.0 ** (self.pixel_octaves * (shares - 1)))
        return np.append(least, 0).astype(np.int64)

    @cached_property
    def responses(self) -> NDArray[np.int64]:
        """What a filter's response is above if it spikes in each step of the race, (race,)."""
        first = self.top * self.unit * sum(self.across) * sum(self.down) * self.levels / 2
        shares = np.arange(self.race) / max(1, self.race - 1)
        return np.floor(first * 2.0 ** (-self.race_octaves * shares)).astype(np.int64)

    @property
    def pixel_threshold(self) -> int:
        """Threshold of pixels: the grey levels of the first step are above; all events of a window are not."""
        return self.window * self.axons**2 if self.window else int(self.grey_levels[0]) - 1

    @property
    def filter_threshold(self) -> int:
        """Threshold of filters, which none reaches before the race, whatever is rounded."""
        largest = int(np.maximum(self.filters, 0).sum(axis=(1, 2)).max()) * (self.levels - 1)
        return max(largest, int(self.responses[0])) + SPARE * self.levels

    @cached_property
    def pixel_clock(self) -> NDArray[np.int64]:
        """What the clock's spikes add to pixels, so that these are above the threshold from the level on that is due.

        In step t a pixel of grey level g has integrated (t + 1) g and what the clock added from the second step on,
        (levels - 1,). One that n events have reached stays at n, and the clock adds to it from the first step on,
        (levels,).
        """
        if self.window:
            return -np.diff(self.grey_levels, prepend=self.pixel_threshold + 1)
        return -np.diff(np.arange(1, self.levels + 1) * self.grey_levels)

    @cached_property
    def filter_clock(self) -> NDArray[np.int64]:
        """What the clock's spikes add to the currents of filters from step ``levels - 1`` on, (race + 1,).

        Currents last, so that a step's is the rise of membranes in it, but for what they lose in every step, which is
        given back; the last ends the race, whatever is rounded.
        """
        made, current, membrane = [], 0, 0
        for rise in self.filter_threshold - self.responses:
            current = lasting(current)
            made.append((int(rise << INPUT_SHIFT) - membrane - current) >> INPUT_SHIFT)
            current += made[-1] << INPUT_SHIFT
            membrane += current
        made.append(-(current >> INPUT_SHIFT) - SPARE)
        return np.array(made)

    @property
    def silencing(self) -> int:
        """What a pool, or the clock at the end, takes from cells: more than an onset ever gives."""
        return WEIGHT_LIMIT

    @property
    def own_silencing(self) -> int:
        """What the spike of a neuron that spikes once takes from itself: more than comes to it afterwards."""
        return WEIGHT_LIMIT << WEIGHT_EXPONENT_LIMIT

    @property
    def onset_weight(self) -> int:
        """What an onset gives its cell: enough for ``most`` spikes, each of which takes `cell_weight`."""
        return self.most * self.cell_weight

    @property
    def cell_weight(self) -> int:
        """What a cell's spike takes of its current; half of it is its threshold."""
        return 16

    @cached_property
    def budgets(self) -> NDArray[np.int64]:
        """Spikes at which each pool spikes, (grid, grid)."""
        places = np.arange(self.grid)
        heard = np.minimum(places + self.reach, self.grid - 1) - np.maximum(places - self.reach, 0) + 1
        return -(-self.budget * np.outer(heard, heard) // (2 * self.reach + 1) ** 2)

    @cached_property
    def numbers(self) -> RaceNumbers:
        """What the kernel reads of all this."""
        if 2 * self.filter_threshold << INPUT_SHIFT >= STATE_LIMIT:  # the largest response, and the whole race on it
            raise ConfigError("the front end's filters could leave 24 bits; use a smaller unit")
        steps = np.searchsorted(-self.grey_levels, -np.arange(256))
        return RaceNumbers(
            filters=np.ascontiguousarray(self.filters.transpose(1, 2, 0) << INPUT_SHIFT, np.int32),
            pixel_steps=steps.astype(np.int64),
            levels=self.levels,
            clock=(self.filter_clock << INPUT_SHIFT).astype(np.int32),
            threshold=np.int32(self.filter_threshold << INPUT_SHIFT),
            budgets=self.budgets,
            apart=self.apart,
            reach=self.reach,
            most=self.most,
            columns=COLUMNS,
            joined=self.joined,
            needed=self.needed,
        )

    def seen(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """What the front end is given of ``image`` (h, w) or (h, w, 3) BGR, uint8 (`shape`).

        Grey levels of pixels; or the events that each axon carries: every event of the sensor goes to one axon, which
        carries one a step, ``window`` at most.
        """
        if not self.window:
            return grey_levels(averaged(image, self.width, self.height))
        events = grey_levels(image)
        for axis, pixels in enumerate((self.height, self.width)):  # a sensor of fewer: each of its own is several
            events = events.repeat(max(1, -(-pixels // events.shape[axis])), axis)
        rows, columns = (np.arange(n) * to // n for n, to in zip(events.shape, self.shape, strict=True))
        at = (rows[:, None] * self.shape[1] + columns).ravel()
        counts = np.bincount(at, events.ravel(), math.prod(self.shape)).reshape(self.shape)
        return np.minimum(counts, self.window).astype(np.uint8)

    def levels_of(self, shown: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """What each pixel adds up of what `seen` made, (..., *shape): uint8 (..., height, width)."""
        if not self.window:
            return shown
        blocks = shown.reshape(*shown.shape[:-2], self.height, self.axons, self.width, self.axons)
        return blocks.sum(axis=(-3, -1), dtype=np.uint8)

    def events(self, shown: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Events as spikes of axons: those of a window spread evenly over its steps, bool (n, steps, axons).

        Args:
            shown: How many events each axon carries (`seen`), uint8 (n, *shape).
        """
        made = np.zeros((len(shown), self.steps, math.prod(self.shape)), bool)
        counts, now = shown.reshape(len(shown), 1, -1).astype(np.int64), np.arange(self.window + 1)[:, None]
        made[:, : self.window] = np.diff(counts * now // self.window, axis=1) > 0
        return made

    def spikes(self, image: NDArray[np.uint8]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """The spikes of cells, int32 (orientations, grid, grid), and of each population after the clock, int64 (6,)."""
        _, (counts, spikes, _, _) = counted(self.levels_of(self.seen(image)), self.numbers)
        return counts, spikes

    def bursts(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        """The burst of each cell that sees ``image``, float32 (orientations, grid, grid): how many spikes, and in the
        fraction, the earlier the larger, when it begins (`burst_codes`)."""
        return self.bursts_of(self.seen(image))

    def bursts_of(self, shown: NDArray[np.uint8]) -> NDArray[np.float32]:
        """`bursts` of what `seen` made of an image, uint8 (*shape,)."""
        _, (counts, _, onsets, _) = counted(self.levels_of(shown), self.numbers)
        earliness = (LONGEST - self.window - 1 - onsets) / np.float32(_FRACTION)
        return np.where(counts > 0, counts + earliness, 0).astype(np.float32)

    def burst_codes(self, activity: NDArray[np.float32]) -> NDArray[np.uint16]:
        """Bursts (..., cells) as whole numbers: the step of the first spike times `BURST`, plus how many there are.

        Args:
            activity: `bursts`; of images that were altered, any real numbers of at least 0.
        """
        counts = np.minimum(np.floor(activity), self.most)
        first = LONGEST - np.rint((activity - np.floor(activity)) * _FRACTION)
        first = np.clip(first, self.window + self.levels, self.end - counts)
        return np.where(counts > 0, first * BURST + counts, 0).astype(np.uint16)

    def trains(self, grey: NDArray[np.uint8], bias: NDArray[np.int32] | None = None) -> dict[str, NDArray[np.uint8]]:
        """Every spike of each population by name, uint8 (n, steps, neurons).

        Args:
            grey: What the front end is given of each image (`seen`), uint8 (n, *shape).
            bias: Biases of the neurons that hear the cells, of which a front end alone has none.
        """
        films = {name: np.zeros((len(grey), self.steps, n), np.uint8) for name, n in self.populations.items()}
        clock = np.arange(self.populations["clock"])
        films["clock"][:, np.minimum(clock, self.ticks - 1), clock] = 1
        now = np.arange(self.steps)[:, None]
        for number, image in enumerate(self.levels_of(grey)):
            times, (counts, _, onsets, silent) = counted(image, self.numbers)
            steps = {
                "pixels": self.numbers.pixel_steps[image],
                "filters": times,
                "pairs": pair_steps(times, self.numbers) + 1,
                "onsets": onsets,
                "pools": silent - 1,
            }
            for name, each in steps.items():
                films[name][number] = now == each.reshape(-1) + self.window
            begun = onsets.reshape(-1) + self.window
            films["cells"][number] = (now > begun) & (now <= begun + counts.reshape(-1))
        return films
