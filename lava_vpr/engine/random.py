"""Counter-based random numbers: the same spikes on every backend, batch size, thread count and machine.

A presentation has a 64-bit key made of (seed, role, epoch, image). The image's key is a hash of its rates
(`image_keys`): an image gets the same noise at any position in a batch or traverse, in learning,
too. Block ``b`` of input ``j`` is one 64-bit hash
``mix(key + G (b 2^32 + j))``: the finaliser of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014, with Stafford's
constants, variant 13) over an injective counter. That one hash gives four 16-bit draws, for steps 4b .. 4b + 3, or two
32-bit draws, for steps 2b and 2b + 1. An input spikes when its draw is below its rate. Inputs of rate 0 need no draw.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.kernelcache import compiled

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_ZERO, _S27, _S30, _S31, _S32 = (np.uint64(x) for x in (0, 27, 30, 31, 32))
_MASK = (1 << 64) - 1

ROLES = ("train", "response", "query", "start", "delay", "calibration", "projection")


def _scrambled(x: Any) -> Any:
    """SplitMix64's finaliser, a bijection of 64-bit words, of one or of an array."""
    x = (x ^ (x >> _S30)) * _MIX_1
    x = (x ^ (x >> _S27)) * _MIX_2
    return x ^ (x >> _S31)


mix = compiled(inline="always")(_scrambled)


def _mix(x: int) -> int:
    """The value of `mix`, computed in Python integers."""
    x = ((x ^ (x >> 30)) * int(_MIX_1)) & _MASK
    x = ((x ^ (x >> 27)) * int(_MIX_2)) & _MASK
    return x ^ (x >> 31)


@compiled(nogil=True)
def image_keys(rates: NDArray[Any]) -> NDArray[np.uint64]:
    """The key of each image, computed from its rates only, uint64 (n,).

    It is the sum modulo 2^64 of ``mix(G (j 2^32 + rate_j))`` over all inputs ``j`` with a rate above 0.

    Args:
        rates: uint16 or uint32 (n, inputs).
    """
    keys = np.zeros(rates.shape[0], np.uint64)
    for i in range(rates.shape[0]):
        for j in range(rates.shape[1]):
            rate = np.uint64(rates[i, j])
            word = mix(GOLDEN * ((np.uint64(j) << _S32) + rate))
            keys[i] += word if rate > _ZERO else _ZERO  # both computed: no branch to mispredict
    return keys


def stretch_key(images: NDArray[np.uint64]) -> int:
    """The key of a stretch, made of the keys of its images (`image_keys`): their sum modulo 2^64, in any order."""
    return int(images.sum(dtype=np.uint64))


def presentation_key(seed: int, role: str, image: int, epoch: int = 0) -> int:
    """The 64-bit key of one presentation.

    Args:
        seed: Seed of the run, in [0, 2^63).
        role: One of `ROLES`; ``train`` (with its epoch), ``response`` (the frozen network on the references) and
            ``query`` keep their noise apart.
        image: The image's key (`image_keys`); for ``start``, that of a stretch (`stretch_key`); of a
            ``projection`` of vectors 0; of any size.
        epoch: Epoch of a training presentation.
    """
    return _next_key(_key_before(seed, role, epoch), image)


def _next_key(key: int, word: int) -> int:
    """``key`` with another word hashed in."""
    return _mix((key ^ (word & _MASK)) + int(GOLDEN) & _MASK)


def _key_before(seed: int, role: str, epoch: int) -> int:
    """The key of a presentation before its image is hashed in."""
    if role not in ROLES:
        raise ValueError(f"role is {role!r}, but must be one of {', '.join(ROLES)}")
    return _next_key(_next_key(_mix((seed + int(GOLDEN)) & _MASK), zlib.crc32(role.encode())), epoch)


def derived_key(key: int, purpose: str) -> int:
    """The key of another kind of random numbers of the same presentation, named by its ``purpose``."""
    return _mix((key ^ zlib.crc32(purpose.encode())) + int(GOLDEN) & _MASK)


def presentation_keys(seed: int, role: str, images: NDArray[Any], epoch: int = 0) -> NDArray[np.uint64]:
    """`presentation_key` of many images, uint64 (n,)."""
    start = np.uint64(_key_before(seed, role, epoch))
    return np.asarray(_scrambled((start ^ images.astype(np.uint64)) + GOLDEN))


def hashes(key: int, blocks: NDArray[np.int64], inputs: NDArray[np.int64]) -> NDArray[np.uint64]:
    """The 64-bit hashes of all (block, input) pairs, shape (len(blocks), len(inputs)); plain numpy."""
    counter = (blocks.astype(np.uint64)[:, None] << _S32) + inputs.astype(np.uint64)[None, :]
    return np.asarray(_scrambled(np.uint64(key) + counter * GOLDEN))


def draws(key: int, steps: int, inputs: int, bits: int = 16) -> NDArray[np.uint64]:
    """All draws of one presentation, shape (steps, inputs), each of ``bits`` (16 or 32) bits; plain numpy.

    The definition that tests compare the compiled kernels with.
    """
    per_hash = 64 // bits
    blocks = np.arange(-(-steps // per_hash))
    words = hashes(key, blocks, np.arange(inputs))
    shifts = (np.arange(per_hash) * bits).astype(np.uint64)
    lanes = (words[:, None, :] >> shifts[None, :, None]) & np.uint64((1 << bits) - 1)
    return lanes.reshape(-1, inputs)[:steps]


def uniform(key: int, size: int) -> NDArray[np.float64]:
    """``size`` uniform numbers in [0, 1) with 53 bits, one hash each (start weights, delays)."""
    words = hashes(key, np.zeros(1, dtype=np.int64), np.arange(size))[0]
    return (words >> np.uint64(11)).astype(np.float64) * 2.0**-53
