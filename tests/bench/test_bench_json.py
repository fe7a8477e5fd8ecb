"""The JSON of `lava-vpr bench`, from made-up results."""

from __future__ import annotations

import json

import numpy as np
import pytest
from support.common.bench_results import FIGURES, bench, modelled, printed, ways

from lava_vpr.bench.show.json_values import as_json
from lava_vpr.bench.show.page import page
from lava_vpr.deploy.boards.constants import Estimate
from lava_vpr.matching.evaluation import evaluate


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
