"""The ladder of self-tests: its counts are the host engine's, it holds on sound registers, and tells what fails."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.boards import loihi2_bundles
from support.boards.kapoho_board import ASKED, Board, climb_here, edited, layout, make, plan_by_hand, random_network

from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork

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
    assert [line.split(":")[0] for line in lines[:-1]] == [f"ok {name}" for name in (*NAMES, "tables", *REFERENCES)]
    assert lines[-1] == f"all 11 rungs hold; send {file}"
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
    report = climb_here(board, made)
    own = ["rows without indices"] if dense else []
    wanted = [*(name for name in NAMES if signed or name != "signs"), *own, *OTHERS, "tables", *REFERENCES]
    assert [rung["name"] for rung in report["rungs"]] == wanted
    assert report["passed"]
    tables = [json.loads(path.read_text()) for path in made.path.glob("cores/*/registers.json")]
    rungs_alone = climbed_in[: -sum(len(table["synapseFmt"]) - 1 for table in tables) * 2]
    for form in (form for table in tables for form in table["synapseFmt"] if form):
        assert form in rungs_alone, form


def test_a_wrong_index_width_fails_its_rung(board: Board, tmp_path: Path) -> None:
    network = random_network(2, neurons=80, signed=True, threshold=300)
    made = make(tmp_path, plan_by_hand(network, WIDE, 0.0), images=2)  # type: ignore[arg-type]
    report = climb_here(edited(board, made, "board_device.py", "CIdx=", "CIdx=0 * "), made, *OTHERS)
    assert [row["passed"] for row in report["rungs"]] == [False] * 3


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


@pytest.mark.parametrize("name", WRONG)
def test_one_wrong_register_fails_its_rung(
    board: Board, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file, old, new, rungs = WRONG[name]
    made = make(tmp_path, layout("one core", random_network(3, signed=True, threshold=30), 0.0))
    report = climb_here(edited(board, made, file, old, new), made, *NAMES[: NAMES.index(rungs[0])], *rungs)
    assert [row["name"] for row in report["rungs"] if not row["passed"]] == list(rungs)
    failures = [row["failure"] for row in report["rungs"] if not row["passed"]]
    assert all(failure in capsys.readouterr().out for failure in failures[:1])
    assert all(failures)


WITHOUT = [kind for kind in ASKED if kind != "rows with indices, of discrete axons"]
CURES: dict[str, tuple[str, dict[str, Any], tuple[str, ...]]] = {
    "fields": ("one neuron", {"no_type": True}, ("does not compile",)),
    "count-words": ("one neuron", {"counts_words": True}, ("the chip does not answer in time",)),
    "one-word": ("one neuron", {"one_word": True}, ("the chip does not answer in time",)),
    "compression-3": ("one neuron", {"asked": WITHOUT}, ("compression 0",)),
    "fields,one-word": ("one neuron", {"no_type": True, "one_word": True}, ()),
    "whole-cores": ("reset", {"stale": True}, ()),
    "phases": ("reset", {"stuck": True}, ()),
    "phases,whole-cores": ("reset", {"stuck": True, "stale": True}, ()),
    "masks": ("tables", {"memory": 150}, ("region is full",)),
}
"""Ways, the rung whose failure they cure, a board that fails in just that way, and what is then said.

The first fails without waiting.
"""


@pytest.mark.quick(1)
@pytest.mark.parametrize("names", CURES)
def test_the_ladder_finds_the_way_that_cures_a_board(board: Board, tmp_path: Path, names: str) -> None:
    """The rung fails without the ways and passes with them, as do the bundle's references; one way less is too few."""
    rung, faults, said = CURES[names]
    made = make(tmp_path, layout("two chips", random_network(3, signed=True, threshold=30), 0.0))
    report = climb_here(board, made, rung, "all references", **faults)
    assert report["passed"], report
    assert ",".join(report["ways"]) == names
    first, last = report["rungs"]
    assert last["said"].startswith("equal: 5 references")
    assert first["tried"][0]["ways"] == []
    output = first["tried"][0].get("error", "") + first["tried"][0].get("output", "")
    assert all(word in output for word in said), output
    words = ("--self-test", "--timeout", 3, "--ways", names)
    assert board.run(made, *words, **faults).code == 0


