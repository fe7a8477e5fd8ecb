"""The assignment of neurons to the cores of a board, and the storage format of their synapses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.boards.constants import Estimate
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.loihi import THRESHOLD_LIMIT, WEIGHT_BITS

PopulationName = Literal["exc", "counters", "inh", "inputs"]

RELAY_WEIGHT, RELAY_THRESHOLD = 2, 1
"""A spike adds 2 << 6 to an inhibitory neuron or an input's relay, above the threshold of 1 << 6; the chip has no
threshold of 0."""

COUNTER_WEIGHT, COUNTER_THRESHOLD = 2, THRESHOLD_LIMIT - 1
"""A spike of an excitatory neuron adds 2 << 6 to the membrane of its counter, which keeps it. The longest presentation
adds less than a hundredth of the counter's threshold."""


@dataclass(frozen=True)
class PopulationPart:
    """Neurons ``first`` .. ``first + size - 1`` of a population, on a core's compartments from ``compartment``."""

    population: PopulationName
    first: int
    size: int
    compartment: int


@dataclass(frozen=True)
class Needs:
    """The resources that a core's content needs; None where the board's way of counting is not public."""

    compartments: int
    axons_in: int | None
    axons_out: int | None
    synapse_words: int | None
    profiles: int | None
    thresholds: int | None
    formats: int | None


@dataclass(frozen=True)
class Load:
    """The expected load of a core in one step with input.

    Attributes:
        messages_in, messages_out: Spikes that arrive and leave.
        operations_dense, operations_sparse: Synaptic operations by the format of their rows.
        updates: Compartments that are accessed and updated.
        spikes: Spikes of its compartments.
        busy: The core's work by which plans are compared (`Board.busy`); it is no modelled time.
    """

    messages_in: float
    operations_dense: float
    operations_sparse: float
    updates: float
    spikes: float
    messages_out: float
    busy: float


@dataclass(frozen=True)
class CorePlan:
    """The content of one core, and the storage of its synapses.

    Attributes:
        chip, core: Number of the chip and of its core, from 0.
        parts: Its neurons, in the order of its compartments: exc, the counters of these, inh (leaves, then the root),
            and inputs, which integrate a bias or relay injected spikes.
        dense_inputs: bool (inputs,): the row of this input is stored dense (every compartment of exc here, without
            indices); else sparse: the weights that are not 0. A row without weights is not stored.
        needs: The resources that the content needs.
        load: The expected load of the core in a step.
        microseconds: Its modelled time of a step, mean; None without `Plan.times`.
    """

    chip: int
    core: int
    parts: tuple[PopulationPart, ...]
    dense_inputs: NDArray[np.bool_] = field(repr=False)
    needs: Needs
    load: Load
    microseconds: float | None = None

    def part(self, population: PopulationName) -> PopulationPart:
        """The core's part of ``population``; its size is 0 if there is none."""
        return next((part for part in self.parts if part.population == population), PopulationPart(population, 0, 0, 0))


@dataclass(frozen=True)
class Times:
    """Modelled times of a network on a board that answers the network's own reference images.

    Attributes:
        asked, references: Number of images presented, evenly spread, and of all references.
        step_microseconds: Time of one step, mean.
        milliseconds: Time of a query.
    """

    asked: int
    references: int
    step_microseconds: Estimate
    milliseconds: Estimate

    def as_json(self) -> dict[str, Any]:
        """The times as scripts read them, by the names that `bench` uses."""
        times = {"step_microseconds": self.step_microseconds, "milliseconds": self.milliseconds}
        return {"activity": self.activity, **{name: value.as_json() for name, value in times.items()}}

    @property
    def activity(self) -> str:
        """Description of the images behind the times."""
        some = "" if self.asked == self.references else f"{self.asked} of "
        return f"{some}its {self.references} reference images, asked as queries"


@dataclass(frozen=True)
class Plan:
    """A network on a board.

    Attributes:
        network: The network.
        board: The board.
        cores: The cores in use, by chip and core.
        weight_bits, inhibition_bits: Bits of a stored weight of the inputs' and of the inhibitory root's synapses.
        hops: Expected tiles that messages between cores cross in one step; None: the mesh is not public.
        host_spikes: Spikes that the host sends to each chip in one step, mean plus six standard deviations; 0 if inputs
            integrate a bias.
        times: Modelled times; None: not computed, or the board's times are not public.
    """

    network: FixedNetwork = field(repr=False)
    board: Board = field(repr=False)
    cores: tuple[CorePlan, ...]
    weight_bits: int
    inhibition_bits: int
    hops: float | None
    host_spikes: float
    times: Times | None = None

    @property
    def embedded_tables(self) -> tuple[int, int]:
        """Bytes of tables and counts of ``programs/kapoho_bay/chip_program.py`` on the chip that needs most, and the
        same with ``--ways masks``: two places and a count a neuron, a place an input compartment, cores, and the input
        axons of injected spikes, as numbers or as bits."""
        network, found = self.network, []
        for chip in {core.chip for core in self.cores}:
            own = [core for core in self.cores if core.chip == chip]
            exc, inputs = ([core.part(name).size for core in own] for name in ("exc", "inputs"))
            exc_cores, input_cores = (sum(size > 0 for size in sizes) for sizes in (exc, inputs))
            targets = 0 if network.bias_input else input_cores if network.relayed else exc_cores
            sources = (4 * sum(inputs) + 2 * input_cores) * network.bias_input
            others = 12 * sum(exc) + sources + 2 * (exc_cores + targets)
            blocks = -(-network.inputs // 32)
            found.append((others + 2 * network.inputs * targets, others + 6 * blocks * targets))
        most, masks = zip(*found, strict=True)
        return max(most), max(masks)

    @property
    def single_bits(self) -> int:
        """Bits of the synapses of counters, inhibitory neurons and relays, with their sign: as few as hold them, but 8
        where weights take 8, so that a core has no narrower format."""
        return WEIGHT_BITS if self.weight_bits == WEIGHT_BITS else max(RELAY_WEIGHT, COUNTER_WEIGHT).bit_length() + 1
