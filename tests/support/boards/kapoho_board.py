"""Small bundles for Kapoho Bay, and their program run against the stand-in for NxSDK: in this process, or as a child.

Used by bench and deploy.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.boards import host_programs
from support.boards.host_programs import Made, write_bundle
from support.boards.plans import LOAD
from support.common import children

from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.boards.plan import CorePlan, Needs, Plan, PopulationName, PopulationPart
from lava_vpr.deploy.bundle import core_files, folder as bundle
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.random import presentation_keys
from lava_vpr.loihi import HOST_SPIKES

STANDIN = Path(__file__).parents[1] / "standins" / "kapoho_bay"
ASKED = ["rows without indices", "rows with indices, of discrete axons", "weights of fewer than 8 bits"]
"""Kinds of unproven values of registers that bundles may have; the stand-in takes them where a test says so."""
SEEDS = {"KAPOHOBAY": "1", "PYTHONPATH": str(STANDIN), "PYTHONDONTWRITEBYTECODE": "1"}
SEEDS |= {"STANDIN": json.dumps({"asked": ASKED})}


def set_everywhere(modules: Any, **values: Any) -> None:
    """Set a name in every module that has it, wherever it came from."""
    for name, value in values.items():
        known = [module for module in vars(modules).values() if isinstance(module, ModuleType)]
        owners = [module for module in known if hasattr(module, name)]
        assert owners, name
        for module in owners:
            setattr(module, name, value)


@dataclass(frozen=True)
class Ended:
    """How the program ended."""

    code: int
    out: str
    err: str


class Looks:
    """In place of the module time: a clock that goes on only while the program waits for a chip."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        """Seconds slept."""
        return self.now

    def sleep(self, seconds: float) -> None:
        """Let others work."""
        self.now += seconds
        time.sleep(seconds)


@dataclass(frozen=True)
class Board:
    """The program and the stand-in's faults, in this process."""

    program: Any  # its modules
    faults: Any
    capsys: pytest.CaptureFixture[str]

    def run(self, made: Made, *words: object, **faults: Any) -> Ended:
        """The program of a bundle, with faults."""
        self.program.run.__file__ = str(made.path / "program" / "run.py")
        self.faults.choose(**{"asked": ASKED, **faults})
        os.environ["STANDIN"] = json.dumps({"asked": ASKED, **faults})  # of the ladder's child
        self.capsys.readouterr()
        code = self.program.run.main([str(word) for word in words])
        text = self.capsys.readouterr()
        return Ended(code, text.out, text.err)


def load_program(folder: Path) -> Any:
    """The modules of a program, by name."""
    modules = host_programs.load(folder)
    # In this process no watchdog may bite, and time is counted in looks at a channel, however slow the machine is.
    set_everywhere(modules, PAUSE=0.0, time=Looks(), Watchdog=lambda *_: Unwatched())
    return modules


class Unwatched(contextlib.nullcontext[None]):
    """In place of the watchdog."""

    let_go = None


@pytest.fixture(scope="session")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program in one folder; never written to."""
    return host_programs.flat("kapoho_bay", tmp_path_factory.mktemp("flat") / "program")


@pytest.fixture(scope="session", autouse=True)
def _objects(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The stand-in's part of embedded programs is compiled once for all of them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STANDIN_OBJECTS", str(tmp_path_factory.mktemp("objects")))
        yield


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, flat: Path) -> Any:
    """See `Board`; NxSDK's stand-in is forgotten afterwards."""
    monkeypatch.syspath_prepend(str(STANDIN))
    monkeypatch.setenv("KAPOHOBAY", "1")
    monkeypatch.setenv("PYTHONPATH", str(STANDIN))
    monkeypatch.setenv("STANDIN", "{}")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    handler = signal.getsignal(signal.SIGTERM)
    from nxsdk_standin.faults import FAULTS  # the stand-in is on the path only here

    yield Board(load_program(flat), FAULTS, capsys)
    signal.signal(signal.SIGTERM, handler)
    for name in [name for name in sys.modules if name.split(".")[0] in ("nxsdk", "nxsdk_standin")]:
        del sys.modules[name]


