"""Whether the tests see faults in the code: .venv/bin/python scripts/mutants.py [WORD...]

Each row of scripts/mutants.toml is a fault: a text that stands once in a file, what is put in its place, and the test
that must fail then. Each is tried in a temporary copy of the checkout; words choose the rows whose name or file has one
of them. The exit code is 1 if a fault survives. tests/project/test_mutants.py sees that the rows fit the code.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import tomli

ROOT = Path(__file__).resolve().parents[1]
ROWS = ROOT / "scripts" / "mutants.toml"


class Mutant(NamedTuple):
    """A fault.

    Attributes:
        name: What is wrong, in a few words.
        file: The file that it is in, from the root of the checkout.
        old: A text that stands in it once.
        new: The text in its place.
        tests: The file of the test that must fail.
        test: The name of that test.
    """

    name: str
    file: str
    old: str
    new: str
    tests: str
    test: str

    def applied(self, text: str) -> str:
        """``text`` of the file with the fault."""
        if text.count(self.old) != 1:
            raise ValueError(f"{self.name}: {self.file} has {text.count(self.old)} times {self.old!r}, not once")
        return text.replace(self.old, self.new)


def mutants() -> list[Mutant]:
    """All rows, in order."""
    files = tomli.loads(ROWS.read_text(encoding="utf-8"))["file"]
    return [
        Mutant(name, file["path"], old, new, file["tests"], test)
        for file in files
        for name, old, new, test in file["mutants"]
    ]


def copy_to(folder: Path) -> None:
    """Copy what git has or would add, and make the two top-level folders part of the package, as an install does."""
    listed = ("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard")
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    for path in (Path(name) for name in names if name and (ROOT / name).exists()):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / path, folder / path)
    for name in ("processes", "deploy"):
        (folder / "lava_vpr" / name).symlink_to(Path("..") / name)


def tested(folder: Path, *tests: str) -> tuple[int, str]:
    """The exit code of some tests in the copy, and where the first that fails does, with what it says."""
    words = ("-m", "pytest", "-q", "-x", "-n", "0", "-p", "no:cacheprovider", "-m", "not slow", *tests)
    own = os.environ | {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}  # a stale .pyc would hide a fault
    done = subprocess.run((sys.executable, *words), cwd=folder, env=own, capture_output=True, text=True, check=False)
    where = re.findall(r"^(tests/\S+:\d+): ", done.stdout, re.MULTILINE)
    said = re.findall(r"^E +(?:AssertionError: )?(?!AssertionError)(\S.*)", done.stdout, re.MULTILINE)
    return done.returncode, f"{where[-1]}: {said[0]}" if where and said else ""


def main(words: list[str]) -> int:
    """Try the rows that ``words`` choose."""
    chosen = [row for row in mutants() if not words or any(word in row.name or word in row.file for word in words)]
    if not chosen:  # `--help`, too; pytest would run every test
        sys.exit(f"no row has {' or '.join(words)} in its name or file\n\n{__doc__}")
    survivors = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        copy_to(folder)
        code, line = tested(folder, *sorted({f"{row.tests}::{row.test}" for row in chosen}))
        if code:
            sys.exit(f"without a fault the tests fail already: {line or f'pytest ends with {code}'}")
        for row in chosen:
            file = folder / row.file
            sound = file.read_text(encoding="utf-8")
            file.write_text(row.applied(sound), encoding="utf-8")
            code, line = tested(folder, f"{row.tests}::{row.test}")
            file.write_text(sound, encoding="utf-8")
            at = sound[: sound.index(row.old)].count("\n") + 1
            said = {0: "SURVIVED", 1: "killed"}.get(code, f"pytest ends with {code}")
            survivors += code != 1
            print(f"{said}: {row.name} ({row.file}:{at}), {row.test}, {line}", flush=True)
    print(f"{len(chosen) - survivors} of {len(chosen)} faults are seen")
    return int(survivors > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
