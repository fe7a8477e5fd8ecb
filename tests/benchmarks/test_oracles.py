"""What holds our integers against other simulators: every difference is counted, and none explained that is not."""

from __future__ import annotations

import ast
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings, strategies as st
from support.common.commands import run
from support.common.teaching import teach_quickly

from benchmarks import program
from benchmarks.learning.replayed import gained
from benchmarks.oracles import compare as oracles, needs, registers
from benchmarks.oracles.compare import OracleCase, ask, failures, judge
from benchmarks.oracles.inference import SMALL, inference, inference_problem, made_up, small_inference
from benchmarks.oracles.networks import DIALECTS, edge_networks, is_common, random_networks, reaches_limits
from benchmarks.oracles.problems import (
    SIGNS,
    DenseConnection,
    Problem,
    Result,
    engine_result,
    read_result,
    write_problem,
)
from benchmarks.oracles.rules import RULES, complement, explain, literal, synapse_weights, truncated
from benchmarks.program import python_of
from lava_vpr import load
from lava_vpr.encoding import encode_traverse
from lava_vpr.engine.general.lif import stored_weights
from lava_vpr.engine.random import image_keys
from lava_vpr.errors import InputError
from lava_vpr.season import table as gain_table
from lava_vpr.traverse import open_traverse

SIMULATORS = list(RULES)
EACH_RULE = [(simulator, rule) for simulator, rules in RULES.items() for rule in rules]


