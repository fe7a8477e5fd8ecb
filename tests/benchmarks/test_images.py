"""Benchmarks that need real images say in one line, before any work, that there are none."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import click
import pytest
from support.common import children

from benchmarks import __main__ as benchmarks

ROOT = Path(__file__).resolve().parents[2]
WITHOUT = {
    f"benchmarks.{name}" for name in ("oracles.compare", "peers.side_by_side", "sanafe.compare", "versions.worker")
}
"""Those that do with less, and say so; and one that another starts."""
WORDS = {
    "benchmarks.recall": ["decoders"],
    "benchmarks.results.__main__": ["--all"],
    "benchmarks.versions.beside": ["."],
}
"""What must be given."""


def programs() -> list[str]:
    """The benchmarks that are programs and have to do with real images, as modules."""
    found = []
    for path in sorted((ROOT / "benchmarks").rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        images = re.search(r"^from benchmarks\.places import (?!recognised$)", source, re.MULTILINE)
        with_less = images and ("\n@program()" in source or '__name__ == "__main__"' in source)
        if with_less or "\n@program(" in source.replace("@program()", ""):
            found.append(".".join(path.relative_to(ROOT).with_suffix("").parts))
    return found


def test_the_programs_are_found() -> None:
    assert len(programs()) > 15
    assert {"benchmarks.events.lens", "benchmarks.oracles.needs"} <= set(programs())
    assert {f"benchmarks.{name}" for name in benchmarks.names()} - set(programs()) == {
        *(f"benchmarks.commands.{name}" for name in ("file_costs", "large_maps", "long_routes")),
        "benchmarks.events.synthetic",
        "benchmarks.lava_speed",
    }


@pytest.mark.parametrize("name", sorted({*programs(), "benchmarks.results.__main__"} - WITHOUT))
def test_no_images_are_told_before_any_work(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("LAVA_VPR_DATA", raising=False)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "benchmarks").mkdir()  # where logs are written
    main = importlib.import_module(name).main
    with pytest.raises(SystemExit, match=r"^(error: )?data/.*: no images; set LAVA_VPR_DATA to the folder that holds"):
        main(WORDS.get(name, []), standalone_mode=False) if isinstance(main, click.Command) else main()
    assert capfd.readouterr() == ("", "")
    assert [entry.name for entry in tmp_path.rglob("*")] == ["benchmarks"]


@pytest.mark.parametrize("named", ["", "nowhere"])
@pytest.mark.parametrize("goal", ["oracles", "recall", "learning", "nir-peers", "neurobench"])
def test_make_tells_it_before_anything_is_installed(goal: str, named: str) -> None:
    environment = {"PATH": "/usr/bin:/bin", "LAVA_VPR_DATA": named}
    options = {"cwd": ROOT, "env": environment, "capture_output": True, "text": True}
    done = children.run(["make", "--no-print-directory", "VENV=nowhere", goal], **options)
    assert done.returncode == 2
    assert done.stdout == f"make {goal} needs real images; set LAVA_VPR_DATA to the folder that holds data/nordland\n"
