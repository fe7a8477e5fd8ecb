"""Run a benchmark by its name: python -m benchmarks NAME [--help]; without a name, say what there is."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

FOLDER = Path(__file__).resolve().parent


def names() -> list[str]:
    """All benchmarks: modules with a command ``main``."""
    paths = (path for path in FOLDER.rglob("*.py") if "\n@program(" in path.read_text(encoding="utf-8"))
    return sorted(".".join(path.relative_to(FOLDER).with_suffix("").parts) for path in paths)


def main(words: list[str]) -> None:
    """Run the benchmark that the first of ``words`` names."""
    if not words or words[0] not in names():
        raise SystemExit(f"python -m benchmarks NAME: NAME is one of {', '.join(names())}")
    command = import_module(f"benchmarks.{words[0]}").main
    command(words[1:], prog_name=f"python -m benchmarks {words[0]}")


if __name__ == "__main__":
    main(sys.argv[1:])
