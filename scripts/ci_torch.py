"""What needs torch, run apart from CI: python scripts/ci_torch.py [--log FILE] (`make ci-torch`); 1 if a step fails.

Each step is a command in the environment of this interpreter. The log says when, on which commit, from which sources
and with which versions it ran, what every step printed last and how it ended; it is written in one step, and also if a
step fails. Run it on a committed tree, with real images (LAVA_VPR_DATA), and commit the log. Paths of the machine are
left out of it. With ``--since`` nothing runs: the commit of the log is named, and what has changed since.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import importlib.metadata
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from lava_vpr.isolated.child import Ended, run_child
from lava_vpr.storage.writing import write_atomically

ROOT = Path(__file__).resolve().parents[1]
LOG = ROOT / "docs" / "logs" / "ci-torch.log"
PACKAGES = ("torch", "torchvision", "lava-dl", "lava-nc", "snntorch", "nirtorch", "nir", "neurobench", "numpy")
SOURCES = (
    "lava_vpr/slayer",
    "lava_vpr/exchange",
    "lava_vpr/bench/measure/workload.py",
    "benchmarks/exchange",
    "benchmarks/neurobench",
    "tests/exchange",
    "tests/training",
    "tests/bench/test_workload.py",
)
"""What needs torch, snnTorch or NeuroBench, and its tests: the sources whose hash the log has."""
UNKNOWN = "unknown"
IMAGES = "LAVA_VPR_DATA"
PASSED, FAILED = "passed", "failed"
_COUNTS = re.compile(r"^(\d+ \w+.*) in [\d.]+s", re.MULTILINE)
"""What a quiet pytest prints last, as in ``3 passed, 1 skipped in 2.50s``."""


class Step(NamedTuple):
    """A command whose exit code is reported.

    Attributes:
        name: What it shows.
        words: What follows the interpreter.
        lines: How many of its last lines the log keeps.
        seconds: What it may take.
    """

    name: str
    words: tuple[str, ...]
    lines: int = 25
    seconds: float = 3600


class StepOutcome(NamedTuple):
    """How a step ended.

    Attributes:
        step: Which.
        result: ``passed`` or ``failed``.
        why: What else is to be said of that, in a few words; may be empty.
        said: Its last lines.
        seconds: What it took.
    """

    step: Step
    result: str
    why: str = ""
    said: str = ""
    seconds: float = 0.0


def _pytest(*words: str) -> tuple[str, ...]:
    return ("-m", "pytest", "--quiet", "--timeout", "1800", *words)


STEPS = (
    Step(
        "Learning by SLAYER and NetX, with lava-dl",
        _pytest("tests/training", "tests/exchange", "-k", "slayer or netx"),
    ),
    Step("Exported NIR graphs in snnTorch", ("-m", "benchmarks.exchange.compare"), lines=40),
    Step("Our metrics beside NeuroBench's", ("-m", "benchmarks.neurobench.metrics"), lines=200),
    Step(
        "Our metrics beside NeuroBench's, on small networks",
        _pytest("tests/bench/test_workload.py", "-k", "equal_those_of_the_package"),
    ),
)


def judged(step: Step, ended: Ended) -> tuple[str, str]:
    """The result of a step, and why: a run of pytest that skips is no proof."""
    if ended.code:
        return FAILED, f"exit code {ended.code}"
    if "pytest" not in step.words:
        return PASSED, ""
    lines = _COUNTS.findall(ended.out)
    counts = {word: int(number) for number, word in re.findall(r"(\d+) (\w+)", lines[-1])} if lines else {}
    if not counts.get("passed"):
        return FAILED, "no test ran"
    if counts.get("skipped"):
        return FAILED, "tests were skipped although the images are there"
    return PASSED, ""


def run_step(step: Step) -> StepOutcome:
    """Run a step to its end."""
    started = time.perf_counter()
    try:
        ended = run_child([sys.executable, *step.words], seconds=step.seconds, folder=ROOT)
    except subprocess.TimeoutExpired:
        return StepOutcome(step, FAILED, f"took more than {step.seconds:.0f} s", "", time.perf_counter() - started)
    result, why = judged(step, ended)
    text = ended.out.rstrip() + (f"\n{ended.err.rstrip()}" if ended.code else "")
    said = "\n".join(line.rstrip() for line in text.splitlines()[-step.lines :])
    return StepOutcome(step, result, why, said, time.perf_counter() - started)


def git(*words: str) -> str | None:
    """What git says of this tree; None if it cannot say."""
    try:
        done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def state(log: Path) -> tuple[str, bool]:
    """The commit of the tree, `UNKNOWN` without one, and whether nothing but ``log`` differs from it."""
    log = log.resolve()
    inside = [f":(exclude){log.relative_to(ROOT)}"] if log.is_relative_to(ROOT) else []
    return git("rev-parse", "HEAD") or UNKNOWN, git("status", "--porcelain", "--", ".", *inside) == ""


def sources(commit: str) -> str:
    """A hash of the names and contents of `SOURCES` at a commit, 16 digits; `UNKNOWN` if git does not know it."""
    listed = git("ls-tree", "-r", "--full-tree", commit, "--", *SOURCES)
    return UNKNOWN if listed is None else hashlib.sha256(listed.encode()).hexdigest()[:16]


def since(log: Path) -> str:
    """A sentence: the commit and sources of a log, and which of the `SOURCES` have changed since, committed or not."""
    text = log.read_text(encoding="utf-8") if log.is_file() else ""
    said = dict(re.findall(r"^(commit|sources): +(\w+)", text, re.MULTILINE))
    if len(said) < 2:
        raise SystemExit(f"{log}: no log of this script, which names a commit and sources; run `make ci-torch`")
    changed = git("diff", "--name-only", said["commit"], "--", *SOURCES)
    if changed is None:  # a commit that this clone does not have
        what = "those of HEAD" if sources("HEAD") == said["sources"] else "not those of HEAD"
    else:
        what = f"since changed: {', '.join(changed.split())}" if changed else "as they are today"
    return f"{os.path.relpath(log)}: commit {said['commit'][:7]}, sources {said['sources']}, {what}"


def versions() -> dict[str, str]:
    """The versions of what the steps need; ``none`` of what is not installed."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "none"
    return found


