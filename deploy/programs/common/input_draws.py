"""Input spikes of a presentation: as lava_vpr.encoding and lava_vpr.engine.inference.biases define them."""

import zlib

import numpy as np

GOLDEN, MIX_1, MIX_2 = (np.uint64(x) for x in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))


def mixed(words: np.ndarray) -> np.ndarray:
    """SplitMix64's finaliser."""
    words = (words ^ (words >> np.uint64(30))) * MIX_1
    words = (words ^ (words >> np.uint64(27))) * MIX_2
    return words ^ (words >> np.uint64(31))


def draw_spikes(rates: np.ndarray, key: int, steps: int) -> np.ndarray:
    """Poisson spikes of one presentation, bool (steps, inputs): 16-bit draws below the rate, four of each hash."""
    blocks, inputs = np.arange(-(-steps // 4), dtype=np.uint64), np.arange(len(rates), dtype=np.uint64)
    with np.errstate(over="ignore"):
        words = mixed(np.uint64(key) + ((blocks[:, None] << np.uint64(32)) + inputs) * GOLDEN)
    lanes = np.arange(4, dtype=np.uint64)[None, :, None] * np.uint64(16)
    draws = (words[:, None, :] >> lanes) & np.uint64(0xFFFF)
    return np.asarray(draws.reshape(-1, len(rates))[:steps] < rates)


def biases(rates: np.ndarray, level: int) -> tuple:
    """Mantissas (12 bits) and exponents (0..7), int32, that let inputs spike regularly; ``level``: their threshold."""
    r = rates.astype(np.int64)
    wanted = np.minimum(2 * r * level // ((1 << 17) - r), 4095 << 7)
    exponent = sum(((wanted >> (12 + e)) > 0).astype(np.int64) for e in range(7))
    return (wanted >> exponent).astype(np.int32), np.asarray(exponent, np.int32)


def phases(key: int, inputs: int, level: int) -> np.ndarray:
    """Membranes of the inputs before a presentation, int32 (inputs,)."""
    with np.errstate(over="ignore"):
        own = mixed(np.array([np.uint64(key) ^ np.uint64(zlib.crc32(b"phase"))]) + GOLDEN)
        words = mixed(own + np.arange(inputs, dtype=np.uint64) * GOLDEN)
    return ((words >> np.uint64(32)) * np.uint64(level) >> np.uint64(32)).astype(np.int32)


def regular_spikes(rates: np.ndarray, key: int, steps: int, level: int) -> np.ndarray:
    """The spikes of inputs that integrate a bias, bool (steps, inputs): those above ``level`` spike and start again."""
    (mantissa, exponent), membrane = biases(rates, level), phases(key, len(rates), level)
    bias, spikes = mantissa << exponent, np.zeros((steps, len(rates)), bool)
    for step in range(steps):
        membrane = membrane + bias
        spikes[step] = membrane > level
        membrane[spikes[step]] = 0
    return spikes
