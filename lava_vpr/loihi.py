"""Loihi's numbers, each with its unit. Nothing else in the project writes one down.

Their public sources, or that they are unproven, stand in docs/hardware.md, whose rows are those of
`lava_vpr.deploy.hardware`.
"""

from __future__ import annotations

STATE_BITS = 24
"""Current u and voltage v: 23 bits and sign."""

STATE_LIMIT = 1 << (STATE_BITS - 1)
"""u wraps beyond +-2^23, v is clipped to +-(2^23 - 1)."""

INPUT_SHIFT = 6
"""Inputs and thresholds are 2^6 units of u and v."""

INPUT_LIMIT = STATE_LIMIT >> INPUT_SHIFT
"""Input sums of one step beyond this (131,072 weight units) wrap u."""

LOIHI_1_INPUT_LIMIT = 1 << 15
"""The limit of a neuron's input sum on Loihi 1, whose accumulator has 21 bits and sign in units shifted by 6."""

THRESHOLD_LIMIT = 1 << 17
"""Threshold mantissas stay below."""

DECAY_BITS = 12
"""Decays are in units of 2^-12."""

DECAY_UNITY = 1 << DECAY_BITS
"""The decay of 1, which leaves nothing: 4096 units of 2^-12."""

NO_MEMORY_DECAY = DECAY_UNITY - 1
"""Value of a decay register with which a current has no memory."""

WEIGHT_BITS = 8
"""Widest weight."""

WEIGHT_LIMIT = (1 << WEIGHT_BITS) - 1
"""Largest unsigned weight (or mantissa of an inhibitory one)."""

SIGNED_WEIGHT_LIMIT = WEIGHT_LIMIT >> 1
"""Largest magnitude of a weight that is stored in `WEIGHT_BITS` bits, one of which is its sign."""

WEIGHT_EXPONENT_LIMIT = 7
"""Exponents of synapses and biases are -7..7."""

BIAS_BITS = 12
"""Bits of a bias mantissa, besides its sign."""

BIAS_EXPONENT_LIMIT = 7
"""A bias is mantissa 2^exponent, exponent 0..7."""

TRACE_LIMIT = (1 << 7) - 1
"""Largest trace: 7 bits."""

PRODUCT_MANTISSAS = range(-8, 8)
"""Scale S of a product S 2^E of a learning rule: 4 bits."""

PRODUCT_EXPONENTS = range(-7, 9)
"""The exponent E of a learning rule's product."""

CORE_COMPARTMENTS = 1024
"""Compartments of a Loihi 1 core."""

CORE_AXONS = 4096
"""Input axons of a Loihi 1 core, and as many output axons."""

WORD_BITS = 64
"""Width of a word of synapse memory."""

CORE_SYNAPSE_WORDS = 16_384
"""Words of synapse memory of a Loihi 1 core: 1,048,576 bits."""

SYNAPSE_SLACK = 0.05
"""Share of a core's synapse memory that a plan leaves free. Unproven: no public source says that any is needed
(nengo-loihi 1.1.0, ``builder/validate.py:52``, allows all words); nobody has published a core filled to the last."""

BLOCK_SYNAPSES = 64
"""An axon's synapses are stored in blocks of at most so many, each rounded up to whole words."""

BLOCK_HEADER_BITS = 10
"""Before the synapses of a block: 4 bits synapse format, 6 bits number of synapses."""

LOIHI_1_WEIGHT_BITS = (1, 2, 3, 4, 5, 6, 8)
"""Bits of a stored weight."""

LOIHI_1_INDEX_BITS = (6, 7, 8, 9, 10, 11, 12)
"""Bits of a compartment's number in a sparse synapse; dense ones have none."""

CORE_PROFILES, CORE_THRESHOLDS, CORE_FORMATS = 32, 8, 16
"""Distinct pairs of decays, thresholds and synapse formats of a Loihi 1 core."""

FLOOR_EXPONENT_LIMIT, CEILING_EXPONENT_LIMIT = 23, 7
"""v stays within -2^k + 1, k <= 23, and 2^(9 + 2k) - 1, k <= 7; both for a whole core."""

CEILING_EXPONENT_OFFSET, CEILING_EXPONENT_STEP = 9, 2
"""The exponent 9 + 2k of the ceiling of v."""

LEAST_REFRACTORY_STEPS, MOST_REFRACTORY_STEPS = 1, 63
"""Values of register refractDelay, which counts the step of the spike: 1 is no refractoriness."""

UPDATE_GROUP = 4
"""Compartments that are updated together; register numUpdates counts groups."""

FANOUT_MIXED = 1
"""The value of a synapse format's register fanoutType with which one of a weight's bits is its sign."""

COMPRESSION_SPARSE, COMPRESSION_DENSE = 0, 3
"""Values of its register compression."""

