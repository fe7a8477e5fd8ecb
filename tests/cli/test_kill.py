"""A training that is killed, or stopped with Ctrl-C, goes on from its checkpoint to the bit-identical model."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from support.common import children
from support.common.imagefiles import write_images

from lava_vpr.cli import main
from lava_vpr.storage import container

DEADLINE = 240.0  # seconds; reached only when something hangs

# The command line as it is, but with checkpoints argv[1] seconds apart, a line and a short rest after every epoch (so
# that few epochs suffice to be killed in time, however busy the machine is), and a write of number argv[2] that never
# ends.
TALKING = """
import os, sys, time
from lava_vpr.training import loop as training
from lava_vpr.cli import main
training.train.__kwdefaults__["interval"] = float(sys.argv.pop(1))
hang, writes, flush = int(sys.argv.pop(1)), [0], os.fsync
def fsync(handle):
    writes[0] += 1
    if writes[0] == hang:
        os.write(1, b"writing\\n")
        time.sleep(3600)
    flush(handle)
os.fsync = fsync
note = training.Checkpoint.update
def update(self, number, epoch, state):
    note(self, number, epoch, state)
    os.write(1, b"epoch %d\\n" % epoch)
    time.sleep(0.05)
training.Checkpoint.update = update
main(prog_name="lava-vpr")
"""


def run(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def start(here: Path, program: list[str], options: list[str]) -> children.Child:
    """``lava-vpr train`` in a process of its own."""
    return children.Child(
        [sys.executable, *program, "train", "ref", "-o", "m.lvpr", *options],
        cwd=here,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for(what: Callable[[], bool], process: children.Child) -> None:
    """Until ``what`` is so; the process must still be at work."""
    assert children.until(lambda: what() or process.poll() is not None, DEADLINE), "nothing happens"
    assert process.poll() is None, f"ended with {process.returncode} too soon: {process.communicate()}"


def epochs_done(checkpoint: Path) -> int:
    header, _ = container.load(checkpoint, "checkpoint")
    return int(sum(header["epochs"].values()))


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with images."""
    write_images(tmp_path / "ref", 8)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def unbroken(options: list[str]) -> bytes:
    assert run("train", "ref", "-o", "whole.lvpr", *options).exit_code == 0
    return Path("whole.lvpr").read_bytes()


@pytest.mark.slow
def test_killed_again_and_again(here: Path) -> None:
    """SIGKILL while it learns, in the middle of writing a checkpoint, and again; then to the end."""
    options = ["--epochs", "100", "--stretch", "4", "--jobs", "2"]
    checkpoint = here / "m.lvpr.checkpoint"
    known = 0
    for attempt in range(3):
        writing = attempt == 1
        program = ["-c", TALKING, "0", "4" if writing else "0"]
        process = start(here, program, [*options, *(["--resume"] if attempt else [])])
        assert process.stdout is not None
        if writing:
            while (line := process.stdout.readline()) != "writing\n":
                assert line.startswith("epoch")
        else:
            for _ in range(3):  # not before it has come further than the one before
                assert process.stdout.readline().startswith("epoch")
        process.kill()
        process.communicate()
        assert process.returncode == -signal.SIGKILL
        assert not (here / "m.lvpr").exists()
        done = epochs_done(checkpoint)  # whole, whenever the process died
        assert known < done < 2 * 100
        known = done
    # Without --resume it is not thrown away, and with other options not taken for this training's.
    refused = run("train", "ref", "-o", "m.lvpr", *options)
    assert refused.exit_code == 1
    assert "m.lvpr.checkpoint: an interrupted training can go on from here; add --resume" in refused.stderr
    refused = run("train", "ref", "-o", "m.lvpr", *options, "--seed", 1, "--resume")
    assert refused.exit_code == 1
    assert "m.lvpr.checkpoint: was made with other options or images; repeat the original command" in refused.stderr
    assert epochs_done(checkpoint) == known
    resumed = run("train", "ref", "-o", "m.lvpr", *options, "--resume")
    assert resumed.exit_code == 0
    assert resumed.stderr.startswith("resuming from m.lvpr.checkpoint; epochs done: stretch ")
    assert not checkpoint.exists()
    assert (here / "m.lvpr").read_bytes() == unbroken(options)


def test_ctrl_c_keeps_what_was_learned(here: Path) -> None:
    """Also when it is not yet time to write the next checkpoint."""
    options = ["--epochs", "100", "--jobs", "2"]
    process = start(here, ["-c", TALKING, "1e9", "0"], options)
    assert process.stdout is not None
    assert process.stdout.readline() == "epoch 1\n"
    assert not (here / "m.lvpr.checkpoint").exists()
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=DEADLINE)
    assert process.returncode == 1
    assert errors.split("\n\n") == [
        "progress is kept in m.lvpr.checkpoint; go on with --resume",
        "Aborted!\n",
    ]
    assert not (here / "m.lvpr").exists()
    assert 1 <= epochs_done(here / "m.lvpr.checkpoint") < 100
    assert sorted(p.name for p in here.iterdir()) == ["m.lvpr.checkpoint", "ref"]
    assert run("train", "ref", "-o", "m.lvpr", *options, "--resume").exit_code == 0
    assert not (here / "m.lvpr.checkpoint").exists()
    assert (here / "m.lvpr").read_bytes() == unbroken(options)


@pytest.mark.slow
def test_killed_as_it_is(here: Path) -> None:
    """The same with the command itself and its own rhythm of checkpoints."""
    options = ["--epochs", "3000", "--jobs", "1"]
    process = start(here, ["-m", "lava_vpr"], options)
    wait_for((here / "m.lvpr.checkpoint").exists, process)
    process.kill()
    assert process.communicate() == ("", "")
    assert process.returncode == -signal.SIGKILL
    assert 1 <= epochs_done(here / "m.lvpr.checkpoint") < 3000
    assert run("train", "ref", "-o", "m.lvpr", *options, "--resume").exit_code == 0
    assert not (here / "m.lvpr.checkpoint").exists()
    assert (here / "m.lvpr").read_bytes() == unbroken(options)
