"""The page and the JSON of `lava-vpr bench`, and what it prints, from made-up results."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.common.bench_results import FIGURES, bench, metrics, modelled, printed, probabilities, ways
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
from lava_vpr.matching.evaluation import evaluate
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


def test_recall_comes_first_and_what_is_modelled_says_so() -> None:
    text = printed(bench())
    parts = ("R@1", "energy of a query, all", "measured here, a query", "modelled for Kapoho Bay", "absent: loihi2")
    order = [text.index(part) for part in parts]
    assert order == sorted(order)
    assert re.search(r"│ Kapoho Bay, partly modelled +│ +[\d.]+ │ +8,380 \([\d,]+ to [\d,]+\) │", text), text
    assert re.search(r"│ this network, no board +│ +[\d.]+ │ +8,000 \(4,000 to 16,000\) │", text), text
    assert re.search(r"│ cosine, no network +│ +[\d.]+ │ +7,150 \(", text), text
    assert re.search(r"dynamic energy, uJ +│ +2\.23 │ +3\.04 │ +4\.02 │", text), text
    details = "\n".join(table.markdown() for tables in described.sections(bench()).values() for table in tables)
    assert re.search(r"its chips wait for host I/O, modelled \| 1,000 \(0 to 7,000\) \| - \| - \|", details), details
    assert re.search(r"host I/O, apart, ms: injected \(in use\) \| 1\.00 \| 13\.9 \|", details)
    assert "absent: loihi2, modelled energy and time: no energy per operation" in text
    assert text.strip().splitlines()[-1].startswith("parts of energy and time, counted events, thresholds and workload")


def test_every_modelled_figure_stands_below_the_word() -> None:
    energies = ("uJ", "mJ", "pJ")
    run = bench()
    whole = described.energy(run.energy)
    assert [whole.rows[k][0] for k in sorted(whole.strong)] == ["a whole query", "all but the encoding"]
    alone = described.energy(run.energy[1:])
    assert [row[0] for row in alone.rows if "board" in row[0]] == []
    assert [alone.rows[k][0] for k in sorted(alone.strong)] == ["a whole query", "all but the encoding"]
    assert all(("modelled" in row[0]) == (row[0].startswith("board")) for row in whole.rows)
    shown = [described.modelled(run.targets["kapoho-bay"], FIGURES), described.sweep(run.sweep)]
    for grid in shown:
        for column in grid.columns:
            if any(unit in column for unit in energies) or column in ("ms", "modelled low"):
                assert "modelled" in column
        assert "modelled" in grid.title or "modelled" in " ".join(grid.columns)
    assert all("modelled" in column for column in shown[0].columns)
    drawings = [plots.energy(FIGURES.dynamic_by_component, "e", ""), plots.pareto(run.sweep, "")]
    drawings += [plots.step_times(run.step_times["kapoho-bay"], "s", ""), plots.beside_anchors(FIGURES, "")]
    assert all("modelled" in drawing for drawing in drawings)
    assert "modelled" not in plots.latencies(run.measured, "")


def test_the_front_is_told_once_and_what_was_chosen_stands_out() -> None:
    def point(energy: float, **changes: Any) -> SweepPoint:
        values: dict[str, Any] = {"settings": {"steps": 30, "prune": 0.5}, "metrics": metrics(), "milliseconds": 0.1}
        return SweepPoint(
            **{
                **values,
                "microjoules": energy,
                "mean_steps": 33.0,
                "board_microjoules": 900.0,
                "front": True,
                **changes,
            }
        )

    rows = [point(1.0), point(1.0, settings={"steps": 31}), point(2.0, front=False), point(3.0, chosen="fast")]
    rows.append(point(0.5, settings={"stop_margin": 4.0}))
    grid = described.sweep(rows, bench().energy)
    # 7 mJ of encoding, .3 mJ of the host's part, and .9 mJ on the board.
    assert [(row[0], *row[4:7]) for row in grid.rows] == [
        ("fast", "8,200", "1,200", "3.00"),
        ("front", "8,200", "1,200", "1.00"),
        ("front, stops early", "8,200", "1,200", "0.500"),
    ]
    assert described.sweep(rows).rows[0][4:7] == ("-", "-", "3.00")
    assert grid.rows[1][-1] == "steps 30, prune 0.5"
    assert grid.strong == {0}
    assert "judge a choice on others" in grid.notes[0]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (None, "-"),
        (math.nan, "-"),
        (1234567.0, "1,230,000"),
        (0.99996, "1.00"),
        (12.34, "12.3"),
        (0.0000123, "1.23e-05"),
        (999.9, "1,000"),
        (-0.05, "-0.0500"),
    ],
)
def test_figures_have_three_significant_digits(value: float | None, text: str) -> None:
    assert described.figure(value) == text


def test_a_boards_own_figures_are_told() -> None:
    there = Measured("loihi2", "a board", 9, queries_per_second=88.0, no_energy="x", board={"idle_milliwatts": 1234.5})
    found = bench(measured=(there,), targets={}, sweep=(), step_times={})  # a page with nothing to draw
    assert re.search(r"idle milliwatts +│ +1,234 │", printed(found))
    assert "measured on a board" in page(found)
    assert as_json(found)["measured"]["loihi2"]["board"] == {"idle_milliwatts": 1234.5}


def test_all_the_energy_of_a_query() -> None:
    board, unknown, host, cosine = ways()
    assert unknown is None
    assert (board.dynamic, board.static) == (FIGURES.dynamic_microjoules, Estimate(13.0, 78.0, 110.0))
    # Static energy while host I/O goes on after the chips' work: 0, 1 and 7 mJ.
    io = board.io_static
    assert (io.low, io.nominal, io.high) == pytest.approx((0.0, 1000.0, 7000.0))
    # Milliseconds at 5, 10 and 20 W.
    assert (board.work.low, board.work.nominal, board.work.high) == pytest.approx((150.0, 300.0, 600.0))
    assert board.encoding.nominal == host.encoding.nominal == cosine.encoding.nominal == pytest.approx(7000.0)
    assert board.without_encoding.low == pytest.approx(2.2315 + 13 + 0 + 150)
    assert board.without_encoding.nominal == pytest.approx(3.0374 + 78 + 1000 + 300)
    assert board.whole.high == pytest.approx(4.0174 + 110 + 7000 + 600 + 14_000)
    assert host.whole.nominal == pytest.approx(1000 + 7000)
    assert cosine.whole.nominal == pytest.approx(150 + 7000)
    assert cosine.dynamic is cosine.static is cosine.io_static is None


def test_the_whole_energy_in_json() -> None:
    values = json.loads(json.dumps(as_json(bench())))["energy"]
    assert list(values) == ["kapoho-bay", "host", "cosine"]
    board = values["kapoho-bay"]
    assert board["dynamic_microjoules"] == as_json(bench())["modelled"]["kapoho-bay"]["dynamic_microjoules"]
    parts = ("dynamic", "static", "io_static", "work", "encoding")
    for level in ("low", "nominal", "high"):
        whole = sum(board[f"{part}_microjoules"][level] for part in parts)
        assert board["total_microjoules"][level] == pytest.approx(whole)
        assert board["without_encoding_microjoules"][level] == pytest.approx(
            whole - board["encoding_microjoules"][level]
        )
    assert (board["recall_at_1"], board["work_milliseconds"], board["encoding_milliseconds"]) == (0.8, 0.03, 0.7)
    assert values["cosine"]["static_microjoules"] is None
    assert as_json(bench(energy=()))["energy"] is None


def test_json_says_null_and_why() -> None:
    values = as_json(bench())
    second = values["modelled"]["loihi2"]
    assert second["dynamic_microjoules"] is second["milliseconds"] is second["dynamic_by_component"] is None
    assert "Loihi 2" in second["unavailable"]
    assert values["measured"]["kapoho-bay"]["milliseconds_per_query"] is None
    reasons = {row["what"]: row["reason"] for row in values["absent"]}
    assert reasons["kapoho-bay, measured"] == "NxSDK is not installed"
    assert reasons["energy of host, lava-fused, lava-fixed, bundle, measured"].endswith("no RAPL counters")
    assert not any("sweep" in what or "peers" in what for what in reasons)


def test_a_float_model_has_no_costs_but_a_complete_report() -> None:
    reason = "Kapoho Bay needs an integer network"
    targets = {"kapoho-bay": modelled(figures=None, counts={}, unavailable=reason)}
    changes = {"targets": targets, "workload": None, "peers": (), "sweep": (), "step_times": {}}
    found = bench(**changes)
    values = as_json(found)
    assert values["workload"] is values["sweep"] is values["peers"] is None
    assert values["counts"]["synaptic_operations"] == 30211.25  # of the host engine
    assert values["counts"]["messages"] is None
    reasons = {row["what"] for row in values["absent"]}
    assert {"workload metrics", "peers", "sweep of settings"} <= reasons
    assert reason in page(found)
    text = printed(found)
    assert reason in text
    assert "modelled low" not in text


def test_nan_becomes_null() -> None:
    empty = evaluate(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3), np.bool_))
    values = as_json(bench(recall=empty, events={"messages": float("nan")}, targets={}))
    assert values["recall"]["recall_at_1"] is None
    assert values["counts"]["messages"] is None
