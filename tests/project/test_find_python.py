"""`scripts/find_python.sh` takes the Python that serves best, and says what is left out, or missing, in plain words."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from support.common import children

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "find_python.sh"
STUB = """#!/bin/sh
case "$*" in
--version) echo "Python {version}.7" ;;
*print*) echo "{version}" ;;
*"'{version}'"*) exit 0 ;;
*) exit 1 ;;
esac
"""

Found = tuple[int, str, list[str]]


@pytest.fixture
def find(tmp_path: Path) -> Callable[..., Found]:
    """Runs the script where only Pythons of these versions are: exit code, name of what is found, lines of stderr."""
    tools = tmp_path / "bin"
    tools.mkdir()
    (tools / "cat").symlink_to(str(shutil.which("cat")))

    def run(versions: str, *words: str, python: str = "") -> Found:
        for version in versions.split():
            (tools / f"python{version}").write_text(STUB.format(version=version))
            (tools / f"python{version}").chmod(0o755)
        named = str(tools / python) if python else ""
        environment = {"PATH": str(tools), "HOME": str(tmp_path), "PYTHON": named}
        command = ["/bin/sh", str(SCRIPT), *words]
        done = children.run(command, env=environment, capture_output=True, text=True, check=False)
        return done.returncode, done.stdout.strip().rpartition("/")[2], done.stderr.splitlines()

    return run


LEFT_OUT = "Lava's parts are left out, as lava-nc runs under Python 3.10 alone; all else works"


@pytest.mark.parametrize(
    ("versions", "python", "taken"),
    [
        ("3.10 3.12", "", "3.10"),
        ("3.12 3.13 3.11", "", "3.12"),
        ("3.9 3.14 3.13", "", "3.13"),
        ("3.14", "", "3.14"),
        ("3.10 3.13", "python3.13", "3.13"),
    ],
)
def test_lavas_python_goes_first_and_any_newer_does(
    find: Callable[..., Found], versions: str, python: str, taken: str
) -> None:
    said = [] if taken == "3.10" else [f"Python {taken}.7: {LEFT_OUT}"]
    assert find(versions, python=python) == (0, f"python{taken}", said)


def test_one_that_is_named_and_does_not_serve_is_refused(find: Callable[..., Found]) -> None:
    code, found, (line,) = find("3.9 3.10", python="python3.9")
    assert (code, found) == (1, "")
    assert line.endswith("python3.9: is no Python of 3.10 or newer with venv; name another, or none")


def test_what_to_install_is_said_where_there_is_none(find: Callable[..., Found]) -> None:
    code, found, lines = find("3.9")
    assert (code, found) == (1, "")
    assert lines[0].startswith(
        "lava-vpr needs Python 3.10 or newer with venv, and none was found. Install one, best 3.10"
    )
    assert any("uv python install 3.10" in line for line in lines)


def test_one_version_alone_can_be_asked_for(find: Callable[..., Found]) -> None:
    assert find("3.10 3.12", "3.12") == (0, "python3.12", [])
    assert find("3.10 3.12", "3.13") == (1, "", ["no Python 3.13 with venv was found (on PATH, in pyenv, by uv)"])
