"""The page of `lava-vpr bench`, from made-up results."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from support.common.bench_results import bench, metrics, probabilities
from support.common.browser import PHONE, on_phone, visit

from lava_vpr.bench.anchors import ANCHORS
from lava_vpr.bench.results import (
    Measured,
    SweepPoint,
)
from lava_vpr.bench.show import plots, tables as described
from lava_vpr.bench.show.json_values import as_json
from lava_vpr.bench.show.page import page
from lava_vpr.deploy.boards.constants import Estimate
from lava_vpr.show.page import write_page
from lava_vpr.show.table import in_html


@pytest.fixture(scope="module")
def text() -> str:
    return page(bench())


def test_equal_results_give_equal_bytes_and_nothing_comes_from_outside(text: str) -> None:
    assert page(bench()) == text
    assert "<script" not in text
    assert "default-src 'none'" in text
    assert not re.search(r"(?:src|href)=\"(?!data:|#)", text)
    assert "http:" not in text
    assert "https:" not in text


def test_what_comes_from_outside_is_text() -> None:
    evil = "<script>alert(1)</script>&\"'"
    found = bench(command=evil, machine={evil: evil}, model={**bench().model, "decoder": evil})
    timed = tuple(replace(one, milliseconds=()) for one in found.measured)
    found = replace(found, measured=(Measured(evil, evil, absent=evil), *timed), sweep=(), step_times={})
    text = page(found)
    assert "<script" not in text
    assert "alert(1)" in text
    assert "Every message pays for its own &lt;packet&gt;." in text


def test_constants_are_listed_with_their_sources(text: str) -> None:
    found = as_json(bench())["constants"]["synapse_dense"]
    assert found["what"] == "synaptic operation of a dense row"
    assert "SANA-FE" in found["source"]
    assert all(in_html(found[name]) in text for name in ("what", "source"))


def test_ids_are_unique_and_links_lead_somewhere(text: str) -> None:
    ids = re.findall(r'\sid="([^"]+)"', text)
    assert len(ids) == len(set(ids))
    for target in re.findall(r'href="#([^"]+)"', text):
        assert target in ids, target


def test_few_times_and_odd_ones_can_be_drawn() -> None:
    few = [Measured("one", "", milliseconds=(0.5,)), Measured("same", "", milliseconds=(2.0, 2.0))]
    assert "p99" in plots.latencies(few, "")
    point = SweepPoint({"steps": 1}, metrics(), 1.0, 1.0, 1.0, 9.0, front=True, chosen="fast")
    drawing = plots.pareto([point], "")
    assert all(
        text in drawing for text in ("modelled energy on the board, µJ", "modelled time on the chip, ms", ">fast<")
    )
    assert "all components" in plots.energy({"nothing": Estimate(0, 0, 0)}, "z", "")


def test_a_browser_shows_it(text: str, tmp_path: Path) -> None:
    file = write_page(text, tmp_path / "deep" / "bench.html")
    seen = visit(file)
    assert seen.console == ()
    assert seen.dom.count("<svg") >= 5


def test_a_map_and_thresholds_stand_where_they_are_known() -> None:
    text = page(bench())
    assert '<section id="map">' in text
    assert "Metres of error: median" in text
    assert len(re.findall(r'id="map-query-(?:right|wrong)', text)) == 2
    assert '<section id="trust">' in text
    values = as_json(bench())
    assert values["position_error"]["matched"] == 10
    assert values["position_error"]["within"] == 0.8
    assert values["probability"]["single"] == probabilities().as_json()
    row = next(row for row in described.thresholds(bench()).rows if row[0] == "95.0")
    assert row[2:4] == ("10.0", "100.0")
    without = bench(trust={}, on_map=None)
    assert as_json(without)["position_error"] is None
    assert not re.search(r'<section id="(map|trust)">', page(without))
    assert described.thresholds(without).rows == ()


@pytest.mark.slow
def test_on_a_phone_nothing_sticks_out_and_words_can_be_read(tmp_path: Path) -> None:
    seen = on_phone(page(bench()), tmp_path)
    assert seen.wide <= PHONE
    assert seen.smallest >= 7


def test_anchors_cite_and_say_what_they_are(text: str) -> None:
    assert len({one.name for one in ANCHORS}) == len(ANCHORS)
    for one in ANCHORS:
        assert re.fullmatch(r"10\.\d{4,5}/\S+", one.doi), one.name
        assert one.task
        assert one.board
        assert one.kind in ("measured", "hoped for")
    assert all(one.doi in text for one in ANCHORS)
    assert "Not measured" not in text
    by_name = {one.name: one for one in ANCHORS}
    assert (by_name["Renner 2024"].microjoules, by_name["Renner 2024"].milliseconds) == (2.5, 0.17)
    assert by_name["Frady 2020"].microjoules is None
