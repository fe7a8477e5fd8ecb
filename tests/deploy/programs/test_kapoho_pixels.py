"""The program of a bundle that takes pixels: from these to counts in one run, on the stand-in's board and simulated."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support.boards.host_programs import Made, answers, pixel_queries, write_bundle
from support.boards.kapoho_board import Board, climb_here, edited

from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.bundle.folder import array_bytes
from lava_vpr.deploy.bundle.front_end import front_end_files
from lava_vpr.engine.inference.biases import held_biases
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.whole import WholeNetwork, counts_of
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.loihi import HOST_SPIKES, INPUT_SHIFT

SPEC = FrontEnd(width=8, levels=10, race=8, budget=40, reading=5)


def pictures(n: int, seed: int = 0) -> NDArray[np.uint8]:
    """Random pictures, the last of one grey level."""
    drawn = np.random.default_rng(seed).integers(0, 256, (n, SPEC.height, SPEC.width)).astype(np.uint8)
    drawn[-1] = 90
    return drawn


def network(neurons: int = 7) -> FixedNetwork:
    """A network whose neurons spike, inhibit each other, and have biases."""
    rng = np.random.default_rng(2)
    made = FixedNetwork(
        weights=rng.integers(-7, 8, (SPEC.populations["cells"], neurons)).astype(np.int16),
        bias=(rng.integers(-60, 5, neurons) << INPUT_SHIFT).astype(np.int32),
        bits=3,
        signed=True,
        threshold=60,
        inhibition=9,
        inhibition_exponent=4,  # 144: in two synapses
        decay=4095,
        steps=SPEC.ticks,
        regular=True,
        rising=SPEC.rising,
        rise=1,
    )
    made.check()
    return made


@pytest.fixture
def made(tmp_path: Path) -> Made:
    """A bundle of it, with five pictures and the counts that they must give."""
    whole = WholeNetwork.of(SPEC, network(), counted=True)
    files, facts = front_end_files(whole, KAPOHO_BAY, ())
    assert facts is not None
    shown = pictures(5)
    counts = counts_of(whole, shown)
    assert [len(np.unique(row)) > 1 for row in counts] == [True, True, True, True, False]
    own = {"host/pixels.npy": array_bytes(shown), "host/counts.npy": array_bytes(counts)}
    rates = np.array([SPEC.burst_codes(SPEC.bursts_of(one)).ravel() for one in shown])
    keys = np.zeros(len(rates), np.uint64)
    told = {"limits": {"host_spikes": HOST_SPIKES}, "front_end": facts}
    written = write_bundle(
        tmp_path / "bundle", "kapoho-bay", whole.places, {**files, **own}, (rates, keys), np.arange(5), **told
    )
    assert np.array_equal(written.counts, counts)
    return written


@pytest.mark.parametrize("simulate", [True, False])
def test_biases_of_each_query_are_written(board: Board, made: Made, tmp_path: Path, simulate: bool) -> None:
    words = ["--simulate"] if simulate else ["--batch", "2"]
    shown, whole = pictures(3, seed=9), WholeNetwork.of(SPEC, made.network)
    bias = held_biases(np.random.default_rng(4).integers(-3000, made.network.highest_bias, (3, 7)))
    ended = board.run(made, "--queries", pixel_queries(tmp_path / "q", shown, bias), "--out", tmp_path / "r", *words)
    assert (ended.code, ended.err) == (0, "")
    counts, _, _ = answers(tmp_path / "r")
    assert np.array_equal(counts, whole.trains(shown, bias)["exc"].sum(axis=1, dtype=np.int32))
    assert not np.array_equal(counts, counts_of(whole, shown))
    ended = board.run(
        made, "--queries", pixel_queries(tmp_path / "few", shown, bias[:2]), "--out", tmp_path / "s", *words
    )
    assert "biases.npy is int32 (2, 7), but must be int32 (3, 7)" in ended.err


@pytest.mark.parametrize("simulate", [True, False])
def test_its_counts_are_the_host_engines(board: Board, made: Made, tmp_path: Path, simulate: bool) -> None:
    words = ["--simulate"] if simulate else ["--batch", "2"]
    ended = board.run(made, "--self-test", *words)
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.startswith("equal: 5 pictures, 35 counts")
    shown = pictures(3, seed=9)
    ended = board.run(made, "--queries", pixel_queries(tmp_path / "q", shown), "--out", tmp_path / "r", *words)
    assert (ended.code, ended.err) == (0, "")
    counts, done, _ = answers(tmp_path / "r")
    assert done.all()
    assert np.array_equal(counts, counts_of(WholeNetwork.of(SPEC, made.network), shown))


def test_the_ladder_has_rungs_of_the_layers_then_pictures(board: Board, made: Made, tmp_path: Path) -> None:
    ended = board.run(made, "--ladder", tmp_path / "ladder.json")
    assert (ended.code, ended.err) == (0, ""), ended.out
    assert [line.split(": ")[0] for line in ended.out.splitlines()[:-1]] == ["ok front end"] * 8 + [
        "ok one reference",
        "ok all references",
    ]


@pytest.mark.parametrize("decay", ["decayU=4095", "decayV=0"])
def test_the_rung_of_neurons_of_places_tells_what_decays(board: Board, made: Made, decay: str) -> None:
    changed = f"configure(**dict(profile, {decay}))"
    report = climb_here(edited(board, made, "board_device.py", "configure(**profile)", changed), made, "front end: exc")
    assert [row["passed"] for row in report["rungs"]] == [False]
    assert climb_here(board, made, "front end: exc")["passed"]


CHIP, INPUT = "embedded.c", "board_input.py"
WRONG = {
    "states of cores without neurons of places stay": (
        "chip_program.py",
        "for core in network.cores if core.chip == chip and network.direct] or exc[:, 0]",
        "for core in network.cores if core.chip == chip and network.direct][-3:] or exc[:, 0]",
    ),
    "the clock is not silenced": (CHIP, "lv_set_bias(i, 0);", "lv_set_bias(i, i == 0 ? 1 | 7 << 12 : 0);"),
    "pixels have no bias": (INPUT, "CLOCK, rates.reshape", "CLOCK, 0 * rates.reshape"),
    "the clock has none": (INPUT, "np.append(CLOCK,", "np.append(0,"),
}
"""What the board gets wrongly: file, text, and what becomes of it."""


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_seen_by_the_self_test(board: Board, made: Made, name: str) -> None:
    ended = edited(board, made, *WRONG[name]).run(made, "--self-test", "--batch", "2", "--timeout", "3")
    assert ended.code == 1
    assert "self-test: neuron" in ended.err


def test_pixels_that_do_not_fit_are_refused(board: Board, made: Made, tmp_path: Path) -> None:
    for number, (shown, said) in enumerate(
        (
            (pictures(2).astype(np.int32), r"pixels.npy is int32 (2, 4, 8), but must be uint8 (n, 4, 8)"),
            (pictures(2)[:, 1:], r"pixels.npy is uint8 (2, 3, 8), but must be uint8 (n, 4, 8)"),
        )
    ):
        folder = pixel_queries(tmp_path / f"q{number}", shown)
        ended = board.run(made, "--queries", folder, "--out", tmp_path / "r", "--simulate")
        assert (ended.code, ended.out) == (1, "")
        assert said in ended.err
    (tmp_path / "empty").mkdir()
    ended = board.run(made, "--queries", tmp_path / "empty", "--out", tmp_path / "r", "--simulate")
    assert "pixels.npy: cannot be read" in ended.err


def test_neurons_of_two_chips_count_as_well(board: Board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the populations do not all stand on one chip."""
    few = replace(KAPOHO_BAY, cores=6)
    whole = WholeNetwork.of(SPEC, network(), counted=True)
    files, facts = front_end_files(whole, few, ())
    assert facts is not None
    chips = {name.split("/")[2][:5] for name in files if "/cores/" in name}
    assert chips == {"chip0", "chip1"}
    shown = pictures(4, seed=3)
    own = {"host/pixels.npy": array_bytes(shown), "host/counts.npy": array_bytes(counts_of(whole, shown))}
    rates = np.array([SPEC.burst_codes(SPEC.bursts_of(one)).ravel() for one in shown])
    told = {"limits": {"host_spikes": HOST_SPIKES}, "front_end": facts}
    given = rates, np.zeros(4, np.uint64)
    two = write_bundle(tmp_path / "b", "kapoho-bay", whole.places, {**files, **own}, given, np.arange(4), **told)
    ended = board.run(two, "--self-test")
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.startswith("equal: 4 pictures")
