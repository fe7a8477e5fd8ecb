"""Tables, JSON and page of `lava-vpr bench`, from made-up results."""

from __future__ import annotations

import io
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.common.browser import PHONE, on_phone, visit

from lava_vpr.bench.anchors import ANCHORS
from lava_vpr.bench.energy import Way, on_board
from lava_vpr.bench.results import (
    Bench,
    Candidate,
    Measured,
    Modelled,
    OnMap,
    Peer,
    StepTimes,
    Workload,
)
from lava_vpr.bench.show import energy, plots
from lava_vpr.bench.show import tables as described
from lava_vpr.bench.show.json_values import COUNTS, as_json
from lava_vpr.bench.show.page import page
from lava_vpr.bench.show.terminal import absences, tables
from lava_vpr.cli.common import PlainConsole
from lava_vpr.deploy.boards.constants import Constant
from lava_vpr.deploy.boards.estimate import Estimate
from lava_vpr.matching.answers import Answers, Together
from lava_vpr.matching.evaluation import Metrics, evaluate
from lava_vpr.matching.trust import Trust, trust
from lava_vpr.positions.frames import Positions
from lava_vpr.report import write_page
from lava_vpr.truth.alignment import Located, PositionErrors


def metrics(wrong: int = 2) -> Metrics:
    """Of ten queries, so many of them wrong."""
    scores = np.eye(10) + 0.01
    scores[:wrong] = np.roll(scores[:wrong], 1, axis=1)
    return evaluate(scores, np.linspace(0, 1, 10), np.eye(10, dtype=np.bool_))


def probabilities() -> Trust:
    """Of ten queries, two of them wrong and unsure."""
    sure = np.linspace(0.1, 1, 10)
    found = trust(Answers(np.arange(10), sure, sure), np.eye(10, dtype=np.bool_), Together(motion="any"))
    assert found is not None
    return found


def on_map() -> OnMap:
    """Ten queries five metres beside their places, two of them matched elsewhere."""
    places = np.stack([20.0 * np.arange(10), np.zeros(10)], axis=1)
    located = Located(Positions(places, "xy"), Positions(places + np.array([0.0, 5.0]), "xy"))
    matches = np.array([4, 3, *range(2, 10)])
    errors = PositionErrors(located, located.errors(matches), 25.0)
    return OnMap(errors, matches, matches == np.arange(10))


def modelled(**changes: Any) -> Modelled:
    """Kapoho Bay's costs of a query."""
    values: dict[str, Any] = {
        "target": "kapoho-bay",
        "chips": 2,
        "cores": 3,
        "tiles": 1,
        "steps": 53,
        "input_mode": "injected",
        "counts": {"synaptic_operations": 30211.25, "neuron_updates": 20600.5, "input_spikes": 1000.0, "steps": 53.0}
        | {"exc_spikes": 14.2, "inh_spikes": 14.2, "messages": 3042.4, "hops": 1812.0, "accesses": 42400.0},
        "dynamic_by_component": {
            "synapses": Estimate(0.71, 1.07, 1.07),
            "neurons": Estimate(1.5, 1.6, 2.4),
            "spikes": Estimate(0.002, 0.002, 0.002),
            "messages": Estimate(0.005, 0.34, 0.34),
            "hops": Estimate(0.0045, 0.0054, 0.0054),
            "clearing": Estimate(0.01, 0.02, 0.2),
        },
        "milliseconds": Estimate(0.15, 0.23, 0.41),
        "step_microseconds": Estimate(1.8, 2.2, 5.8),
        "static_millijoules": Estimate(0.013, 0.078, 0.11),
        "wall_static_millijoules": Estimate(0.013, 1.078, 7.11),
        "io_milliseconds_by_way": {"injected": Estimate(1.0, 13.9, 20.0), "bias": Estimate(0.1, 2.0, 4.0)},
        "io_microjoules_by_way": {"injected": Estimate(0.1, 0.1, 0.2), "bias": Estimate(5.0, 6.1, 8.0)},
        "clearing": {"mechanism": "embedded writes", "writes": 100, "microjoules": Estimate(0.01, 0.02, 0.2)},
        "assumptions": ("Every message pays for its own <packet>.",),
    }
    return Modelled(**values | changes)


