"""Power on a board, with stand-ins for the vendors' software: a whole measurement, and what is said without one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from support.boards.host_programs import write_queries
from support.boards.kapoho_board import ASKED, STANDIN as NXSDK
from support.boards.loihi2_bundles import (
    STANDIN as LAVA_LOIHI,
    asked,
    environment,
    network,
    program,
    queries,
    write_bundle,
)
from support.common.small_models import encoded, small_model

from lava_vpr.bench.measure import board_power
from lava_vpr.bench.measure.timing import measure
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.bench.results import Measured

STEPS = 400
SMALL = 128  # steps of a presentation of the small model


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A short run, as if the boards were there."""
    monkeypatch.setattr(board_power, "STEPS", STEPS)
    monkeypatch.setattr("lava_vpr.backends.registry.require", lambda name, model: None)
    return monkeypatch


def on_kapoho_bay(bench: pytest.MonkeyPatch, **faults: object) -> Measured:
    bench.setenv("PYTHONPATH", str(NXSDK))
    bench.setenv("KAPOHOBAY", "1")
    bench.delenv("NXSDK_PYTHON", raising=False)
    bench.setenv("STANDIN", json.dumps({"asked": ASKED, **faults}))
    return measure(QuerySet.of(small_model(), encoded(noise=0.4)), "kapoho-bay", limit=3)


def on_loihi2(bench: pytest.MonkeyPatch, options: Path | None = None) -> Measured:
    for name, value in environment(LAVA_LOIHI, options).items():
        bench.setenv(name, value)
    return measure(QuerySet.of(small_model(), encoded(noise=0.4)), "loihi2", limit=3)


def test_kapoho_bay(bench: pytest.MonkeyPatch) -> None:
    found = on_kapoho_bay(bench)
    steps = 2 + 6 * SMALL  # three queries, repeated until there are enough; the program runs two more
    assert found.absent == ""
    assert found.board == {
        "steps": steps,
        "microseconds_per_step": 12.5,
        "milliwatts": 950.0,
        "idle_milliwatts": 900.0,
        "dynamic_milliwatts": 50.0,
        "microseconds_per_query": SMALL * 12.5,
        "dynamic_microjoules_per_query": pytest.approx(SMALL * 12.5e-6 * 50e-3 * 1e6),
    }
    assert found.queries_per_second == pytest.approx(1e6 / (SMALL * 12.5))
    assert found.queries == 3


@pytest.mark.slow
def test_a_board_without_sensors(bench: pytest.MonkeyPatch) -> None:
    found = on_kapoho_bay(bench, sensors=False)
    assert found.absent.startswith("NxSDK measured no power (")
    assert found.absent.endswith("the board may have no sensors (6 of 6 queries answered)")
    assert found.board is None


@pytest.mark.lava
def test_loihi_2(bench: pytest.MonkeyPatch) -> None:
    found = on_loihi2(bench)
    assert found.absent == ""
    assert found.board["steps"] == 6 * SMALL
    assert found.board["dynamic_milliwatts"] == pytest.approx(250)
    assert found.board["dynamic_microjoules_per_query"] == pytest.approx(250e-3 * SMALL * 8.0)


@pytest.mark.lava
@pytest.mark.slow
def test_a_profiler_that_measures_nothing(bench: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found = on_loihi2(bench, asked(tmp_path, fault="no power", step=1))
    assert "the profiler measured no power (0.0 W, 0.0 us a step); run again" in found.absent


def test_power_needs_a_board_and_one_run(tmp_path: Path) -> None:
    bundle = write_bundle(tmp_path / "b", network(bias_input=True))
    words = ("--queries", write_queries(tmp_path / "q", *queries()), "--out", tmp_path / "o", "--power", tmp_path / "p")
    code, said = program(bundle, *words, "--simulate")
    assert (code, said) == (1, "--power needs the board, without --simulate")
    assert program(bundle, *words) == (
        1,
        "--power needs all queries in one run, but the inputs of this bundle integrate biases that are written between "
        "runs; deploy the model with --input-mode injected, and measure that bundle",
    )
    assert program(bundle, "--check", "--power", tmp_path / "p")[0] == 2
    assert not (tmp_path / "p").exists()
