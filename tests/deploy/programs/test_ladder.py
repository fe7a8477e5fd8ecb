"""The ladder of self-tests: its counts are the host engine's, it holds on sound registers, and tells what fails."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.boards import loihi2_bundles
from support.boards.kapoho_board import Board, edited, layout, make, plan_by_hand, random_network

from lava_vpr.engine.inference.fixed import FixedNetwork, count_spikes

NAMES = ["one neuron", "one axon", "weights", "signs", "decay", "threshold", "reset", "inhibition"]


@pytest.mark.parametrize("steps", [13, 61])
@pytest.mark.parametrize(("bits", "signed"), [(1, False), (3, True), (3, False), (6, True)])
def test_counts_of_the_rungs_are_the_host_engines(program: Any, bits: int, signed: bool, steps: int) -> None:
    climbed = program.rungs.rungs(bits, signed, 45, steps)
    assert [rung.name for rung in climbed] == [name for name in NAMES if signed or name != "signs"]
    for rung in climbed:
        network = FixedNetwork(
            np.array(rung.weights, np.int16),
            np.zeros(len(rung.weights[0]), np.int32),
            bits,
            bool((np.array(rung.weights) < 0).any()) or signed,
            rung.threshold,
            rung.lateral,
            0,
            rung.decay,
            steps,
            regular=True,
        )
        rates = np.where(rung.active, 65535, 0).astype(np.uint16)[None]
        counts = count_spikes(network, rates, np.array([7], np.uint64))[0][0]
        assert program.rungs.expected(rung, steps, network.silent_steps) == counts.tolist(), rung.name
        assert counts.any(), rung.name


def test_every_rung_says_what_it_proves_and_what_its_failure_means(program: Any) -> None:
    climbed = program.rungs.rungs(3, True, 45, 61)
    for said in ("name", "proves", "failure"):
        assert len({getattr(rung, said) for rung in climbed}) == len(climbed)
    weights = next(rung for rung in climbed if rung.name == "weights")
    assert len(set(program.rungs.expected(weights, 61, 3))) == 4  # the bits of a weight give counts that differ
    inhibited = next(rung for rung in climbed if rung.name == "inhibition")
    free = inhibited._replace(lateral=0)
    assert program.rungs.expected(inhibited, 61, 3) != program.rungs.expected(free, 61, 3)


def climbed(path: Path) -> dict[str, Any]:
    """The file that is sent back."""
    return dict(json.loads(path.read_text()))


@pytest.mark.quick(1)
@pytest.mark.parametrize("simulate", [False, True])
@pytest.mark.parametrize("mode", [{}, {"regular": True, "bias_input": True}])
def test_kapoho_bay_climbs(board: Board, tmp_path: Path, simulate: bool, mode: dict[str, Any]) -> None:
    made = make(tmp_path, layout("two chips", random_network(3, signed=True, threshold=30, **mode), 0.0))
    file = tmp_path / "ladder.json"
    ended = board.run(made, "--ladder", file, *["--simulate"] * simulate)
    assert (ended.code, ended.err) == (0, ""), ended.out
    lines = ended.out.splitlines()
    assert [line.split(":")[0] for line in lines[:-1]] == [f"ok {name}" for name in (*NAMES, *REFERENCES)]
    assert lines[-1] == f"all 10 rungs hold; send {file}"
    report = climbed(file)
    assert report["passed"]
    assert (report["board"], report["simulated"]) == ("Kapoho Bay", simulate)
    assert all(rung["passed"] and rung["proves"] for rung in report["rungs"])
    assert {"python", "numpy", "machine"} <= set(report["versions"])


WIDE = {(0, 0): [("exc", 0, 70), ("inh", 0, 1)], (1, 2): [("exc", 70, 10)]}
"""Cores whose compartments need other numbers of index bits."""
OTHERS = ["rows of inputs, indices of 6 bits", "rows of the inhibitory neuron, indices of 6 bits"]
OTHERS += ["single synapses, indices of 6 bits"]


@pytest.mark.parametrize(
    ("signed", "dense"),
    [(True, 0.5), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((False, 0.0), (False, 0.5), (True, 0.0)))],
)
def test_every_format_of_the_bundle_has_a_rung(board: Board, tmp_path: Path, signed: bool, dense: float) -> None:
    network = random_network(2, neurons=80, signed=signed, threshold=300 if signed else 900)
    made = make(tmp_path, plan_by_hand(network, WIDE, dense), images=2)  # type: ignore[arg-type]
    climbed_in: list[dict[str, Any]] = []
    plain = board.program.board_device.Device.__init__

    def noted(self: Any, own: Any, *more: Any) -> None:
        climbed_in.extend(form for core in own.cores for form in core.registers["synapseFmt"] if form)
        plain(self, own, *more)

    board.program.board_device.Device.__init__ = noted
    file = tmp_path / "ladder.json"
    ended = board.run(made, "--ladder", file)
    assert (ended.code, ended.err) == (0, ""), ended.out
    names = [rung["name"] for rung in climbed(file)["rungs"]]
    own = ["rows without indices"] if dense else []
    assert names == [*(name for name in NAMES if signed or name != "signs"), *own, *OTHERS, *REFERENCES]
    tables = [json.loads(path.read_text()) for path in made.path.glob("cores/*/registers.json")]
    rungs_alone = climbed_in[: -sum(len(table["synapseFmt"]) - 1 for table in tables) * 2]
    for form in (form for table in tables for form in table["synapseFmt"] if form):
        assert form in rungs_alone, form


def test_a_wrong_index_width_fails_its_rung(board: Board, tmp_path: Path) -> None:
    network = random_network(2, neurons=80, signed=True, threshold=300)
    made = make(tmp_path, plan_by_hand(network, WIDE, 0.0), images=2)  # type: ignore[arg-type]
    wrong = edited(board, made, "board_device.py", "CIdx=", "CIdx=0 * ")
    path = tmp_path / "ladder.json"
    assert wrong.run(made, "--ladder", path, "--timeout", 3).code == 1
    rows = {row["name"]: row for row in climbed(path)["rungs"]}
    assert not any(rows[name]["passed"] for name in OTHERS)


REFERENCES = ("one reference", "all references")

WRONG: dict[str, tuple[str, str, str, tuple[str, ...]]] = {
    "decay": ("board_device.py", "configure(**profile)", "configure(**dict(profile, decayV=0))", ("decay",)),
    "threshold": (
        "board_device.py",
        "configure(**threshold)",
        "configure(vth=max(1, threshold['vth'] - 1))",
        ("threshold",),
    ),
    "axon": ("chip_program.py", "= injection[:, 3]", "= injection[::-1, 3]", ("one axon",)),
    "width": ("board_device.py", "Wgt=weight,", "Wgt=weight // 64 * 32,", ("one neuron", "weights")),
    "sign": ("board_device.py", "Wgt=weight,", "Wgt=abs(weight),", ("signs",)),
    "clearing": ("embedded.c", "    lv_report();\n    lv_clear();", "    lv_report();", ("reset",)),
    "inhibition": ("board_device.py", "Wgt=weight,", "Wgt=weight if form != 2 else -weight,", ("inhibition",)),
}
"""A register that the board gets wrongly: file, text, what becomes of it, and rungs that must fail."""


QUICK = ("decay", "sign", "clearing")


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in WRONG]
)
def test_one_wrong_register_fails_its_rung(board: Board, tmp_path: Path, name: str) -> None:
    file, old, new, rungs = WRONG[name]
    made = make(tmp_path, layout("one core", random_network(3, signed=True, threshold=30), 0.0))
    path = tmp_path / "ladder.json"
    ended = edited(board, made, file, old, new).run(made, "--ladder", path, "--timeout", 3)
    assert ended.code == 1
    assert f"rungs failed, first {rungs[0]}; send {path}" in ended.err
    rows = {row["name"]: row for row in climbed(path)["rungs"]}
    assert not any(rows[rung]["passed"] for rung in rungs)
    assert rows[rungs[0]]["failure"] in ended.out


def test_a_file_that_cannot_be_written_is_said_before_the_climb(board: Board, tmp_path: Path) -> None:
    made = make(tmp_path, layout("one core", random_network(3, signed=True, threshold=30), 0.0))
    path = tmp_path / "nowhere" / "ladder.json"
    ended = board.run(made, "--simulate", "--ladder", path)
    assert (ended.code, ended.out) == (1, "")
    assert ended.err == f"{path}: cannot be written (No such file or directory); name another file\n"


def test_without_nxsdk_there_is_no_ladder(board: Board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = make(tmp_path, layout("one core", random_network(3, signed=True, threshold=30), 0.0))
    monkeypatch.setitem(sys.modules, "nxsdk", None)
    ended = board.run(made, "--ladder", tmp_path / "ladder.json")
    assert ended.code == 1
    assert "has no nxsdk" in ended.err
    assert not (tmp_path / "ladder.json").exists()


@pytest.mark.lava
@pytest.mark.slow
@pytest.mark.parametrize("changes", [{"signed": True}, {"bias_input": True, "signed": True}])
def test_loihi_2_climbs_in_lavas_simulation_and_on_the_stand_in(tmp_path: Path, changes: dict[str, Any]) -> None:
    bundle = loihi2_bundles.write_bundle(tmp_path / "bundle", loihi2_bundles.network(**changes))
    standin = loihi2_bundles.environment(options=loihi2_bundles.asked(tmp_path))
    for simulate, env in ((["--simulate"], None), ([], standin)):
        file = tmp_path / f"ladder{len(simulate)}.json"
        code, text = loihi2_bundles.program(bundle, *simulate, "--ladder", file, env=env)
        assert code == 0, text
        assert text.splitlines()[-1] == f"all 10 rungs hold; send {file}"
        report = climbed(file)
        assert (report["board"], report["simulated"]) == ("Loihi 2", bool(simulate))
        assert [rung["name"] for rung in report["rungs"]] == [*NAMES, *REFERENCES]
