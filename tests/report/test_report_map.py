"""The report's map, and the page on a phone."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.browser import PHONE, on_phone
from support.common.reports import ALONG, BEND, WORDS, WRONG, example

from lava_vpr.report.data import MapData, ReportData
from lava_vpr.report.html import page


def mapped(places: NDArray[np.float64] = BEND, queries: NDArray[np.float64] = BEND + 6.0) -> ReportData:
    """The example on a road that bends, its queries a few metres from their places."""
    return example(12, map=MapData(places, queries, "median 8.5 m, & no more"), **WORDS)


def test_the_map_leads_each_query_to_its_match() -> None:
    drawn = re.search(r'<section id="map">.*?</section>', page(mapped()), re.DOTALL)
    assert drawn is not None
    lines = {
        name: re.findall(r"<path[^>]*d=\"M ([-\d.]+) ([-\d.]+) \nL ([-\d.]+) ([-\d.]+)", part)
        for name, part in re.findall(r'<g id="map-error-(\w+)">(.*?)</g>', drawn[0], re.DOTALL)
    }
    assert {name: len(found) for name, found in lines.items()} == {"right": 10, "wrong": 1}
    (ends,) = np.array(lines["wrong"], float).reshape(-1, 2, 2)
    starts = np.array(lines["right"], float).reshape(-1, 2, 2)
    assert np.ptp(starts, axis=1).max() < 3  # six metres of three kilometres
    scale = (starts[-1, 1, 0] - starts[0, 1, 0]) / 3000  # from the first to the last place
    wanted = 3000 * (ALONG[2] - ALONG[WRONG]) - 6
    assert (ends[1, 0] - ends[0, 0]) / scale == pytest.approx(wanted, abs=2)
    assert "Median 8.5 m, &amp; no more." in drawn[0]
    assert 'href="#map"' in page(mapped())
    assert 'href="#map"' not in page(example(**WORDS))


def test_a_map_of_equal_positions_or_of_a_jump_is_drawn() -> None:
    nowhere = np.zeros((12, 2))
    assert '<section id="map">' in page(mapped(nowhere, nowhere))
    jump = np.stack([np.r_[np.arange(6.0), 9000 + np.arange(6.0)], np.zeros(12)], axis=1)
    text = page(mapped(jump, jump))
    route = re.search(r'<section id="map">.*?<g id="map-LineCollection_1">(.*?)</g>', text, re.DOTALL)
    assert route is not None
    assert route[1].count("<path") == 10  # of 11 steps, all but the jump


def test_on_a_phone_nothing_sticks_out_and_words_can_be_read(tmp_path: Path) -> None:
    seen = on_phone(page(mapped()), tmp_path)
    assert seen.wide <= PHONE
    assert (seen.smallest or 0) >= 7
