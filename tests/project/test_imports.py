"""Imports go one way: the linter of `make lint` sees every module of the tree, and refuses a forbidden import."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from support.common import children

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = {"lava_vpr": "lava_vpr", "processes": "lava_vpr/processes", "deploy": "lava_vpr/deploy"}
CALL = "import sys; from importlinter.cli import lint_imports_command; sys.exit(lint_imports_command())"


def modules_in(folder: Path) -> set[Path]:
    """Every module below ``folder`` that is imported; the host programs in deploy/programs stand alone."""
    return {path for path in folder.rglob("*.py") if "programs" not in path.relative_to(folder).parts}


def farm(place: Path, changed: Mapping[str, str] = MappingProxyType({})) -> Path:
    """A copy of the package as it is installed, with an import added to the modules that ``changed`` names."""
    for source, target in FOLDERS.items():
        for path in modules_in(ROOT / source):
            copy = place / target / path.relative_to(ROOT / source)
            copy.parent.mkdir(parents=True, exist_ok=True)
            added = changed.get(str(path.relative_to(ROOT).with_suffix("")).replace("/", "."))
            copy.write_text(path.read_text(encoding="utf-8") + (f"\n{added}\n" if added else ""), encoding="utf-8")
    return place


def test_the_reader_sees_every_module(tmp_path: Path) -> None:
    """import-linter leaves out the mapped packages of an editable install without a word; not so in a copy."""
    program = "import grimp; print(*sorted(grimp.build_graph('lava_vpr', cache_dir=None).modules))"
    place = farm(tmp_path)
    done = children.run([sys.executable, "-c", program], cwd=place, capture_output=True, text=True, timeout=120)
    seen = set(done.stdout.split())
    here = set()
    for source, target in FOLDERS.items():
        for path in modules_in(ROOT / source):
            name = ".".join((Path(target) / path.relative_to(ROOT / source)).with_suffix("").parts)
            here.add(name.removesuffix(".__init__"))
    assert seen == here, done.stderr
    assert len([name for name in seen if name.startswith("lava_vpr.processes.")]) > 25
    assert len([name for name in seen if name.startswith("lava_vpr.deploy.")]) > 25


FORBIDDEN = {
    "processes.spike_counter.process": (
        "import lava_vpr.backends",
        "lava_vpr.processes is not allowed to import lava_vpr.backends",
    ),
    "deploy.boards.board": (
        "import lava_vpr.deploy.mapping",
        "lava_vpr.deploy.boards is not allowed to import lava_vpr.deploy.mapping",
    ),
    "deploy.cost.costs": (
        "import lava_vpr.processes",
        "lava_vpr.deploy is not allowed to import lava_vpr.processes",
    ),
    "lava_vpr.errors": ("import lava_vpr.model", "lava_vpr.errors is not allowed to import lava_vpr.model"),
    "deploy.bundle.folder": ("import lava.magma", "lava_vpr.deploy is not allowed to import lava"),
}
"""An import that a module may not have, and what the linter says of it."""


def test_forbidden_imports_are_refused(tmp_path: Path) -> None:
    place = farm(tmp_path, {module: line for module, (line, _) in FORBIDDEN.items()})
    command = [sys.executable, "-c", CALL, "--config", str(ROOT / "pyproject.toml"), "--no-cache"]
    done = children.run(command, cwd=place, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1, done.stderr
    said = " ".join(done.stdout.split())
    for _, refusal in FORBIDDEN.values():
        assert refusal in said
