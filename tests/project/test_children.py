"""Programs that tests start, all in one place: with default signals whatever the tests run with, none for ever."""

from __future__ import annotations

import ast
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support.common import children

ROOT = Path(__file__).resolve().parents[2]
ONE_PLACE = "tests/support/common/children.py"
ELSEWHERE = {
    "tests/golden/running.py": "forks the cases of the golden files, each ended by an alarm",
    "tests/support/lava/lava_targets.py": "runs as a child of run_isolated, which ends what it leaves",
    "tests/support/lava/copies.py": "forks workers of run_isolated, which ends them, as their caller does",
}
"""Files that start processes in another way, and why they may."""
STANDINS = "tests/support/standins/"
"""No tests: they wait as the vendor's library does, in programs that tests start."""

STARTS = {
    "subprocess": {"run", "Popen", "call", "check_call", "check_output", "getoutput", "getstatusoutput"},
    "os": {
        "system",
        "popen",
        "fork",
        "forkpty",
        "posix_spawn",
        "posix_spawnp",
        "spawnv",
        "spawnl",
        "spawnve",
        "spawnvp",
    },
    "pty": {"spawn", "fork"},
}
"""Functions that start a program, by module."""


def endless(path: str, source: str) -> list[str]:
    """The places of ``source`` that start a program, or wait for one or for a thread, without a limit of time."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and any(
            name.name in STARTS.get(node.module or "", ()) for name in node.names
        ):
            found.append(f"{path}:{node.lineno}: {ast.unparse(node)}")
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        name = node.func.attr
        if name not in {"wait", "join"}.union(*STARTS.values()):
            continue
        owner = ast.unparse(node.func.value)
        limited = any(word.arg == "timeout" for word in node.keywords)
        waits = name in ("wait", "join") and not node.args and not path.startswith(STANDINS)
        starts = name in STARTS.get(owner, ()) and path not in (ONE_PLACE, *ELSEWHERE)
        if (waits and not limited) or (starts and not (limited and path.startswith(STANDINS))):
            found.append(f"{path}:{node.lineno}: {owner}.{name}")
    return found


def test_whatever_tests_start_and_wait_for_has_a_limit_of_time() -> None:
    files = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py")}
    assert {ONE_PLACE, *ELSEWHERE} <= set(files)
    assert [line for path, source in files.items() for line in endless(path, source)] == []


@pytest.mark.parametrize(
    "line",
    [
        "from subprocess import run",
        "subprocess.run(['true'], timeout=3)",
        "subprocess.Popen(['true'])",
        "os.system('true')",
        "os.fork()",
        "child.wait()",
        "thread.join()",
    ],
)
def test_what_has_no_limit_is_found(line: str) -> None:
    assert len(endless("tests/cli/test_any.py", f"def test() -> None:\n    {line}\n")) == 1
    assert endless("tests/cli/test_any.py", "', '.join(x); child.wait(3); thread.join(timeout=3)") == []
    assert len(endless(f"{STANDINS}any.py", "subprocess.run(['true'], timeout=3); subprocess.run(['true'])")) == 1


@pytest.mark.quick(1)
@pytest.mark.parametrize("then", ["sleep 600", "true"])
def test_nothing_is_left_of_a_child_that_takes_too_long(then: str) -> None:
    """Neither of one that still runs nor of one that has ended, whose own child holds the pipe."""
    with pytest.raises(subprocess.TimeoutExpired) as caught:
        children.run(["sh", "-c", f"sleep 600 & echo $!; {then}"], stdout=subprocess.PIPE, timeout=1)
    pid = int(caught.value.stdout)
    assert children.until(lambda: children.gone(pid), 10)


def test_a_child_ends_with_its_block_its_test_and_the_tests() -> None:
    with children.Child(["sleep", "600"]) as first:
        assert first.poll() is None
    with children.ended():
        second = children.Child(["sleep", "600"])
        assert second.poll() is None
    assert first.returncode == second.returncode == -signal.SIGKILL
    assert not {first, second} & children.STARTED
    code = "from support.common import children as c; print(c.Child(['sleep', '600']).pid, flush=True); input()"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with children.Child(
        [sys.executable, "-c", code], env=os.environ | {"PYTHONPATH": "tests"}, cwd=ROOT, **pipes
    ) as tests:
        pid = int(tests.stdout.readline())
        tests.kill()
    assert children.until(lambda: children.gone(pid), 10)


SIGNALS = (*children.ASKED, signal.SIGPIPE)


@pytest.mark.parametrize("number", SIGNALS)
def test_children_have_default_signals(number: int) -> None:
    words = ["grep", "-E", "^Sig(Blk|Ign):", "/proc/self/status"]
    for line in children.run(words, stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines():
        name, mask = line.split()
        assert not int(mask, 16) >> (number - 1) & 1, name


def deaf() -> None:
    """Ignore and block the signals."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)


@pytest.mark.slow
def test_children_have_default_signals_whatever_the_tests_were_started_with() -> None:
    name = f"{Path(__file__).relative_to(ROOT)}::{test_children_have_default_signals.__name__}"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", name]
    done = children.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, preexec_fn=deaf)
    assert f"{len(SIGNALS)} passed" in done.stdout, done.stdout
