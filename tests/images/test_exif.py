"""What photos say of where and when they were taken, against blocks that Pillow writes."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from PIL import Image
from support.common.imagefiles import (
    QUICK,
    exif,
    image_bytes,
    photo,
    refused,
    smooth_picture,
    tiff,
    webp_with_exif,
    written,
)

from lava_vpr.images.exif import Taken, _position, _time, taken

NOON = 1714564800.0  # 2024-05-01T12:00:00Z
OSLO = {1: "N", 2: (59, 54, Fraction(495, 10)), 3: "E", 4: (10, 45, 9)}
SYDNEY = {1: "S", 2: (33.0, Fraction(5136, 100), 0), 3: "W", 4: (151, 12, Fraction(3, 4))}


@pytest.mark.parametrize(
    ("receiver", "where"),
    [
        (OSLO, (59 + 54 / 60 + 49.5 / 3600, 10 + 45 / 60 + 9 / 3600)),
        (SYDNEY, (-33 - 51.36 / 60, -151 - 12 / 60 - 0.75 / 3600)),
        ({**OSLO, 9: "A"}, (59.913750, 10.7525)),
        ({**OSLO, 9: "V"}, None),  # the receiver had no fix
        ({**OSLO, 2: (0, 0, 0), 4: (0, 0, 0)}, None),
        ({**OSLO, 2: (91, 0, 0)}, None),
        ({**OSLO, 4: (180, 0, 1)}, None),
        ({key: OSLO[key] for key in (1, 2, 3)}, None),
        ({key: OSLO[key] for key in (2, 3, 4)}, None),
        ({}, None),
    ],
)
def test_where(receiver: dict[int, Any], where: tuple[float, float] | None, tmp_path: Path) -> None:
    found = taken(photo(tmp_path / "a.jpg", smooth_picture(), receiver)).where
    assert found == (None if where is None else pytest.approx(where, abs=1e-9))


@pytest.mark.parametrize(
    ("camera", "when", "zoned"),
    [
        ({36867: "2024:05:01 12:00:00"}, NOON, False),
        ({36867: "2024:05:01 12:00:00", 37521: "25"}, NOON + 0.25, False),
        ({36867: "2024:05:01 12:00:00", 36881: "+02:00"}, NOON - 7200, True),
        ({36867: "2024:05:01 12:00:00", 36881: "-09:30", 37521: "007"}, NOON + 34200.007, True),
        ({36867: "2024:05:01 12:00:00", 36881: "   :  "}, NOON, False),
        ({36867: "    :  :     :  :  "}, None, False),
        ({36867: "0000:00:00 00:00:00", 36881: "+02:00"}, None, False),
        ({37521: "25"}, None, False),
    ],
)
def test_when(camera: dict[int, Any], when: float | None, zoned: bool, tmp_path: Path) -> None:
    found = taken(photo(tmp_path / "a.jpg", smooth_picture(), {}, camera))
    assert found == Taken(None, None if when is None else pytest.approx(when, abs=1e-6), zoned)


def test_all_formats_that_have_a_block_are_read(tmp_path: Path) -> None:
    picture, plain = smooth_picture(), Taken(None, None, False)
    block = photo(tmp_path / "a.jpg", picture, OSLO).read_bytes()
    for suffix in (".png", ".webp"):
        assert taken(photo(tmp_path / f"a{suffix}", picture, OSLO)).where == pytest.approx((59.91375, 10.7525))
    assert block.count(b"Exif") == 1
    written(tmp_path / "b.webp", webp_with_exif(picture, exif(6)))
    assert taken(tmp_path / "b.webp") == plain  # nothing but an orientation
    assert taken(written(tmp_path / "b.png", image_bytes(".png", picture))) == plain
    assert taken(written(tmp_path / "b.bmp", image_bytes(".bmp", picture))) == plain
    assert taken(written(tmp_path / "b.tif", tiff(picture[:, :, 0].tobytes(), picture.shape, {}))) == plain
    refused(lambda: taken(tmp_path / "none.jpg"), "none.jpg: cannot be read (No such file or directory)")
    refused(lambda: taken(written(tmp_path / "cut.jpg", block[: len(block) // 2])), "cut.jpg: cannot be read (")


@QUICK
@given(st.binary(max_size=120), st.sampled_from([b"", b"MM\0*\0\0\0\x08", b"II*\0\x08\0\0\0"]), st.integers(0, 99))
def test_any_block_says_something_or_nothing(block: bytes, start: bytes, at: int) -> None:
    where = _position(start + block, at)
    assert where is None or (abs(where[0]) <= 90 and abs(where[1]) <= 180)
    when, zoned = _time(start + block, at)
    assert when is not None or not zoned


def test_a_photo_is_what_pillow_reads_of_it(tmp_path: Path) -> None:
    path = photo(tmp_path / "a.jpg", smooth_picture(), OSLO)
    with Image.open(path) as image:
        parts = image.getexif().get_ifd(0x8825)
    assert taken(path).where == pytest.approx(
        tuple(float(np.dot([float(x) for x in parts[tag]], [1, 1 / 60, 1 / 3600])) for tag in (2, 4))
    )
