"""What takes long names itself on a terminal before it begins, kernels being compiled too; a pipe is told nothing."""

from __future__ import annotations

import importlib
import os
import subprocess
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from numba.core.caching import FunctionCache
from support.common import children
from support.common.commands import opened

from lava_vpr import kernelcache
from lava_vpr.cli import common, main
from lava_vpr.deploy.mapping import largest_map
from lava_vpr.deploy.mapping.largest_map import Capacity
from lava_vpr.kernelcache import COMPILING, COMPILING_TEXT, compiled

ROOT = Path(__file__).resolve().parents[3]


STAGES = [
    ("eval m.lvpr query", "lava_vpr.cli.evaluate:recognise", "recognising 8 images"),
    ("eval m.lvpr query --report r", "lava_vpr.report.build:report_data", "writing the report"),
    ("query m.lvpr query", "lava_vpr.cli.query:answer_stream", "reading query"),
    ("train reference -o n.lvpr --config quick.toml", "lava_vpr.learning.route:train_encoded", "learning"),
    (
        "train reference -o n.lvpr --config quick.toml",
        "lava_vpr.learning.route:calibrated",
        "calibrating probabilities",
    ),
    ("extend m.lvpr query -o n.lvpr", "lava_vpr.maps:extend", "learning"),
    ("remove m.lvpr 1 -o n.lvpr", "lava_vpr.maps:remove", "joining what is left of 8 places"),
    ("remove m.lvpr 1 -o n.lvpr", "lava_vpr.cli.models.commands:calibrated", "calibrating probabilities"),
    ("fit m.lvpr --target kapoho-bay", "lava_vpr.deploy.bundle.deployment:plan_of", "placing 8 neurons"),
    ("deploy m.lvpr --target loihi2 -o b", "lava_vpr.cli.deploy:for_board", "measuring the network for the board"),
    ("deploy m.lvpr --target loihi2 -o b", "lava_vpr.cli.deploy:write_bundle", "placing 8 neurons"),
    ("export m.lvpr -o n.nir", "lava_vpr.exchange.nir_writing:graph_of", "writing n.nir"),
    ("synth s --places 2", "lava_vpr.synthetic.world:render", "drawing"),
    (
        "study steps reference --query query --config quick.toml --values 64 --seeds 0",
        "lava_vpr.cli.study:study_rows",
        "study",
    ),
    (
        "study steps reference --query query --config quick.toml --values 64 --seeds 0 --report r",
        "lava_vpr.cli.outputs:write_page",
        "writing the report",
    ),
]


@pytest.mark.parametrize(("command", "work", "text"), STAGES, ids=[f"{c.split()[0]} {w}" for c, w, _ in STAGES])
def test_a_stage_names_itself_before_it_begins(
    command: str, work: str, text: str, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = opened(monkeypatch)
    before: list[str] = []
    module, _, name = work.partition(":")
    real = getattr(importlib.import_module(module), name)

    def seen(*args: Any, **options: Any) -> Any:
        before.append(terminal.said)
        return real(*args, **options)

    monkeypatch.setattr(importlib.import_module(module), name, seen)
    main.main(args=command.split(), standalone_mode=False)
    assert before, f"{work} was not called"
    assert text in before[0]
    assert f"loading {command.split()[0]}" in before[0]


def test_the_search_for_the_largest_map_tells_of_each(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = opened(monkeypatch)
    before: list[str] = []

    def largest(config: Any, board: Any, rows: Any, weights: Any) -> Capacity:
        before.append(terminal.said)
        return Capacity(config.network.weight_bits, rows, weights, 0.5, 40 + len(before), 40, 1, "made up")

    monkeypatch.setattr(largest_map, "largest", largest)
    main.main(args=["fit", "--target", "kapoho-bay"], standalone_mode=False)
    assert "looking for the largest maps" in before[0]
    assert "0/28" in before[0]  # seven widths, two ways of counting rows, two networks
    assert len(before) == 28
    assert "28/28" in terminal.said
    assert "7 bits, rows dense, weights every: 68 places" in terminal.said


def test_a_bar_and_a_stage_say_that_kernels_are_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = opened(monkeypatch)
    with common.stage("doing this"):
        kernelcache._tell(True)
        kernelcache._tell(True)  # one within the other
        kernelcache._tell(False)
    assert f"doing this: {COMPILING_TEXT}" in terminal.said
    kernelcache._tell(False)
    with common.progress_bar("a bar", 2) as advance:
        kernelcache._tell(True)
        advance(1, "")
        kernelcache._tell(False)
        with common.stage("within"):
            pass
    bar = terminal.said.partition("a bar")[2]
    assert COMPILING_TEXT in bar
    assert COMPILING == []


def test_a_kernel_tells_when_it_is_compiled_and_not_when_it_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FunctionCache, "load_overload", lambda *_: None)
    monkeypatch.setattr(FunctionCache, "save_overload", lambda *_: None)
    told: list[bool] = []
    COMPILING.append(told.append)
    try:
        kernel: Callable[[int], int] = compiled()(_double)
        assert kernel(2) == 4
        assert told == [True, False]
        assert kernel(3) == 6
        assert told == [True, False]
    finally:
        COMPILING.remove(told.append)


def _double(x: int) -> int:
    return 2 * x


def test_a_bar_within_a_stage_takes_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Work that a stage names may have a bar of its own, as it has where a cluster does it."""
    terminal = opened(monkeypatch)
    with common.stage("the whole"):
        with common.progress_bar("a part", 2) as advance:
            advance(2, "")
        done = len(terminal.said)
        with common.stage("the end"):
            pass
    assert "a part" in terminal.said
    assert "the whole: the end" in terminal.said[done:]
    with ExitStack() as later:
        with common.stage("first"):
            later.enter_context(common.progress_bar("longer", 1))
    assert common._SHOWN == []


def test_a_failure_leaves_no_stage_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    opened(monkeypatch)
    with pytest.raises(ValueError, match="broken"), common.stage("doing this"):
        raise ValueError("broken")
    with pytest.raises(ValueError, match="broken"), common.progress_bar("bar", 1), common.stage("within"):
        raise ValueError("broken")
    assert common._SHOWN == []
    assert COMPILING == []


def test_a_pipe_is_told_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with common.stage("doing this"), common.progress_bar("bar", 1) as advance:
        kernelcache._tell(True)
        advance(1, "done")
        kernelcache._tell(False)
    assert capsys.readouterr() == ("", "")


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="there are no pseudo-terminals")
def test_make_shows_what_it_installs_on_a_terminal() -> None:
    ours, theirs = os.openpty()
    try:
        words = ["make", "-n", "VENV=nowhere", "demo"]
        at_terminal, in_pipe = (
            children.run(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=stderr, check=True, text=True).stdout
            for stderr in (theirs, subprocess.PIPE)
        )
    finally:
        os.close(theirs)
        os.close(ours)
    assert "pip install --quiet" in in_pipe
    assert "pip install" in at_terminal
    assert "--quiet" not in at_terminal
