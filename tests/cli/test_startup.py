"""A query of one image is mostly its start: what it does not need is not imported.

`benchmarks.commands.startup` measures it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from support.common import children

PROGRAM = "import sys; from lava_vpr.cli import main; main(sys.argv[1:], standalone_mode=False); print(*sys.modules)"

NOT_FOR_A_QUERY = (
    "IPython",
    "jinja2",
    "lava",
    "lava_vpr.bench",
    "lava_vpr.deploy.bundle",
    "lava_vpr.deploy.mapping",
    "lava_vpr.deploy.registers",
    "lava_vpr.maps",
    "lava_vpr.report",
    "lava_vpr.synthetic",
    "lava_vpr.training",
    "matplotlib",
    "networkx",
    "pandas",
    "rich.markdown",
    "rich.progress",
    "scipy.spatial",
    "scipy.stats",
    "sklearn",
    "torch",
)
"""Packages and modules; scipy.linalg is imported by numba itself."""


@pytest.fixture(scope="module")
def imported(made: Path, tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """The names of all modules that ``lava-vpr query`` has imported when it is done with an image."""
    out = tmp_path_factory.mktemp("startup") / "m.csv"
    words = ["query", str(made / "m.lvpr"), str(min((made / "query").iterdir())), "-o", str(out)]
    done = children.run([sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(out.read_text().splitlines()) == 2
    return set(done.stdout.split())


def test_a_query_imports_what_it_needs(imported: set[str]) -> None:
    assert {"numba", "cv2", "click", "lava_vpr.recognition"} <= imported


@pytest.mark.parametrize("name", NOT_FOR_A_QUERY)
def test_a_query_imports_nothing_else(imported: set[str], name: str) -> None:
    assert {module for module in imported if module == name or module.startswith(f"{name}.")} == set()
