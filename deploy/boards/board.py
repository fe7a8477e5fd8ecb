"""The boards that a network is deployed to, with their limits; None: not public."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Literal

from lava_vpr import loihi
from lava_vpr.deploy.boards.constants import LOIHI_1, CostConstants
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.rows.registry import Registry


@dataclass(frozen=True)
class Board:
    """What a board holds; every number of a core unless said.

    Attributes:
        name: The name that ``--target`` takes.
        title: The name for people.
        chips: Chips of the board.
        cores: Neuron cores of a chip.
        tile_cores, columns, rows: Cores of a tile, and the mesh of tiles of a chip; None: not public.
        input_limit: What one neuron can receive in one step stays below, in weight units.
        compartments, axons_in, axons_out, synapse_words: Limits.
        synapses, core_bytes: Synapses of a chip, and bytes of a core for all that it holds: what bounds a network where
            ``synapse_words`` are not public; else None.
        profiles, thresholds, formats: Distinct ones that a core can hold.
        weight_bits, index_bits: Widths that a stored synapse can have.
        one_sign: Whether weights that all have the same sign are stored without a bit for it.
        host_spikes: Spikes that the host can send to one chip in one step.
        input_mode: Where input spikes come from unless a user says otherwise; None: as the model says.
        counters: Whether each excitatory neuron has a compartment beside it that counts its spikes, and is read once
            a query; else the vendor's library reads spikes out.
        clearing: How states return to 0 between two queries: ``reset`` by Lava's LIFReset, or ``writes`` of the chips'
            embedded processors.
        constants: Energies and times of its operations; None: none are public.
    """

    name: str
    title: str
    chips: int
    cores: int
    tile_cores: int | None
    columns: int | None
    rows: int | None
    input_limit: int
    compartments: int
    axons_in: int | None
    axons_out: int | None
    synapse_words: int | None
    synapses: int | None
    core_bytes: int | None
    profiles: int | None
    thresholds: int | None
    formats: int | None
    weight_bits: tuple[int, ...]
    index_bits: tuple[int, ...]
    one_sign: bool
    host_spikes: int | None
    input_mode: Literal["injected", "bias"] | None
    counters: bool
    clearing: Literal["reset", "writes"]
    constants: CostConstants | None

    def stored_bits(self, network: FixedNetwork) -> int:
        """Bits that a stored weight of ``network`` needs: its magnitude's, and one for a sign."""
        return network.bits + (network.signed or not self.one_sign)

    @property
    def timed(self) -> bool:
        """Whether the times of the board's operations are public."""
        return self.constants is not None

    @property
    def usable_words(self) -> int | None:
        """Words of a core's synapse memory that a plan fills (`loihi.SYNAPSE_SLACK`); None: not public."""
        return None if self.synapse_words is None else int(self.synapse_words * (1 - loihi.SYNAPSE_SLACK))

    @property
    def known(self) -> str:
        """What is public of a board whose way of storing synapses is not, and what is not; else empty."""
        if self.synapses is None or self.core_bytes is None:
            return ""
        return (
            f"Public: {self.chips * self.cores} cores, {self.compartments:,} neurons and {self.core_bytes:,} bytes a "
            f"core, {self.synapses:,} synapses a chip. Unknown: what axons, indices and states take of these bytes."
        )

    def as_json(self) -> dict[str, Any]:
        """Limits and mesh by name, as a bundle's manifest has them; None: not public."""
        left_out = ("synapses", "core_bytes", "one_sign", "input_mode", "counters", "clearing", "constants")
        values = {item.name: getattr(self, item.name) for item in fields(self) if item.name not in left_out}
        return values | {"timed": self.timed}


BOARDS: Registry[Board] = Registry("board", BackendUnavailableError)
"""Every board by the name that ``--target`` takes."""

KAPOHO_BAY = BOARDS.register(
    Board(
        name="kapoho-bay",
        title="Kapoho Bay (two Loihi 1 chips)",
        chips=loihi.KAPOHO_BAY_CHIPS,
        cores=loihi.LOIHI_1_CORES,
        tile_cores=loihi.TILE_CORES,
        columns=loihi.MESH_COLUMNS,
        rows=loihi.MESH_ROWS,
        input_limit=loihi.LOIHI_1_INPUT_LIMIT,
        compartments=loihi.CORE_COMPARTMENTS,
        axons_in=loihi.CORE_AXONS,
        axons_out=loihi.CORE_AXONS,
        synapse_words=loihi.CORE_SYNAPSE_WORDS,
        synapses=None,
        core_bytes=None,
        profiles=loihi.CORE_PROFILES,
        thresholds=loihi.CORE_THRESHOLDS,
        formats=loihi.CORE_FORMATS,
        weight_bits=loihi.LOIHI_1_WEIGHT_BITS,
        index_bits=loihi.LOIHI_1_INDEX_BITS,
        one_sign=False,
        host_spikes=loihi.HOST_SPIKES,
        input_mode=None,
        counters=True,
        clearing="writes",
        constants=LOIHI_1,
    )
)

LOIHI_2 = BOARDS.register(
    Board(
        name="loihi2",
        title="Loihi 2",
        chips=1,
        cores=loihi.LOIHI_2_CORES,
        tile_cores=None,
        columns=None,
        rows=None,
        input_limit=loihi.INPUT_LIMIT,
        compartments=loihi.LOIHI_2_COMPARTMENTS,
        axons_in=None,
        axons_out=None,
        synapse_words=None,
        synapses=loihi.LOIHI_2_SYNAPSES,
        core_bytes=loihi.LOIHI_2_CORE_BYTES,
        profiles=None,
        thresholds=None,
        formats=None,
        weight_bits=tuple(range(1, 9)),
        index_bits=(),
        one_sign=True,
        host_spikes=None,
        input_mode="bias",
        counters=False,
        clearing="reset",
        constants=None,
    )
)