ONE_ANSWER = """
import json, os, sys
number, name, ways = json.loads(sys.stdin.readline())
path = os.path.join(sys.argv[2], f"{number}.json")
with open(path + ".part", "w") as file:
    file.write('{"found": [[1]]}')
os.replace(path + ".part", path)
os._exit(139)
"""


def test_a_crash_costs_one_attempt(board: Board, tmp_path: Path) -> None:
    """Also where the child ends between two attempts, with what is sent to it unread."""
    line = board.program.command_line
    options = line.parsed(line.parser(""), ["--ladder", "", "--batch", "100"])
    (tmp_path / "one.py").write_text(ONE_ANSWER)
    with board.program.attempts.Attempts(str(tmp_path / "one.py"), options, 500) as attempts:
        assert attempts.patience > 5 * (60 + 10 * 100)  # of five batches
        assert attempts("weights", frozenset())["found"] == [[1]]
        attempts.child.wait(60)
        assert attempts("signs", frozenset())["error"] == "ended with code 139: it wrote nothing"
        assert attempts("decay", frozenset())["found"] == [[1]]


def test_a_hang_costs_one_attempt(board: Board, tmp_path: Path) -> None:
    """Without a probe a read waits for ever: the child ends itself, and another goes on."""
    made = make(tmp_path, layout("one core", random_network(3, signed=True, threshold=30), 0.0), images=1)
    path = tmp_path / "ladder.json"
    ended = board.run(made, "--ladder", path, "--timeout", 1, one_word=True, no_probe=True)
    assert ended.code == 0, ended
    assert ended.out.startswith("tried   one neuron: queries 0 to 0: the board did not finish within 1 s")
    assert ended.out.endswith(f"all 11 rungs hold; send {path}; from now on use --ways one-word\n")
    assert "did not finish" in climbed(path)["rungs"][0]["tried"][0]["output"]


