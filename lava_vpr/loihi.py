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

TRACE_LIMIT = (1 << 7) - 1
"""Largest trace: 7 bits. Source: lava-nc 0.10, ``magma/core/learning``; nengo-loihi 1.1.0, ``discretize.py:23``."""

PRODUCT_MANTISSAS = range(-8, 8)
"""Scale S of a product S 2^E of a learning rule: 4 bits. Source: lava-nc 0.10, ``magma/core/learning``."""

PRODUCT_EXPONENTS = range(-7, 9)
"""Its exponent E. Source: as `PRODUCT_MANTISSAS`."""
