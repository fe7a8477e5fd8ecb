"""What tests of plug-ins share."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.common.plugins import Install

from lava_vpr.rows import registry as registries


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Installs a package of one module with entry points, as pip leaves it, into a folder of the path."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))

    def put(package: str, group: str, entries: dict[str, str], code: str = "") -> None:
        info = folder / f"{package}-1.2.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.2\n")
        lines = "\n".join(f"{name} = {package}:{attribute}" for name, attribute in entries.items())
        (info / "entry_points.txt").write_text(f"[{group}]\n{lines}\n")
        (folder / f"{package}.py").write_text(code)
        registries.scanned.cache_clear()

    registries.scanned.cache_clear()
    registries._warn.cache_clear()
    yield put
    registries.scanned.cache_clear()
    for path in folder.glob("*.py"):
        sys.modules.pop(path.stem, None)
