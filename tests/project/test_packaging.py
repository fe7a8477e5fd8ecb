"""What is installed is what is here: packages, the wheel, pinned versions."""

from __future__ import annotations

import os
import shutil
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest
import tomli
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version
from support.common import children

import lava_vpr

ROOT = Path(__file__).resolve().parents[2]
TOP = {"lava_vpr": "lava_vpr", "processes": "lava_vpr.processes", "deploy": "lava_vpr.deploy"}


def project() -> dict[str, Any]:
    return tomli.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def packages_here() -> dict[str, Path]:
    """Every folder that holds an ``__init__.py``, by the name of its package."""
    found = {}
    for folder, name in TOP.items():
        for init in (ROOT / folder).rglob("__init__.py"):
            inner = init.parent.relative_to(ROOT / folder).parts
            found[".".join((name, *inner))] = init.parent
    return found


def test_the_list_of_packages_is_complete() -> None:
    """A package that is missing from the list vanishes from the wheel without a word."""
    assert sorted(project()["tool"]["setuptools"]["packages"]) == sorted(packages_here())


PROGRAMS = ROOT / "deploy" / "programs"
"""Programs that stand alone: they are copied into bundles, never imported."""


def programs_here() -> set[str]:
    """Every file of them, by its name in the wheel."""
    files = (path for path in PROGRAMS.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {f"lava_vpr/deploy/programs/{path.relative_to(PROGRAMS)}" for path in files}


def test_every_file_of_the_programs_is_package_data() -> None:
    assert project()["tool"]["setuptools"]["package-data"]["lava_vpr.deploy"] == ["programs/*/*"]
    depths = {name.count("/") for name in programs_here()}
    assert depths == {"lava_vpr/deploy/programs/loihi2/run.py".count("/")}


def test_every_template_is_package_data() -> None:
    patterns = project()["tool"]["setuptools"]["package-data"]["lava_vpr.show.templates"]
    templates = [path for path in (ROOT / "lava_vpr" / "show" / "templates").iterdir() if path.is_file()]
    left_out = {path.name for path in templates if not any(path.match(pattern) for pattern in patterns)}
    assert left_out == {"__init__.py"}


def test_the_map_of_folders() -> None:
    mapped = project()["tool"]["setuptools"]["package-dir"]
    assert mapped == {name: folder for folder, name in TOP.items()}
    # Were there folders of these names inside the package as well, one of the two would hide the other.
    for folder in ("processes", "deploy"):
        assert not (ROOT / "lava_vpr" / folder).exists()


def test_the_version_is_said_once() -> None:
    assert project()["project"]["version"] == lava_vpr.__version__


def requirements(name: str) -> dict[str, Version]:
    lines = (ROOT / "requirements" / name).read_text(encoding="utf-8").splitlines()
    # A pin may end with a marker, where a package is not for every Python.
    pins = [line.partition(";")[0] for line in lines if line and not line.startswith(("#", "-"))]
    assert all(line.count("==") == 1 for line in pins), pins
    return {canonicalize_name(line.split("==")[0]): Version(line.split("==")[1]) for line in pins}


ON_3_10_ALONE = {"ruff", "mypy"}
"""What `make lint` needs, which runs under Python 3.10 alone."""


@pytest.mark.parametrize(("lock", "python"), [("lock", "3.10"), *(("lock-host", f"3.{n}") for n in (11, 12, 13))])
def test_pinned_versions_satisfy_the_ranges(lock: str, python: str) -> None:
    about = project()
    extras = about["project"]["optional-dependencies"]
    pins = requirements(f"{lock}.txt")
    wanted = [*about["project"]["dependencies"], *extras["test"], *extras["dev"], *about["build-system"]["requires"]]
    for requirement in map(Requirement, wanted):
        name = canonicalize_name(requirement.name)
        here = requirement.marker is None or requirement.marker.evaluate({"python_version": python})
        if not here or name == "lava-vpr" or (name in ON_3_10_ALONE and python != "3.10"):
            continue  # an extra that names another extra is none, either
        assert name in pins, f"{name} is not pinned"
        assert pins[name] in requirement.specifier, f"{name} {pins[name]} is not {requirement.specifier}"


def test_what_decides_an_answer_is_pinned_alike_for_every_python() -> None:
    """Lava, what it holds back, and what runs under 3.10 alone are all that the two lists may disagree about."""
    lock, host = requirements("lock.txt"), requirements("lock-host.txt")
    assert lock["opencv-python-headless"] == host["opencv-python-headless"]
    assert {name for name in host if lock.get(name) != host[name]} == {"numpy", "scipy", "contourpy"}
    assert "lava-nc" in lock
    assert "lava-nc" not in host


@pytest.mark.slow
def test_the_wheel_holds_every_module_and_imports(tmp_path: Path) -> None:
    """Built from a copy, unpacked, and used from a folder that knows nothing of the project."""
    copy = tmp_path / "project"
    copy.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        if (ROOT / name).exists():
            shutil.copy(ROOT / name, copy / name)
    for name in TOP:
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path / "dist"), "."]
    built = children.run(command, cwd=copy, capture_output=True, text=True)
    assert built.returncode == 0, built.stdout[-2000:] + built.stderr[-2000:]
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
        archive.extractall(tmp_path / "unpacked")
    here = {
        f"{package.replace('.', '/')}/{path.name}"
        for package, folder in packages_here().items()
        for path in folder.iterdir()
        if path.is_file() and path.suffix not in (".pyc",)
    }
    assert held == here | programs_here()
    # Without user site and current folder, and with the unpacked wheel before the checkout.
    program = (
        f"import runpy, sys; sys.path.insert(0, {str(tmp_path / 'unpacked')!r}); "
        f"runpy.run_path({str(ROOT / 'scripts' / 'smoke.py')!r})"
    )
    neutral = tmp_path / "neutral"
    neutral.mkdir()
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    done = children.run(
        [sys.executable, "-I", "-c", program], cwd=neutral, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert f"from {tmp_path}/unpacked/lava_vpr/__init__.py" in done.stdout
    assert not any(neutral.iterdir())
