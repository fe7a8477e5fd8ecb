"""Programs in environments of their own, which hold what this project is compared with; files go there and back."""

from __future__ import annotations

import subprocess
from pathlib import Path

from lava_vpr.errors import InputError
from lava_vpr.isolated.child import Ended, environment_without_python, run_child

ROOT = Path(__file__).resolve().parents[1]


def python_of(name: str) -> Path:
    """The Python of an environment that `make` sets up; it need not exist."""
    return ROOT / f".venv-{name}" / "bin" / "python"


def run_elsewhere(
    what: str, python: Path, goal: str, *words: str | Path, seconds: float = 1800, folder: Path | None = None
) -> Ended:
    """Run a script in another environment, which sees nothing of this one.

    Args:
        what: What is compared with, for messages.
        python: The Python of its environment.
        goal: The goal of `make` that sets it up.
        words: The script and its arguments.
        seconds: What it may take.
        folder: Where it runs.
    Raises:
        InputError: the environment is missing, or the script fails or takes too long.
    """
    environment = python.parent.parent.name
    if not python.exists():
        raise InputError(f"{what}: not installed in {environment}; run make {goal}")
    try:
        ended = run_child([python, *words], seconds=seconds, folder=folder, environment=environment_without_python())
    except subprocess.TimeoutExpired:
        raise InputError(f"{what}: not done after {seconds:g} s; ask for less") from None
    if ended.code:
        said = ended.last or f"exit status {ended.code}"
        raise InputError(f"{what}: {said}; delete {environment} and run make {goal}")
    return ended