def without_paths(text: str) -> str:
    """A text in which no path of this machine stands."""
    names = {str(ROOT): ".", tempfile.gettempdir(): "$TMPDIR", str(Path.home()): "~", sys.base_prefix: "$PYTHON"}
    if os.environ.get(IMAGES):
        names[os.environ[IMAGES].rstrip("/")] = f"${IMAGES}"
    for name in sorted(names, key=len, reverse=True):
        text = text.replace(name, names[name]) if len(name) > 1 else text
    return text


def written(outcomes: Sequence[StepOutcome], when: datetime.datetime, commit: str, tree: str) -> str:
    """The log.

    Args:
        outcomes: Of all steps, in order.
        when: The start, in UTC.
        commit: The commit of the tree, or `UNKNOWN`.
        tree: How the tree was.
    """
    head = {
        "result": _result(outcomes),
        "date": f"{when:%Y-%m-%d %H:%M:%S} UTC",
        "commit": f"{commit} ({tree})",
        "sources": sources(commit),
        "python": f"{platform.python_version()}, {os.cpu_count()} processors",
        "packages": ", ".join(f"{name} {version}" for name, version in versions().items()),
        "images": f"those of {IMAGES}",
        "total": f"{sum(outcome.seconds for outcome in outcomes):.0f} s",
    }
    parts = ["\n".join(f"{name + ':':<10}{value}" for name, value in head.items())]
    for number, outcome in enumerate(outcomes, start=1):
        why = f" ({outcome.why})" if outcome.why else ""
        parts.append(f"{number}. {outcome.step.name}: {outcome.result}{why}, {outcome.seconds:.0f} s")
        words = (f"'{word}'" if " " in word else word for word in outcome.step.words)
        parts[-1] += f"\n$ python {' '.join(words)}" + (f"\n{outcome.said}" if outcome.said else "")
    return without_paths("\n\n".join(parts) + "\n")


def _result(outcomes: Sequence[StepOutcome]) -> str:
    failed = sum(outcome.result == FAILED for outcome in outcomes)
    return f"{failed} of {len(outcomes)} steps failed" if failed else PASSED


def main(words: Sequence[str] | None = None, steps: Sequence[Step] = STEPS, say: Callable[[str], None] = print) -> int:
    """Run all ``steps``, write the log; the exit code."""
    parser = argparse.ArgumentParser(description="Run what needs torch; exit with 1 if a step fails.")
    parser.add_argument("--log", type=Path, default=LOG, help="default: docs/logs/ci-torch.log")
    parser.add_argument("--since", action="store_true", help="run nothing; say what has changed since the log")
    chosen = parser.parse_args(words)
    log = Path(chosen.log).absolute()
    if chosen.since:
        say(since(log))
        return 0
    when, before = datetime.datetime.now(datetime.timezone.utc), state(log)
    outcomes = []
    for step in steps:
        say(f"{step.name} ...")
        outcomes.append(run_step(step))
        say(f"  {outcomes[-1].result} {outcomes[-1].why}".rstrip() + f", {outcomes[-1].seconds:.0f} s")
    clean = "clean" if before[1] else "with changes that are not committed"
    moved = "" if state(log) == before else "; it changed under way"
    text = written(outcomes, when, before[0], clean + moved)
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(log, lambda file: file.write(text.encode("utf-8")))
    except OSError as error:
        sys.stderr.write(f"{log}: the log cannot be written: {error.strerror}; name another with --log\n")
        return 1
    say(f"{_result(outcomes)}: {os.path.relpath(log)}")
    return 1 if any(outcome.result == FAILED for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