def ways() -> tuple[Way | None, ...]:
    """Kapoho Bay, a board without energies, the host engine, and cosine."""
    second = Modelled("loihi2", 1, 1, None, 53, "injected", unavailable="no energy is public")
    boards = (on_board(modelled(), 0.8, 0.03, 0.7), on_board(second, 0.8, 0.03, 0.7))
    return (*boards, Way("host", 0.8, 0.1, 0.7), Way("cosine", 0.9, 0.015, 0.7))


def bench(**changes: Any) -> Bench:
    """A complete run, all made up."""
    rng = np.random.default_rng(3)
    times = {"host": 0.11, "lava-fused": 1.3, "lava-fixed": 180.0, "bundle": 26.0}
    measured = tuple(
        Measured(
            name,
            "from rates to spike counts",
            queries=200,
            threads=2,
            queries_per_second=900 / centre,
            milliseconds=tuple(np.sort(centre * np.exp(0.2 * rng.standard_normal(200)) + 0.01 * centre)),
            peak_bytes=210_000_000,
            no_energy="this processor has no RAPL counters",
        )
        for name, centre in times.items()
    )
    candidates = []
    for k in range(40):
        steps, spikes = int(rng.choice([30, 50, 100, 200])), float(rng.choice([6, 10, 20]))
        energy = 0.02 * steps + 0.03 * spikes + 0.3 * rng.random()
        wrong = int(np.clip(7 - 1.5 * np.log(energy) - rng.random() * 3, 0, 9))
        settings = {"steps": steps, "weight_bits": 2, "query_spikes": spikes, **({"stop_margin": 1.0} if k % 5 else {})}
        candidates.append(Candidate(settings, metrics(wrong), energy, steps / 400, steps + 3.0, front=k % 9 == 0))
    candidates[9] = replace(candidates[9], chosen="fast")
    candidates[18] = replace(candidates[18], chosen="this model")
    second = Modelled("loihi2", 1, 1, None, 53, "injected", counts=modelled().counts)
    values: dict[str, Any] = {
        "model": {"places": 10, "neurons": 10, "weight_bits": 2, "steps": 50, "preset": "loihi", "decoder": "contrast"},
        "machine": {"processor": "Some & Sons <CPU>", "cores": 2, "python": "3.10.20"},
        "images": 10,
        "recall": metrics(),
        "measured": (*measured, Measured("kapoho-bay", "", absent="NxSDK is not installed")),
        "targets": {
            "kapoho-bay": modelled(),
            "loihi2": replace(second, unavailable="no energy per operation of Loihi 2 is public"),
        },
        "workload": Workload(98_000, 78_400, 0.58, 0.981, 1e5, 0.0, 3e4, 2.06e4),
        "peers": (
            Peer("sad", "sum of absolute differences (the paper's baseline)", metrics(5), 81_000.0, 2, 78_400, 10),
            Peer("brian2", "VPRSNN's network", absent="Brian2 is not installed"),
        ),
        "sweep": tuple(candidates),
        "events": {"synaptic_operations": 30211.25, "input_spikes": 1000.0},
        "constants": (
            Constant("synapse", "synaptic operation, dense row", "pJ", 23.6, 35.5, 35.5, "SANA-FE 2.2.9, loihi.yaml"),
        ),
        "step_times": (StepTimes("kapoho-bay", *(tuple(x + 0.3 * rng.random(53)) for x in (1, 0.7, 1.1, 2)), 0.6),),
        "command": "lava-vpr bench m.lvpr query --sweep",
        "energy": tuple(way for way in ways() if way is not None),
        "trust": {"single": probabilities()},
        "on_map": on_map(),
    }
    return Bench(**values | changes)


# JSON