PACKET_WORDS, PACKET_HEADER_WORDS = 64, 8
"""Words of 32 bits of a packet between host and embedded processor, and those of them that say what it is."""

HOST_SPIKES = PACKET_WORDS - PACKET_HEADER_WORDS
"""Spikes that the host sends to one chip in one step: those of a packet, a word each. No source has a limit of
the chip."""

KAPOHO_BAY_CHIPS, LOIHI_1_CORES = 2, 128
"""Kapoho Bay: two chips of 128 cores."""

TILE_CORES, MESH_COLUMNS, MESH_ROWS = 4, 8, 4
"""Cores of a tile, and the mesh of tiles of a Loihi 1 chip; tile t is at column t // 4, row t % 4."""

LOIHI_2_COMPARTMENTS, LOIHI_2_CORES = 8192, 128
"""Neurons of a Loihi 2 core and its cores, at most."""

LOIHI_2_SYNAPSES, LOIHI_2_CORE_BYTES = 120_000_000, 192 * 1024
"""Synapses of a Loihi 2 chip and bytes of memory of a core, for everything on it, at most."""

LOIHI_2_RESET_LIMIT = 1 << 16
"""The longest interval between two resets of a LIFReset; each is a power of two. Unproven: no text has a limit."""


def reset_interval(steps: int) -> int:
    """The shortest interval, in steps, at which a Loihi 2 chip resets and which is not shorter than ``steps``."""
    return 1 << max(0, steps - 1).bit_length()


AXON_IN_NS, SYNAPSE_DENSE_NS, SYNAPSE_SPARSE_NS, ACCESS_NS, UPDATE_NS, SPIKE_NS, MESSAGE_NS = (
    16,
    3.8,
    4.7,
    6.0,
    3.7,
    30,
    5.1,
)
"""Time on a Loihi 1 core, in ns: of a message received, a synaptic operation (dense or sparse row), a neuron's access
and its update, a spike out, and a message sent."""

SYNAPSE_DENSE_PJ, SYNAPSE_SPARSE_PJ, ACCESS_PJ, UPDATE_PJ, SPIKE_PJ, MESSAGE_PJ = 35.5, 33.6, 51.2, 21.6, 69.3, 111.0
"""Energy on a Loihi 1 core, in pJ: of a synaptic operation (dense or sparse row), a neuron's access and its update, a
spike out, and a message sent; a message received takes none."""

HOP_EAST_WEST_PJ, HOP_NORTH_SOUTH_PJ = 3.0, 4.2
"""Energy of a message that crosses a tile, in pJ."""

BARRIER_US = {1: 0.6, 2: 1.0, 4: 1.4, 29: 1.8}
"""Time of the barrier at the end of a step, in us, by tiles in use: the entry of the largest number that is not above
it."""

DAVIES_SYNAPSE_PJ, DAVIES_ACTIVE_PJ, DAVIES_INACTIVE_PJ, DAVIES_WITHIN_TILE_PJ = 23.6, 81.0, 52.0, 1.7
DAVIES_HOP_EAST_WEST_PJ, DAVIES_HOP_NORTH_SOUTH_PJ = 3.0, 4.0
"""Energy of a synaptic operation (at least), a neuron's update (active, inactive), a spike within a tile, and a tile
crossed, in pJ."""

DAVIES_SYNAPSE_NS, DAVIES_ACTIVE_NS, DAVIES_INACTIVE_NS = 3.5, 8.4, 5.3
"""Times of those events, in ns."""

DAVIES_BARRIER_US = {1: 0.113, 32: 0.465}
"""Time of the barrier with 1 and with 32 tiles, in us."""

CHIP_MILLIWATTS, EMBEDDED_MILLIWATTS, IDLE_MILLIWATTS = 104.0, 65.0, 29.0
"""Power of a Loihi 1 chip that does nothing: its cores and mesh, and its embedded x86 processors (Frady et al., NICE
2020, doi 10.1145/3381755.3398695: 3.34 W and 65 mW a chip for 32 chips); and what another board drew idle, all of it
(Blouw et al., NICE 2019, arXiv 1812.01739)."""

POHOIKI_STEP_US = 5.8
"""Shortest step measured on 32 chips, in us."""

KAPOHO_BAY_MESSAGE_US = 13.9
"""A message between host and Kapoho Bay over USB, in us."""

EMBEDDED_MHZ, REGISTER_CYCLES, WORD_CYCLES = (400.0, 200.0, 100.0), (10, 20, 40), (2, 4, 8)
"""An embedded processor's clock, its cycles for a register of a core and for a word of its own memory: low, nominal and
high. Unproven, all of it: an in-order x86 core that waits for the mesh; no figure is public."""

HOST_MILLIWATTS = (5_000.0, 10_000.0, 20_000.0)
"""Power of a robot's computer while one thread of it works, low, nominal and high: an assumption."""
