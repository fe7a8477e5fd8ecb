"""A grid of tasks: in the order of its points, kept ones taken, the others computed and kept by what decides them."""

from __future__ import annotations

import re
import sys
from functools import partial
from pathlib import Path

import pytest
from support.common import children

from lava_vpr.cluster.tasks import Pool
from lava_vpr.errors import InputError
from lava_vpr.experiments import cache
from lava_vpr.experiments.cache import FigureCache, content_key, modules_of, sources_hash
from lava_vpr.experiments.grid import compute
from lava_vpr.matching.evaluation import evaluate
from lava_vpr.paper_table.sections import measure

POINTS = (3, 1, 2)


def times(factor: int, point: int) -> int:
    if point > 9:
        raise InputError("too large")
    return factor * point


@pytest.mark.parametrize("jobs", [1, 3])
def test_figures_stand_in_the_order_of_the_points(jobs: int) -> None:
    assert list(compute(times, POINTS, shared=5, pool=Pool(jobs)).items()) == [(3, 15), (1, 5), (2, 10)]
    assert compute(times, POINTS, shared=5, read=lambda point: point + 1) == {3: 20, 1: 10, 2: 15}


def test_what_is_kept_is_not_computed_again(tmp_path: Path) -> None:
    kept: FigureCache[int, int] = FigureCache(tmp_path, str, "key of {}".format, lambda _, value: int(value))
    told: list[tuple[int, str]] = []

    def advance(done: int, note: str) -> None:
        told.append((done, note))

    with pytest.raises(InputError, match="too large"):
        compute(times, (*POINTS, 10), shared=5, cache=kept)
    assert compute(times, (*POINTS, 4), shared=6, cache=kept, kept_only=True) == {3: 15, 1: 5, 2: 10}
    found = compute(times, (*POINTS, 4), shared=6, cache=kept, in_words="point {}".format, advance=advance)
    assert found == {3: 15, 1: 5, 2: 10, 4: 24}
    assert [note for done, note in told if done] == [f"point {k} (kept)" for k in POINTS] + ["point 4"]
    assert compute(times, (4,), cache=kept, kept_only=True) == {4: 24}


def loaded_by(module: str) -> set[str]:
    """Modules of the package that a fresh Python has loaded once it has imported ``module``."""
    program = f"import sys, {module}; print('\\n'.join(name for name in sys.modules if name.startswith('lava_vpr')))"
    done = children.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_every_module_that_is_imported_decides() -> None:
    """Lava's Processes aside, which are looked up by their folders."""
    known = modules_of(measure)
    loaded = loaded_by("lava_vpr.paper_table.sections")
    assert {name for name in loaded if not name.startswith("lava_vpr.processes.")} <= set(known)
    assert {"lava_vpr.deploy.boards.board", "lava_vpr.engine.inference.fixed_kernels"} <= set(known)
    assert modules_of(partial(measure)) == known


def test_what_is_shown_decides_nothing() -> None:
    rooms = {name.rpartition(".")[0] for name in modules_of(measure)}
    assert not [room for room in rooms if room.startswith(("lava_vpr.cli", "lava_vpr.report", "lava_vpr.bench"))]
    assert "lava_vpr.training.loop" not in modules_of(evaluate)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package beside this one: ``root.task`` imports ``root.used``, and for type checkers ``root.types``."""
    texts = {
        "__init__": "",
        "task": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import root.types\nfrom root import used\n",
        "used": '"""What it is."""\nx = 1\n',
        "types": "",
        "other": "",
    }
    (tmp_path / "root").mkdir()
    for name, text in texts.items():
        (tmp_path / "root" / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(cache, "ROOTS", ("root",))
    for memory in (cache._folders, cache.source_file, cache._read):
        memory.cache_clear()
    return tmp_path / "root"


def test_what_a_module_does_decides_and_not_what_it_says(package: Path) -> None:
    def task() -> None: ...

    task.__module__ = "root.task"

    def now() -> str:
        cache._read.cache_clear()
        return sources_hash(task)

    first = now()
    assert modules_of(task) == ["root", "root.task", "root.used"]
    (package / "used.py").write_text('"""What it is, in other words."""\n\nx = 1  # one\n')
    (package / "other.py").write_text("x = 3")
    assert now() == first
    (package / "used.py").write_text("x = 2")
    assert now() != first


def test_a_key_is_of_settings_and_inputs() -> None:
    keys = [content_key(evaluate, *given) for given in (({"seed": 1},), ({"seed": 2},), ({"seed": 1}, b"images"))]
    assert len(set(keys)) == 3
    assert content_key(evaluate, {"seed": 1}) == keys[0]


def test_what_is_kept_is_found_under_its_key_alone(tmp_path: Path) -> None:
    kept: FigureCache[int, list[float]] = FigureCache(
        tmp_path / "k", "row-{}".format, str, lambda _, values: list(map(float, values))
    )
    kept.keep(3, "key", [0.5])
    assert (kept.find(3, "key"), kept.find(3, "other"), kept.find(4, "key")) == ([0.5], None, None)
    path = tmp_path / "k" / "row-3.json"
    text = path.read_text()
    assert re.fullmatch(r'\{"fingerprint": "key", "sha256": "[0-9a-f]{64}", "figures": \[0\.5\]\}\n', text)
    for changed in (text.replace("0.5", "0.25"), text.replace('"sha256"', '"sha"'), text.replace("0.5", '"0.5"')):
        path.write_text(changed)
        assert kept.find(3, "key") is None
    kept.keep(3, "key", ["x"])  # type: ignore[list-item]
    assert kept.find(3, "key") is None
