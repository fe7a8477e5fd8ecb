"""Loihi's numbers, each with unit and source. Nothing else in the project writes one down."""

from __future__ import annotations

STATE_BITS = 24
"""Current u and voltage v: 23 bits and sign. Source: lava-nc 0.10, ``AbstractPyLifModelFixed.ds_offset`` and following;
nengo-loihi 1.1.0, ``discretize.py:19``."""

STATE_LIMIT = 1 << (STATE_BITS - 1)
"""u wraps beyond +-2^23, v is clipped to +-(2^23 - 1)."""

INPUT_SHIFT = 6
"""Inputs and thresholds are 2^6 units of u and v. Source: lava-nc 0.10, ``proc/lif/models.py``."""

INPUT_LIMIT = STATE_LIMIT >> INPUT_SHIFT
"""Input sums of one step beyond this (131,072 weight units) wrap u."""

LOIHI_1_INPUT_LIMIT = 1 << 15
"""The same on Loihi 1, whose accumulator has 21 bits and sign in units shifted by 6. Source: nengo-loihi 1.1.0,
``discretize.py:21``, and its emulator's overflow flag; not verified on silicon."""

THRESHOLD_LIMIT = 1 << 17
"""Threshold mantissas stay below. Source: nengo-loihi 1.1.0, ``discretize.py:10``."""

DECAY_BITS = 12
"""Decays are in units of 2^-12. Source: lava-nc 0.10, ``proc/lif/models.py``."""

WEIGHT_BITS = 8
"""Widest weight. Source: lava-nc 0.10, ``proc/dense/models.py``."""

WEIGHT_LIMIT = (1 << WEIGHT_BITS) - 1
"""Largest unsigned weight (or mantissa of an inhibitory one)."""

WEIGHT_EXPONENT_LIMIT = 7
"""Exponents of synapses and biases are -7..7. Source: nengo-loihi 1.1.0, ``builder/validate.py:103``."""

BIAS_BITS = 12
"""Bits of a bias mantissa, besides its sign. Source: nengo-loihi 1.1.0, ``discretize.py:14``."""

BIAS_EXPONENT_LIMIT = 7
"""A bias is mantissa 2^exponent, exponent 0..7. Source: as `BIAS_BITS`."""

TRACE_LIMIT = (1 << 7) - 1
"""Largest trace: 7 bits. Source: lava-nc 0.10, ``magma/core/learning``; nengo-loihi 1.1.0, ``discretize.py:23``."""

PRODUCT_MANTISSAS = range(-8, 8)
"""Scale S of a product S 2^E of a learning rule: 4 bits. Source: lava-nc 0.10, ``magma/core/learning``."""

PRODUCT_EXPONENTS = range(-7, 9)
"""Its exponent E. Source: as `PRODUCT_MANTISSAS`."""

CORE_COMPARTMENTS = 1024
"""Compartments of a Loihi 1 core. Source: nengo-loihi 1.1.0, ``block.py:8``."""

CORE_AXONS = 4096
"""Input axons of a Loihi 1 core, and as many output axons. Source: nengo-loihi 1.1.0, ``block.py:9``."""

WORD_BITS = 64
"""Width of a word of synapse memory. Source: nengo-loihi 1.1.0, ``block.py:11``."""

CORE_SYNAPSE_WORDS = 16_384
"""Words of synapse memory of a Loihi 1 core: 1,048,576 bits. Source: as `WORD_BITS`."""

BLOCK_SYNAPSES = 64
"""An axon's synapses are stored in blocks of at most so many, each rounded up to whole words. Source:
nengo-loihi 1.1.0, ``block.py:527``."""

BLOCK_HEADER_BITS = 10
"""Before the synapses of a block: 4 bits synapse format, 6 bits number of synapses. Source: as `BLOCK_SYNAPSES`."""

LOIHI_1_WEIGHT_BITS = (1, 2, 3, 4, 5, 6, 8)
"""Bits of a stored weight. Source: nengo-loihi 1.1.0, ``block.py:428``."""

LOIHI_1_INDEX_BITS = (6, 7, 8, 9, 10, 11, 12)
"""Bits of a compartment's number in a sparse synapse; dense ones have none. Source: nengo-loihi 1.1.0,
``block.py:427``."""

CORE_PROFILES, CORE_THRESHOLDS, CORE_FORMATS = 32, 8, 16
"""Distinct pairs of decays, thresholds and synapse formats of a Loihi 1 core. Source: nengo-loihi 1.1.0,
``hardware/validate.py:19`` and ``hardware/nxsdk_objects.py:5`` (thresholds: 16 on the chip, 8 at build)."""

FLOOR_EXPONENT_LIMIT, CEILING_EXPONENT_LIMIT = 23, 7
"""v stays within -2^k + 1, k <= 23, and 2^(9 + 2k) - 1, k <= 7; both for a whole core. Source: nengo-loihi 1.1.0,
``discretize.py:369`` and ``hardware/builder.py:245``."""

HOST_SPIKES = 50
"""Spikes that the host sends to one chip in one step. Source: nengo-loihi 1.1.0, ``hardware/interface.py:71``."""

KAPOHO_BAY_CHIPS, LOIHI_1_CORES = 2, 128
"""Kapoho Bay: two chips of 128 cores. Source: Davies et al., IEEE Micro 2018 (cores), and Intel's description."""

TILE_CORES, MESH_COLUMNS, MESH_ROWS = 4, 8, 4
"""Cores of a tile, and the mesh of tiles of a Loihi 1 chip; tile t is at column t // 4, row t % 4. Source: SANA-FE
2.2.9, ``arch/loihi.yaml``."""

LOIHI_2_COMPARTMENTS, LOIHI_2_CORES = 8192, 120
"""Neurons of a Loihi 2 core and its cores. Source: Intel, Loihi 2 technology brief, 2021 (about 8,000; 120 to 128)."""

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
and its update, a spike out, and a message sent. Source: SANA-FE 2.2.9, ``arch/loihi.yaml`` (fitted to silicon)."""