def tampered(result: Result, spike: bool) -> Result:
    """``result`` with one entry changed in the middle of it."""
    spikes, v = result.spikes.copy(), result.v.copy()
    middle = tuple(n // 2 for n in spikes.shape)
    if spike:
        spikes[middle] ^= True
    else:
        v[middle] += 1
    return Result(spikes, v)


@pytest.fixture(scope="module", params=SIMULATORS)
def cases(request: pytest.FixtureRequest) -> tuple[str, list[OracleCase]]:
    """A simulator and a few networks for it."""
    return request.param, oracles.random_cases(request.param, 4) + oracles.inference_cases(request.param, 0)


def test_the_plain_arithmetic_equals_the_engine(cases: tuple[str, list[OracleCase]]) -> None:
    for case in cases[1]:
        assert case.expected.spikes.any()
        assert not literal(case.problem).differs(case.expected)


def test_random_networks_repeat_with_their_seed() -> None:
    one, same, other = (random_networks("brian2-loihi", 1, common=True, seed=seed)[0] for seed in (0, 0, 1))
    assert not one[1].differs(same[1])
    assert one[1].spikes.shape != other[1].spikes.shape or one[1].differs(other[1])


@pytest.mark.parametrize("spike", [True, False])
def test_one_tampered_entry_is_one_difference(cases: tuple[str, list[OracleCase]], spike: bool) -> None:
    simulator, made = cases
    for case in [made[0], made[4], made[-3]]:  # common, beyond, inference
        verdict = judge(case, tampered(case.expected, spike), RULES[simulator])
        assert (verdict.spikes, verdict.membranes) == ((1, 0) if spike else (0, 1))
        assert verdict.rules is None
        assert len(failures([verdict])) == 1


def test_a_difference_in_common_arithmetic_is_never_explained() -> None:
    problem, expected = edge_networks()[0]
    theirs = literal(problem, RULES["nengo-loihi"])
    assert judge(OracleCase("", problem, expected, False), theirs, RULES["nengo-loihi"]).rules
    verdict = judge(OracleCase("", problem, expected, True), theirs, RULES["nengo-loihi"])
    assert verdict.rules is None
    assert failures([verdict]) == ["current of 2^23: 1 spikes and 9 membranes differ in common arithmetic"]


@pytest.fixture(scope="module")
def beyond() -> dict[str, list[tuple[Problem, Result]]]:
    """Networks beyond what is common, a simulator."""
    return {name: random_networks(name, 16, common=False) + edge_networks() for name in SIMULATORS}


@pytest.mark.parametrize(("simulator", "rule"), EACH_RULE)
def test_each_rule_explains_what_it_does_and_nothing_more(
    simulator: str, rule: str, beyond: dict[str, list[tuple[Problem, Result]]]
) -> None:
    others = tuple(r for r in RULES[simulator] if r != rule)
    acted = 0
    for problem, expected in beyond[simulator]:
        theirs = literal(problem, [rule])
        if not theirs.differs(expected):
            continue
        found = explain(problem, theirs, RULES[simulator])
        assert len(found) == 1
        if explain(problem, theirs, others) is None:
            acted += 1
            assert found == (rule,)
            assert explain(problem, tampered(theirs, True), RULES[simulator]) is None
        if acted:
            break
    assert acted > 0


def test_rules_that_act_together_are_all_named(beyond: dict[str, list[tuple[Problem, Result]]]) -> None:
    together = 0
    for problem, _ in beyond["nengo-loihi"]:
        theirs = literal(problem, RULES["nengo-loihi"])
        found = explain(problem, theirs, RULES["nengo-loihi"])
        assert found
        together += len(found) > 1
        for rule in found:
            assert literal(problem, [r for r in found if r != rule]).differs(theirs)
    assert together > 0


@given(st.integers(-(2**40), 2**40), st.integers(1, 24))
@settings(deadline=None, derandomize=True, max_examples=50)
def test_complement_keeps_the_low_bits(x: int, bits: int) -> None:
    y = int(complement(np.array([x], np.int64), bits)[0])
    assert -(1 << bits) <= y < 1 << bits
    assert (x - y) % (2 << bits) == 0


@given(st.integers(-(2**23), 2**23), st.integers(0, 4096))
@settings(deadline=None, derandomize=True, max_examples=50)
def test_truncated_is_towards_zero(x: int, factor: int) -> None:
    assert int(truncated(np.array([x], np.int64), factor)[0]) == int(x * factor / 4096)


@pytest.mark.parametrize("sign", SIGNS)
@pytest.mark.parametrize("bits", range(1, 9))
def test_weights_without_rules_are_the_engines(bits: int, sign: int) -> None:
    low, high = {1: (-256, 255), 2: (0, 255), 3: (-255, 0)}[sign]
    every = np.arange(low, high + 1)[None, :]
    weights, exponent = synapse_weights(DenseConnection(-1, 0, every, bits, -3, sign), frozenset())
    assert exponent == -3
    assert np.array_equal(weights, stored_weights(every, bits, SIGNS[sign]))


@pytest.mark.parametrize("simulator", SIMULATORS)
def test_every_inference_network_is_common_and_all_its_neurons_have_a_part(simulator: str) -> None:
    bias = DIALECTS[simulator].bias
    made = small_inference(bias)
    for problem, expected in made:
        assert is_common(problem, expected, simulator)
        ends = np.cumsum([population.size for population in problem.populations])
        assert all(film.any() for film in np.split(expected.spikes, ends[:-1], axis=2))
        assert problem.populations[0].bias.any() == bias
    sizes = [[population.size for population in problem.populations] for problem, _ in made]
    assert sizes[0] == [12, 1]  # exc and the root
    assert sizes[-2:] == [[1100, 1, 40], [4200, 2, 1, 24]]  # relays of the inputs; two leaves
    signed = {problem.connections[0].sign for problem, _ in made}
    assert [SIGNS[sign] for sign in sorted(signed)] == ["mixed", "excitatory"]


def test_a_weight_of_seven_bits_stands_in_eight() -> None:
    made = next(made for made in SMALL if made.bits == 6)
    network = made_up(made, True)
    rates, keys = np.full((1, network.inputs), 9000, np.uint16), np.ones(1, np.uint64)
    weights = inference_problem("", network, rates, keys).connections[0]
    assert (network.stored_bits, weights.bits) == (7, 8)
    added, exponent = synapse_weights(weights, frozenset())
    assert np.array_equal(added >> -exponent, network.weights)


def test_an_input_that_integrates_a_bias_is_no_problem_of_injected_spikes() -> None:
    network = replace(made_up(next(made for made in SMALL if made.regular), True), bias_input=True)
    with pytest.raises(InputError, match=r"^x: its inputs integrate a bias, .*; set network\.input_mode$"):
        inference_problem("x", network, np.zeros((1, network.inputs), np.uint16), np.ones(1, np.uint64))


def test_biases_of_a_presentation_take_the_place_of_the_networks() -> None:
    made = next(made for made in SMALL if made.signed)
    network, plain = made_up(made, True), made_up(made, False)
    rates, keys = np.full((1, network.inputs), 9000, np.uint16), np.ones(1, np.uint64)
    own = inference("x", network, rates, keys)[1]
    assert not inference("x", plain, rates, keys, network.bias[None])[1].differs(own)
    assert inference("x", plain, rates, keys)[1].differs(own)


def test_queries_under_gains_are_those_that_query_learn_presents(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    teach_quickly(monkeypatch)
    run("query", "m.lvpr", "query", "--learn", "-o", "q.csv", "--gains", "g.lvpg")
    model, table = load("m.lvpr"), gain_table.load("g.lvpg")
    drive = encode_traverse(open_traverse("query"), model.config.encoder)
    shown, epochs = gained(model, drive, 3), table.epoch.tolist()
    under = [query for query, epoch in enumerate(epochs) if epoch]
    chosen = [under[0], under[(len(under) - 1) // 2], under[-1]]
    assert len({epochs[query] for query in chosen}) == 3
    assert np.array_equal(image_keys(shown.seen), table.images[chosen])
    assert np.array_equal(shown.bias, table.bias[chosen])
    assert (shown.rates != shown.seen).any(axis=1).all()


def stand_in(folder: Path, body: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put a script of ours in the place of both simulators."""
    script = folder / "simulator.py"
    script.write_text("import sys, time\nfrom pathlib import Path\nimport numpy as np\n" + body)
    monkeypatch.setattr(oracles, "python_of", lambda _: Path(sys.executable))
    monkeypatch.setattr(oracles, "SCRIPTS", dict.fromkeys(SIMULATORS, script))


SILENT = """
for path in sorted(Path(sys.argv[1]).glob("*.problem.npz")):
    with np.load(path, allow_pickle=False) as p:
        shapes = [(*p["spikes"].shape[:2], size) for size in p["populations"][:, 0]]
    result = {f"spikes_{i}": np.zeros(s, bool) for i, s in enumerate(shapes)}
    result |= {f"v_{i}": np.zeros(s, np.int32) for i, s in enumerate(shapes)}
    np.savez(path.with_name(path.name.replace(".problem.", ".result.")), **result)
"""


def test_a_simulator_that_stays_silent_misses_every_spike(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(tmp_path, SILENT, monkeypatch)
    made = small_inference()[:2]
    for (problem, expected), answer in zip(made, ask("nengo-loihi", [p for p, _ in made]), strict=True):
        verdict = judge(OracleCase("", problem, expected, True), answer, RULES["nengo-loihi"])
        assert verdict.spikes == expected.spikes.sum() > 20
        assert verdict.rules is None


def test_a_simulator_that_fails_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(tmp_path, "raise SystemExit('no such parameter')\n", monkeypatch)
    with pytest.raises(InputError, match=r"^nengo-loihi: no such parameter; delete \S+ and run make oracles$"):
        ask("nengo-loihi", [small_inference()[0][0]])
    stand_in(tmp_path, "time.sleep(60)\n", monkeypatch)
    with pytest.raises(InputError, match=r"^nengo-loihi: not done after 0\.5 s; ask for less$"):
        ask("nengo-loihi", [small_inference()[0][0]], timeout_s=0.5)


def test_a_missing_environment_says_what_to_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program, "ROOT", tmp_path)
    done = CliRunner().invoke(oracles.main, ["--networks", "1", "--queries", "0"])
    assert done.exit_code == 1
    assert done.output.endswith("brian2-loihi: not installed in .venv-brian2-loihi; run make oracles\n")


def test_missing_and_foreign_results_are_errors(tmp_path: Path) -> None:
    problem, expected = edge_networks()[0]
    with pytest.raises(InputError, match=r"^a\.npz: no result of current of 2\^23 .*; run the simulator again$"):
        read_result(tmp_path / "a.npz", problem)
    write_problem(tmp_path / "b.npz", problem)
    with pytest.raises(InputError, match=r"^b\.npz: no result of"):
        read_result(tmp_path / "b.npz", problem)
    np.savez(tmp_path / "c.npz", spikes_0=expected.spikes[:, 1:], v_0=expected.v[:, 1:])
    with pytest.raises(InputError, match=r"^c\.npz: arrays of another shape"):
        read_result(tmp_path / "c.npz", problem)
    np.savez(tmp_path / "d.npz", spikes_0=expected.spikes, v_0=expected.v)
    assert not read_result(tmp_path / "d.npz", problem).differs(expected)


@pytest.mark.quick(2)
@pytest.mark.parametrize("spike", [None, True, False])
def test_the_program_fails_when_one_entry_differs(spike: bool | None, monkeypatch: pytest.MonkeyPatch) -> None:
    def answers(simulator: str, problems: Sequence[Problem]) -> list[Result]:
        made = [literal(problem, RULES[simulator]) for problem in problems]
        return made if spike is None else [tampered(made[0], spike), *made[1:]]

    monkeypatch.setattr(oracles, "ask", answers)
    done = CliRunner().invoke(oracles.main, ["--networks", "2", "--queries", "0", "--only", "nengo-loihi"])
    assert done.exit_code == (0 if spike is None else 1), done.output
    said = "every spike and membrane is equal, or differs by a named rule" in done.output
    assert said is (spike is None)
    if spike is not None:
        assert f"{int(spike)} spikes and {int(not spike)} membranes differ in common arithmetic" in done.output


def test_a_silent_network_or_a_wrong_engine_is_a_failure() -> None:
    problem, expected = edge_networks()[0]
    mute = replace(problem, spikes=np.zeros_like(problem.spikes))
    silent = OracleCase("", mute, engine_result(mute), True)
    assert failures([judge(silent, silent.expected, ())]) == ["current of 2^23: no spike, so nothing was compared"]
    wrong = OracleCase("", problem, tampered(expected, False), True)
    assert failures([judge(wrong, wrong.expected, ())]) == [
        "current of 2^23: the plain arithmetic differs from the engine"
    ]


@pytest.mark.parametrize(
    ("script", "own"),
    [
        (oracles.SCRIPTS["brian2-loihi"], {"brian2", "brian2_loihi"}),
        (oracles.SCRIPTS["nengo-loihi"], {"nengo_loihi"}),
        (registers.SCRIPT, {"nengo_loihi"}),
        (needs.SCRIPT, {"nengo", "nengo_loihi"}),
    ],
    ids=lambda value: getattr(value, "stem", ""),
)
def test_scripts_need_nothing_of_this_project(script: Path, own: set[str]) -> None:
    names = set()
    for node in ast.walk(ast.parse(script.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(str(node.module).split(".")[0])
    assert names - set(sys.stdlib_module_names) == own | {"numpy"}


@pytest.mark.parametrize("simulator", SIMULATORS)
def test_versions_are_pinned(simulator: str) -> None:
    lines = (program.ROOT / "benchmarks" / "oracles" / f"{simulator}.txt").read_text().splitlines()
    pinned = [line for line in lines if not line.startswith("#")]
    assert any(line.startswith(f"{simulator}==") for line in pinned)
    assert all(line.count("==") == 1 for line in pinned)


@pytest.mark.slow
@pytest.mark.parametrize("simulator", SIMULATORS)
def test_the_simulator_agrees_or_differs_by_named_rules(simulator: str) -> None:
    if not (python_of(simulator).parents[1] / ".installed").exists():
        pytest.skip(f"{simulator} is not installed: make oracles")
    verdicts = oracles.compare(simulator, 50, 4 if os.environ.get("LAVA_VPR_DATA") else 0)
    assert failures(verdicts) == []
    common = [v for v in verdicts if v.case.common]
    assert len(common) >= 50
    assert sum(int(v.case.expected.spikes.sum()) for v in common) > 5000
    assert sum(v.spikes + v.membranes for v in common) == 0
    if DIALECTS[simulator].bias:
        assert sum(reaches_limits(v.case.problem, v.case.expected) for v in common) >= 10
    for rule in RULES[simulator]:
        assert any(rule in (v.rules or ()) for v in verdicts), rule