def start(made: Made, *words: object, before: str = "", env: dict[str, str] | None = None, **faults: Any) -> Any:
    """The program as a child; ``before`` is Python that changes its modules first."""
    script = str(made.path / "program" / "run.py")
    command = [sys.executable, script]
    if before:
        found = "import os, sys; sys.path.insert(0, os.path.dirname(sys.argv[1]))"
        ran = f"import run, board_device, board_link; {before}; sys.exit(run.main(sys.argv[2:]))"
        command = [sys.executable, "-c", f"{found}; {ran}", script]
    given = os.environ | (SEEDS if env is None else env)
    given |= {"STANDIN": json.dumps({"asked": ASKED, **faults}), "TMPDIR": str(made.path.parent)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return children.Child([*command, *map(str, words)], env=given, text=True, **pipes)


def child(made: Made, *words: object, **given: Any) -> Ended:
    """`start`, and wait."""
    running = start(made, *words, **given)
    out, err = running.communicate(timeout=60)
    return Ended(running.returncode, out, err)


def edited(board: Board, made: Made, name: str, old: str, new: str) -> Board:
    """A board with the program of a bundle, in whose file ``name`` the text ``old`` is ``new``."""
    altered(made, f"program/{name}", lambda content: content.replace(old.encode(), new.encode()))
    return replace(board, program=load_program(made.path / "program"))


def altered(made: Made, name: str, change: Callable[[bytes], bytes]) -> None:
    """Change a file of a bundle and seal it again, as if it had been deployed so."""
    old = bundle.load(made.path)
    content = change(old.files[name])
    assert content != old.files[name]
    bundle.write(made.path, {k: old.manifest[k] for k in ("target", "network", "limits")}, {**old.files, name: content})


def random_network(seed: int = 0, inputs: int = 30, neurons: int = 10, **changes: Any) -> FixedNetwork:
    """A network that spikes, with biases; a third of its weights are 0, a quarter of those of a signed one below."""
    rng = np.random.default_rng(seed)
    weights = rng.integers(1, 8, (inputs, neurons)) * (rng.random((inputs, neurons)) < 0.67)
    if changes.get("signed"):
        weights *= rng.choice([-1, 1, 1, 1], weights.shape)
    settings = {"bits": 3, "signed": False, "threshold": 90, "inhibition": 12, "inhibition_exponent": 0, "decay": 137}
    bias = rng.integers(-4095, 100, neurons).astype(np.int32) >> 4
    return FixedNetwork(weights.astype(np.int16), bias, **{**settings, "steps": 40, **changes})  # type: ignore[arg-type]


Place = tuple[PopulationName, int, int]
"""A population, its first neuron on a core, and how many."""


def with_counters(members: list[Place]) -> list[PopulationPart]:
    """The parts of a core whose excitatory neurons have their counters behind them."""
    parts, compartment = [], 0
    for population, first, size in members:
        for name in ("exc", "counters") if population == "exc" else (population,):
            parts.append(PopulationPart(name, first, size, compartment))  # type: ignore[arg-type]
            compartment += size
    return parts


def plan_by_hand(network: FixedNetwork, cores: dict[tuple[int, int], list[Place]], dense: float = 0.5) -> Plan:
    """Neurons where ``cores`` (chip, core) says, counters behind them; a part ``dense`` of the inputs' rows."""
    made = []
    for (chip, core), members in cores.items():
        parts = with_counters(members)
        compartment = sum(part.size for part in parts)
        rows = np.arange(network.inputs) % 8 < 8 * dense
        needs = Needs(compartment, None, None, None, None, None, None)
        made.append(CorePlan(chip, core, tuple(parts), rows, needs, LOAD))
    bits = network.inhibition.bit_length() + 1
    return Plan(network, KAPOHO_BAY, tuple(made), KAPOHO_BAY.stored_bits(network), bits, None, 0.0)


LAYOUTS: dict[str, dict[tuple[int, int], list[Place]]] = {
    "one core": {(0, 0): [("exc", 0, 10), ("inh", 0, 1), ("inputs", 0, 30)]},
    "two chips": {
        (0, 0): [("exc", 0, 4), ("inputs", 0, 9)],
        (0, 3): [("exc", 4, 1), ("inh", 0, 1), ("inputs", 9, 8)],
        (1, 1): [("exc", 5, 5), ("inputs", 17, 13)],
    },
    "apart": {(0, 1): [("exc", 0, 6)], (0, 2): [("exc", 6, 4)], (1, 0): [("inh", 0, 1)], (1, 5): [("inputs", 0, 30)]},
    "leaves": {
        (0, 1): [("exc", 0, 6), ("inh", 2, 2)],
        (0, 2): [("exc", 6, 4), ("inputs", 10, 20)],
        (1, 0): [("inh", 0, 2), ("inputs", 0, 10)],
    },
}
"""Ways to spread 10 neurons and 30 inputs; "apart" has a chip without exc, "leaves" is for three leaves and a root."""


def layout(name: str, network: FixedNetwork, dense: float = 0.5) -> Plan:
    """`LAYOUTS`, without input compartments where there are none."""
    cores = {
        core: [member for member in members if network.input_compartments or member[0] != "inputs"]
        for core, members in LAYOUTS[name].items()
    }
    return plan_by_hand(network, {core: members for core, members in cores.items() if members}, dense)


def make(
    folder: Path,
    plan: Plan,
    images: int = 5,
    traverses: int = 1,
    seed: int = 0,
    front_end: Mapping[str, bytes] | None = None,
) -> Made:
    """Write the bundle of ``plan``, and files of a front end, with ``images`` random references of each of
    ``traverses``."""
    n, inputs = images * traverses, plan.network.inputs
    rates = (np.random.default_rng(seed + 1).random((n, inputs)) ** 3 * 20000).astype(np.uint16)
    shown, labels = (rates, presentation_keys(seed, "response", np.arange(n))), np.tile(np.arange(images), traverses)
    limits = {"host_spikes": HOST_SPIKES}
    files = {**core_files.network_files(plan), **(front_end or {})}
    return write_bundle(folder / "bundle", "kapoho-bay", plan.network, files, shown, labels, limits=limits)


def climb_here(board: Board, made: Made, *names: str, **faults: Any) -> dict[str, Any]:
    """Climb to the rungs ``names``, all if none, in this process, where a chip is not waited for in real time."""
    program = board.program
    options = program.command_line.parsed(program.command_line.parser(""), ["--ladder", "", "--timeout", "3"])
    host = program.run.KapohoBay(program.bundle_files.Bundle(str(made.path), "kapoho-bay"), options)
    rows = program.ladder.rows_of(host.plain() + host.further(), (host.network.steps, host.network.silent))
    board.faults.choose(**{"asked": ASKED, **faults})
    wanted = [row for row in rows if not names or row["name"] in names]
    return dict(program.ladder.climb(wanted, host.attempt, host.ways, frozenset()))
