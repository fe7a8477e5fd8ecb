"""Images whose width speaks against the length of what is stored are refused, though their decoders take them."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest
from support.common.imagefiles import image_bytes, smooth_picture

from lava_vpr.images.formats import walk
from lava_vpr.images.windows import DamagedError

_BIG = smooth_picture(1, (90, 120, 3))


def test_a_bmp_of_another_width_than_its_length_says_is_refused() -> None:
    data = bytearray(image_bytes(".bmp", _BIG))
    data[18] -= 7
    with pytest.raises(DamagedError, match=r"its rows end .* bytes before it does"):
        walk(bytes(data))


@pytest.mark.parametrize("wrong", [-1, 1, 1 << 15])
@pytest.mark.parametrize("packing", [5, 8])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_a_packed_tiff_of_another_width_than_its_strips_is_refused(kind: type, packing: int, wrong: int) -> None:
    data = bytearray(image_bytes(".tif", _BIG.astype(kind), cv2.IMWRITE_TIFF_COMPRESSION, packing))
    walk(bytes(data))
    (first,) = struct.unpack_from("<I", data, 4)
    entry = next(at for at in range(first + 2, len(data), 12) if data[at : at + 2] == b"\0\1")
    struct.pack_into("<H", data, entry + 8, _BIG.shape[1] + wrong)
    with pytest.raises(DamagedError, match=r"a strip of \d+ rows of [\d,]+ bytes unpacks to "):
        walk(bytes(data))