def test_ways_are_named_rightly(board: Board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = make(tmp_path, layout("one core", random_network(3)), images=1)
    for words, said in (("no-way", "there is no way no-way; --ways knows count-words"), ("fields,whole-cores", "two")):
        monkeypatch.setenv("LAVA_VPR_WAYS", words)
        ended = board.run(made, "--self-test")
        assert ended.code == 1
        assert said in ended.err


def test_a_file_that_cannot_be_written_is_said_before_the_climb(board: Board, tmp_path: Path) -> None:
    made = make(tmp_path, layout("one core", random_network(3, signed=True, threshold=30), 0.0))
    path = tmp_path / "nowhere" / "ladder.json"
    ended = board.run(made, "--simulate", "--ladder", path)
    assert (ended.code, ended.out) == (1, "")
    assert ended.err == f"{path}: cannot be written (No such file or directory); name another file\n"


def test_without_nxsdk_the_file_says_so(board: Board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = make(tmp_path, layout("one core", random_network(3, signed=True, threshold=30), 0.0))
    monkeypatch.setitem(sys.modules, "nxsdk", None)
    ended = board.run(made, "--ladder", tmp_path / "ladder.json")
    assert ended.code == 1
    assert ended.err.startswith("1 of 1 rungs failed, first software; send ")
    assert "has no nxsdk" in climbed(tmp_path / "ladder.json")["rungs"][0]["error"]


FEW = ("one neuron", "one axon", "reset")


def loihi_2_climbs(bundle: Path, folder: Path, *words: str, env: dict[str, str] | None) -> tuple[int, dict[str, Any]]:
    """Climb with a bundle's own program; its exit code and the file."""
    file = folder / "ladder.json"
    code, text = loihi2_bundles.program(bundle, *words, "--ladder", file, env=env)
    report = climbed(file)
    also = f"; from now on use --ways {','.join(report['ways'])}" if report["ways"] else ""
    assert text.splitlines()[-1].endswith(f"; send {file}{also}"), text
    return code, report


@pytest.mark.lava
@pytest.mark.slow
@pytest.mark.parametrize("changes", [{"signed": True}, {"bias_input": True, "signed": True}])
def test_loihi_2_climbs_in_lavas_simulation_and_on_the_stand_in(tmp_path: Path, changes: dict[str, Any]) -> None:
    """Both input modes in one call."""
    bundle = loihi2_bundles.write_bundle(tmp_path / "bundle", loihi2_bundles.network(**changes))
    standin = loihi2_bundles.environment(options=loihi2_bundles.asked(tmp_path))
    other = "injected" if "bias_input" in changes else "integrated biases"
    for simulate, env in ((["--simulate"], None), ([], standin)):
        code, report = loihi_2_climbs(bundle, tmp_path, *simulate, env=env)
        assert (code, report["passed"], report["ways"]) == (0, True, [])
        assert (report["board"], report["simulated"]) == ("Loihi 2", bool(simulate))
        names = [*NAMES, *(f"{name}, {other}" for name in FEW), *REFERENCES]
        assert [rung["name"] for rung in report["rungs"]] == names


@pytest.mark.lava
@pytest.mark.slow
@pytest.mark.parametrize(
    ("bias_input", "refuse", "way"),
    [(True, "set", "injected"), (False, "arrays", "scalars"), (True, "arrays", "scalars"), (False, "reset", "fresh")],
)
def test_loihi_2_finds_the_way_that_cures_a_board(tmp_path: Path, bias_input: bool, refuse: str, way: str) -> None:
    """What cures the small networks gives the bundle's own counts, too, and so it does when it is asked for."""
    network = loihi2_bundles.network(signed=True, bias_input=bias_input)
    bundle = loihi2_bundles.write_bundle(tmp_path / "bundle", network)
    env = loihi2_bundles.environment(options=loihi2_bundles.asked(tmp_path, refuse=[refuse]))
    report = loihi_2_climbs(bundle, tmp_path, env=env)[1]
    assert report["ways"] == [way]
    assert all(row["passed"] for row in report["rungs"][-2:])
    assert loihi2_bundles.program(bundle, "--self-test", "--ways", way, env=env)[0] == 0
    assert loihi2_bundles.program(bundle, "--self-test", env=env)[0] == 1


@pytest.mark.lava
@pytest.mark.slow
def test_a_ladder_climbs_with_another_lava(tmp_path: Path) -> None:
    """Which other uses of the program refuse, unless it is asked for."""
    bundle = loihi2_bundles.write_bundle(tmp_path / "bundle", loihi2_bundles.network(signed=True))
    metadata = tmp_path / "older" / "lava_nc-0.9.0.dist-info" / "METADATA"
    metadata.parent.mkdir(parents=True)
    metadata.write_text("Metadata-Version: 2.1\nName: lava-nc\nVersion: 0.9.0\n")
    env = loihi2_bundles.environment(options=loihi2_bundles.asked(tmp_path))
    env["PYTHONPATH"] = f"{metadata.parents[1]}:{env['PYTHONPATH']}"
    code, report = loihi_2_climbs(bundle, tmp_path, env=env)
    assert (code, report["lava"].split(",")[0]) == (0, "lava-nc 0.9.0")
    code, text = loihi2_bundles.program(bundle, "--check", env=env)
    assert code == 1
    assert text.endswith("lava-nc 0.9.0 is installed, 0.10 is needed: pip install lava-nc==0.10.*, or --ways any-lava")
    assert loihi2_bundles.program(bundle, "--check", "--ways", "any-lava", env=env)[0] == 0