def test_json_has_the_keys_that_scripts_rely_on() -> None:
    values = as_json(bench())
    json.dumps(values, allow_nan=False)
    assert {"measured", "modelled", "counts", "recall"} <= set(values)
    host = values["measured"]["host"]
    assert set(host["milliseconds_per_query"]) == {"p50", "p95", "p99"}
    assert host["queries_per_second"] == pytest.approx(900 / 0.11)
    board = values["modelled"]["kapoho-bay"]
    for name in ("dynamic_microjoules", "static_millijoules", "milliseconds", "io_milliseconds"):
        assert set(board[name]) == {"low", "nominal", "high"}
        assert board[name]["low"] <= board[name]["nominal"] <= board[name]["high"]
    parts = board["dynamic_by_component"].values()
    for level in ("low", "nominal", "high"):
        assert board["dynamic_microjoules"][level] == pytest.approx(sum(part[level] for part in parts))
    assert board["io_milliseconds"] == board["io_milliseconds_by_way"]["injected"]
    assert set(COUNTS) <= set(values["counts"])
    assert values["counts"]["hops"] == 1812.0
    assert values["recall"] == metrics().as_json()


def test_all_the_energy_of_a_query() -> None:
    board, unknown, host, cosine = ways()
    assert unknown is None
    assert board is not None
    assert host is not None
    assert cosine is not None
    assert (board.dynamic, board.static) == (modelled().dynamic_microjoules, Estimate(13.0, 78.0, 110.0))
    # Static energy while host I/O goes on after the chips' work: 0, 1 and 7 mJ.
    io = board.io_static
    assert io is not None
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
    assert "Brian2" in reasons["brian2, as a peer"]
    assert not any("sweep" in what or "peers" in what for what in reasons)


def test_a_float_model_has_no_costs_but_a_complete_report() -> None:
    reason = "Kapoho Bay needs an integer network"
    targets = {"kapoho-bay": modelled(dynamic_by_component=None, milliseconds=None, counts={}, unavailable=reason)}
    changes = {"targets": targets, "workload": None, "peers": (), "sweep": (), "step_times": ()}
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


# Terminal


def printed(found: Bench) -> str:
    console = PlainConsole(width=220, record=True, file=io.StringIO())
    for table in tables(found):
        console.print(table)
    for line in absences(found):
        console.print(line)
    return console.export_text()


def test_recall_comes_first_and_what_is_modelled_says_so() -> None:
    text = printed(bench())
    parts = ("R@1", "energy of a query, all", "measured here", "modelled for Kapoho Bay", "counted events")
    order = [text.index(part) for part in parts]
    assert order == sorted(order)
    assert re.search(r"energy, uJ +┃ +Kapoho Bay ┃ +this network, no board ┃ +cosine, no network ┃", text)
    assert re.search(r"static in host I/O after that, modelled │ +1,000 \(0 to 7,000\) │ +- │ +- │", text), text
    assert re.search(r"all of it +│ +8,380 \([\d,]+ to [\d,]+\) │ +8,000 \(4,000 to 16,000\) │ +7,150 \(", text), text
    assert re.search(r"dynamic energy, uJ +│ +2\.23 │ +3\.04 │ +4\.02 │", text), text
    assert re.search(r"host I/O, apart, ms: injected \(in use\) +│ +1\.00 │ +13\.9 │", text)
    assert "absent: loihi2, modelled energy and time: no energy per operation" in text


