"""Compiled kernels: never stale, and kept somewhere even where nothing of ours can be written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lava_vpr import kernelcache


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    root = tmp_path / "lava_vpr"
    for folder in (root / "engine" / "inference" / "__pycache__", root / "engine" / "__pycache__", root / "inputs"):
        folder.mkdir(parents=True)
    for source in ("engine/draw.py", "engine/inference/fixed.py", "inputs/orientation.py"):
        (root / source).write_text("")
        os.utime(root / source, (1000, 1000))
    monkeypatch.setattr(kernelcache, "PACKAGE", root)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return root


def compiled(package: Path, name: str, time: float) -> Path:
    path = package / name
    path.write_text("")
    os.utime(path, (time, time))
    return path


def test_kernels_older_than_any_source_are_dropped(package: Path) -> None:
    old = [compiled(package, f"engine/inference/__pycache__/fixed.{end}", 999) for end in ("nbi", "1.nbc")]
    kept = [compiled(package, "engine/__pycache__/stdp.nbi", 1001), compiled(package, "engine/__pycache__/a.pyc", 5)]
    kernelcache.prepare()
    assert [path.exists() for path in (*old, *kept)] == [False, False, True, True]
    # Another file than the kernel's own has changed: its function may be inlined there.
    os.utime(package / "inputs" / "orientation.py", (2000, 2000))
    kernelcache.prepare()
    assert [path.exists() for path in kept] == [False, True]
    assert "NUMBA_CACHE_DIR" not in os.environ


def test_without_a_place_to_write_a_private_folder_is_used(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernelcache, "_writable", lambda folder: False)
    monkeypatch.setattr(kernelcache.tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    kernelcache.prepare()
    chosen = Path(os.environ["NUMBA_CACHE_DIR"])
    assert chosen.parent == tmp_path
    assert chosen.stat().st_mode & 0o777 == 0o700
    assert kernelcache.own_folder() == chosen


def test_a_folder_that_others_may_write_is_not_trusted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernelcache.tempfile, "tempdir", str(tmp_path))
    (tmp_path / f"lava-vpr-kernels-{os.getuid()}").mkdir(mode=0o777)
    os.chmod(tmp_path / f"lava-vpr-kernels-{os.getuid()}", 0o777)
    assert kernelcache.own_folder() != tmp_path / f"lava-vpr-kernels-{os.getuid()}"


def test_the_users_choice_is_kept(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/some/where")
    kernelcache.prepare()
    assert os.environ["NUMBA_CACHE_DIR"] == "/some/where"
