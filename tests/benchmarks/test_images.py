"""Benchmarks that need real images say in one line, before any work, that there are none; all the energy of a query."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from support.common import children

from benchmarks import __main__ as benchmarks
from benchmarks.energy import whole
from benchmarks.figures import read
from benchmarks.program import turns

ROOT = Path(__file__).resolve().parents[2]
WITHOUT = {f"benchmarks.{name}" for name in ("oracles.compare", "peers.side_by_side", "sanafe.compare")}
"""Those that do with less, and say so."""
WORDS = {
    "benchmarks.commands.proofs": ["exactness"],
    "benchmarks.commands.tables": ["protocols"],
    "benchmarks.recall": ["decoders"],
    "benchmarks.results.__main__": ["--all"],
    "benchmarks.versions.whole": ["."],
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
@pytest.mark.parametrize("goal", ["oracles", "recall", "figures", "learning", "nir-peers", "neurobench", "ci-torch"])
def test_make_tells_it_before_anything_is_installed(goal: str, named: str) -> None:
    environment = {"PATH": "/usr/bin:/bin", "LAVA_VPR_DATA": named}
    options = {"cwd": ROOT, "env": environment, "capture_output": True, "text": True}
    done = children.run(["make", "--no-print-directory", "VENV=nowhere", goal], **options)
    assert done.returncode == 2
    assert done.stdout == f"make {goal} needs real images; set LAVA_VPR_DATA to the folder that holds data/nordland\n"


def test_all_take_turns_and_the_first_round_does_not_count() -> None:
    values, order = iter(range(6)), list[str]()

    def timed(name: str) -> int:
        order.append(name)
        return next(values)

    assert turns({"a": lambda: timed("a"), "b": lambda: timed("b")}, 2) == {"a": [2, 5], "b": [3, 4]}
    assert order == ["b", "a", "a", "b", "b", "a"]


@pytest.mark.data
@pytest.mark.slow
def test_a_row_for_every_preset_and_matcher(data_root: Path) -> None:
    result = CliRunner().invoke(whole.main, ["--rounds", "1"])
    assert result.exit_code == 0, result.output
    rows = re.findall(r"^│ ([^│]+)│ +([\d.]+) [^│]*│", result.output, re.MULTILINE)
    recalls = {name.strip(): float(cell) for name, cell in rows}
    assert {f"{case}, {where}" for case in whole.ENERGY_OF for where in ("Kapoho Bay", "no board")} < set(recalls)
    assert [recalls[f"loihi, {name}"] for name in ("cosine", "HOG", "SAD")] == [92.6, 88.0, 57.8]
    assert set(recalls) == {row[0].replace("`", "") for row in read("energy").rows}