def test_every_modelled_figure_stands_below_the_word() -> None:
    energies = ("uJ", "mJ", "pJ")
    run = bench()
    whole = energy.table(run.energy)
    assert [whole.rows[k][0] for k in sorted(whole.strong)] == ["all but the encoding", "all of it"]
    alone = energy.table(run.energy[1:])
    assert [row[0] for row in alone.rows if "board" in row[0]] == []
    assert [alone.rows[k][0] for k in sorted(alone.strong)] == ["all but the encoding", "all of it"]
    assert all(("modelled" in row[0]) == (row[0].startswith("board")) for row in whole.rows)
    shown = [described.modelled(run.targets["kapoho-bay"]), described.sweep(run.sweep)]
    for grid in shown:
        for column in grid.columns:
            if any(unit in column for unit in energies) or column in ("ms", "modelled low"):
                assert "modelled" in column
        assert "modelled" in grid.title or "modelled" in " ".join(grid.columns)
    assert all("modelled" in column for column in shown[0].columns)
    drawings = [plots.energy(modelled().dynamic_by_component or {}, "e", ""), plots.pareto(run.sweep, "")]
    drawings += [plots.step_times(run.step_times[0], "s", ""), plots.beside_anchors(modelled(), "")]
    assert all("modelled" in drawing for drawing in drawings)
    assert "modelled" not in plots.latencies(run.measured, "")


def test_the_front_is_told_once_and_what_was_chosen_stands_out() -> None:
    def point(energy: float, **changes: Any) -> Candidate:
        values: dict[str, Any] = {"settings": {"steps": 30, "prune": 0.5}, "metrics": metrics(), "milliseconds": 0.1}
        return Candidate(**{**values, "microjoules": energy, "mean_steps": 33.0, "front": True, **changes})

    rows = [point(1.0), point(1.0, settings={"steps": 31}), point(2.0, front=False), point(3.0, chosen="fast")]
    rows.append(point(0.5, settings={"stop_margin": 4.0}))
    grid = described.sweep(rows)
    assert [(row[0], row[4]) for row in grid.rows] == [
        ("fast", "3.00"),
        ("front", "1.00"),
        ("front, stops early", "0.500"),
    ]
    assert grid.rows[1][-1] == "steps 30, prune 0.5"
    assert grid.strong == {0}
    assert "judge a choice on others" in grid.note


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
    found = bench(measured=(there,), targets={}, sweep=(), step_times=())  # a page with nothing to draw
    assert re.search(r"idle milliwatts +│ +1,234 │", printed(found))
    assert "measured on a board" in page(found)
    assert as_json(found)["measured"]["loihi2"]["board"] == {"idle_milliwatts": 1234.5}


# Anchors


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


# The page


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
    found = replace(found, measured=(Measured(evil, evil, absent=evil), *timed), sweep=(), step_times=())
    text = page(found)
    assert "<script" not in text
    assert "alert(1)" in text
    assert "Every message pays for its own &lt;packet&gt;." in text


def test_constants_are_listed_with_their_sources(text: str) -> None:
    assert "synaptic operation, dense row" in text
    assert "SANA-FE 2.2.9, loihi.yaml" in text
    assert as_json(bench())["constants"]["synapse"]["source"] == "SANA-FE 2.2.9, loihi.yaml"


def test_ids_are_unique_and_links_lead_somewhere(text: str) -> None:
    ids = re.findall(r'\sid="([^"]+)"', text)
    assert len(ids) == len(set(ids))
    for target in re.findall(r'href="#([^"]+)"', text):
        assert target in ids, target


def test_few_times_and_odd_ones_can_be_drawn() -> None:
    few = [Measured("one", "", milliseconds=(0.5,)), Measured("same", "", milliseconds=(2.0, 2.0))]
    assert "p99" in plots.latencies(few, "")
    point = Candidate({"steps": 1}, metrics(), 1.0, 1.0, 1.0, front=True, chosen="fast")
    drawing = plots.pareto([point], "")
    assert all(text in drawing for text in ("modelled energy, µJ", "modelled time, ms", ">fast<"))
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
    assert row[2:4] == ("20.0", "100.0")
    without = bench(trust={}, on_map=None)
    assert as_json(without)["position_error"] is None
    assert not re.search(r'<section id="(map|trust)">', page(without))
    assert described.thresholds(without).rows == ()


def test_on_a_phone_nothing_sticks_out_and_words_can_be_read(tmp_path: Path) -> None:
    seen = on_phone(page(bench()), tmp_path)
    assert seen.wide <= PHONE
    assert seen.smallest is not None
    assert seen.smallest >= 7
