"""Other people's simulators of Loihi against this project's integers, spike for spike and membrane for membrane.

    python -m benchmarks oracles.compare [--networks N] [--queries N] [--only NAME]      (`make oracles` sets it up)

brian2-loihi and nengo-loihi's emulator each live in an environment of their own; networks and results travel as files.
Where a simulator's arithmetic is ours it has to agree: one spike or membrane that differs is a failure. Where it is
not, every network that differs is given the fewest named rules with which our own arithmetic, written out plainly,
gives exactly what the simulator says; a network without such rules is a failure, too.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import click

from benchmarks.oracles.inference import real_inference, small_inference
from benchmarks.oracles.networks import DIALECTS, edge_networks, is_common, random_networks, reaches_limits
from benchmarks.oracles.problems import Problem, Result, read_result, write_problem
from benchmarks.oracles.rules import RULES, explain, literal
from benchmarks.places import required
from benchmarks.program import Printed, program, python_of, run_elsewhere, verdict
from lava_vpr.show.table import Table
from lava_vpr.storage.writing import temporary_folder

SCRIPTS = {name: Path(__file__).with_name(f"in_{name.replace('-', '_')}.py") for name in RULES}
TIMEOUT_S = 1200
RULE_COLUMNS = ("networks", "spikes", "membranes", "needed in")
LEGEND = (
    "common: no rule of this simulator changes anything in our own arithmetic, so everything has to be equal",
    "at limits: a current wraps or a membrane is clipped; needed in: networks that nothing gives without this rule",
)


@dataclass(frozen=True)
class OracleCase:
    """A network, what our engine makes of it, and whether the simulator has to agree."""

    group: str
    problem: Problem
    expected: Result
    common: bool


@dataclass(frozen=True)
class OracleVerdict:
    """How a simulator's answer compares: entries of the raster and of the membranes that differ, and the fewest rules
    that explain it exactly (None: unexplained)."""

    case: OracleCase
    spikes: int
    membranes: int
    rules: tuple[str, ...] | None


def ask(simulator: str, problems: Sequence[Problem], timeout_s: float = TIMEOUT_S) -> list[Result]:
    """What ``simulator`` makes of ``problems``, in its own environment.

    Raises:
        InputError: it is not installed, fails, or takes too long.
    """
    with temporary_folder() as folder:
        for i, problem in enumerate(problems):
            write_problem(folder / f"{i:04d}.problem.npz", problem)
        python = python_of(simulator)
        run_elsewhere(simulator, python, "oracles", SCRIPTS[simulator], folder, seconds=timeout_s, folder=folder)
        return [read_result(folder / f"{i:04d}.result.npz", problem) for i, problem in enumerate(problems)]


def random_cases(simulator: str, count: int) -> list[OracleCase]:
    """``count`` networks that the simulator has to agree on, and as many beyond.

    Only where the simulator has registers of our width can a network that it agrees on reach their ends.
    """
    limits = 0 if simulator == "brian2-loihi" else max(1, count // 5)
    common = random_networks(simulator, count - limits, common=True)
    common += random_networks(simulator, limits, common=True, limits=True)
    beyond = random_networks(simulator, count, common=False)
    edges = [(*made, is_common(*made, simulator)) for made in edge_networks()]
    return [
        *(OracleCase("random, common arithmetic", *made, True) for made in common),
        *(OracleCase("random, beyond it", *made, False) for made in beyond),
        *(OracleCase(f"edge of the register{'' if made[-1] else ', beyond it'}", *made) for made in edges),
    ]


def inference_cases(simulator: str, queries: int) -> list[OracleCase]:
    """Printed-up inference networks, and the real ones on ``queries`` images; without biases where there are none."""
    bias = DIALECTS[simulator].bias
    made = small_inference(bias) + (real_inference(queries, bias) if queries else [])
    return [
        OracleCase(f"{problem.name}{'' if common else ', beyond it'}", problem, expected, common)
        for problem, expected in made
        for common in [is_common(problem, expected, simulator)]
    ]


def judge(case: OracleCase, theirs: Result, rules: tuple[str, ...]) -> OracleVerdict:
    """Compare, and explain what differs; a difference in common arithmetic stays unexplained."""
    spikes = int((theirs.spikes != case.expected.spikes).sum())
    membranes = int((theirs.v != case.expected.v).sum())
    if not spikes and not membranes:
        return OracleVerdict(case, 0, 0, ())
    return OracleVerdict(case, spikes, membranes, None if case.common else explain(case.problem, theirs, rules))


def group_table(simulator: str, verdicts: Sequence[OracleVerdict]) -> Table:
    """One line a group: what was compared, what differs, how many networks stay unexplained."""
    columns = ("", "networks", "at limits", "spikes", "differ", "membranes", "differ", "unexplained")
    rows = []
    for group in dict.fromkeys(v.case.group for v in verdicts):
        members = [v for v in verdicts if v.case.group == group]
        figures = (
            len(members),
            sum(reaches_limits(v.case.problem, v.case.expected) for v in members),
            sum(int(v.case.expected.spikes.sum()) for v in members),
            sum(v.spikes for v in members),
            sum(v.case.expected.v.size for v in members),
            sum(v.membranes for v in members),
            sum(v.rules is None for v in members),
        )
        rows.append([group, *(f"{figure:,}" for figure in figures)])
    return Table(columns, rows, title=f"{simulator}: spikes and membranes")


def rule_table(simulator: str, verdicts: Sequence[OracleVerdict]) -> Table:
    """What explains the networks that differ, each counted once: by one rule, by several together, or not at all."""
    differing, rows = [v for v in verdicts if v.spikes or v.membranes], []
    single = {rule: [v for v in differing if v.rules == (rule,)] for rule in RULES[simulator]}
    together = {
        "two or more of these together": [v for v in differing if len(v.rules or ()) > 1],
        "unexplained": [v for v in differing if v.rules is None],
    }
    for name, explained in (single | together).items():
        needed = [sum(name in (v.rules or ()) for v in differing)] if name in single else []
        figures = (len(explained), sum(v.spikes for v in explained), sum(v.membranes for v in explained), *needed)
        rows.append([name, *(f"{figure:,}" for figure in figures)])
    title = f"{simulator}: what differs, by the fewest rules that reproduce it"
    return Table(("", *RULE_COLUMNS), rows, LEGEND, title)


def failures(verdicts: Iterable[OracleVerdict]) -> list[str]:
    """What must not be: silent networks, our plain arithmetic apart from the engine, differences without a reason."""
    lines = []
    for v in verdicts:
        if not v.case.expected.spikes.any():
            lines.append(f"{v.case.problem.name}: no spike, so nothing was compared")
        if literal(v.case.problem).differs(v.case.expected):
            lines.append(f"{v.case.problem.name}: the plain arithmetic differs from the engine")
        if v.rules is None:
            where = "in common arithmetic" if v.case.common else "that no rules explain"
            lines.append(f"{v.case.problem.name}: {v.spikes} spikes and {v.membranes} membranes differ {where}")
    return lines


def compare(simulator: str, networks: int, queries: int) -> list[OracleVerdict]:
    """The verdicts on every network that one simulator is asked about."""
    cases = random_cases(simulator, networks) + inference_cases(simulator, queries)
    answers = ask(simulator, [case.problem for case in cases])
    return [judge(case, answer, RULES[simulator]) for case, answer in zip(cases, answers, strict=True)]


@program()
@click.option("--networks", default=50, show_default=True, help="Random networks within common arithmetic, and beyond.")
@click.option("--queries", default=8, show_default=True, help="Real queries, if LAVA_VPR_DATA names the images.")
@click.option("--only", type=click.Choice(list(RULES)), help="One simulator.")
def main(networks: int, queries: int, only: str | None) -> Printed:
    """Hold this project's integers against other simulators of Loihi."""
    if queries and not os.environ.get("LAVA_VPR_DATA"):
        yield "no real queries: LAVA_VPR_DATA does not name the images"
        queries = 0
    if queries:
        required("nordland")
    failed = []
    for simulator in [only] if only else list(RULES):
        verdicts = compare(simulator, networks, queries)
        yield group_table(simulator, verdicts)
        yield rule_table(simulator, verdicts)
        failed += [f"{simulator}, {line}" for line in failures(verdicts)]
        yield f"{simulator}: {len(verdicts)} networks"
    yield from verdict(failed, "every spike and membrane is equal, or differs by a named rule")
