"""Compiled kernels: never stale, kept somewhere even where nothing of ours can be written, and no worse than none."""

from __future__ import annotations

import errno
import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from numba.core import caching, config
from numba.core.cpu import CPUContext
from support.common import children

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


@pytest.fixture
def kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """A kernel in a file of its own, with its cache beside it."""
    monkeypatch.setattr(kernelcache, "_noted", False)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(config, "CACHE_DIR", "")
    file = tmp_path / "kernels.py"
    file.write_text("def plus(a, b):\n    return a + b\n")
    spec = importlib.util.spec_from_file_location("kernels", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "kernels", module)  # what is kept of a function names its module
    spec.loader.exec_module(module)
    return kernelcache.compiled()(module.plus)


def test_a_kernel_that_cannot_be_kept_runs_and_a_note_says_so_once(
    kernel: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*what: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(caching.IndexDataCacheFile, "save", full)
    assert (kernel(1, 2), kernel(1.5, 2.0)) == (3, 3.5)
    (note,) = caplog.messages
    assert note.startswith(f"compiled kernels cannot be kept in {tmp_path}")
    assert "(No space left on device)" in note


def test_kept_kernels_that_are_damaged_are_compiled_anew(kernel: Callable[..., Any], tmp_path: Path) -> None:
    assert kernel(1, 2) == 3
    kept = sorted((tmp_path / "__pycache__").glob("kernels.plus*"))
    assert {path.suffix for path in kept} == {".nbi", ".nbc"}
    for path in kept:
        path.write_bytes(path.read_bytes()[:-9])
    again = kernelcache.compiled()(kernel.py_func)
    assert again(1, 2) == 3
    assert again.stats.cache_hits == {}


def test_a_kept_kernel_needs_nothing_that_only_compiling_needs(
    kernel: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert kernel(1, 2) == 3
    monkeypatch.setattr(CPUContext, "load_additional_registries", lambda context: pytest.fail("imports a lot"))
    again = kernelcache.compiled()(kernel.py_func)
    assert again(1, 2) == 3
    assert len(again.stats.cache_hits) == 1


PROGRAM = """
import sys
sys.path.insert(0, sys.argv.pop())
import kernels
from lava_vpr import __main__, cli, kernelcache

def main(prog_name):
    kernel = kernelcache.compiled()(kernels.plus)
    print(kernel(1, 2), kernel(1.5, 2.0))

cli.main = main
__main__.run()
"""


def test_a_program_notes_once_that_it_compiles_and_nothing_where_it_does_not(
    kernel: Callable[..., Any], tmp_path: Path
) -> None:
    for said in (f"note: {kernelcache.COMPILING_TEXT}\n", ""):  # compiled, then read
        with (tmp_path / "said").open("w+") as err:
            done = children.run(
                [sys.executable, "-c", PROGRAM, tmp_path], stdout=subprocess.PIPE, stderr=err, text=True
            )
            err.seek(0)
            assert (done.stdout, err.read()) == ("3 3.5\n", said)


def test_what_is_drawn_says_instead_of_a_note_that_kernels_are_compiled(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    told: list[bool] = []
    monkeypatch.setattr(kernelcache, "COMPILING", [kernelcache.note_compiling, told.append])
    kernelcache._tell(True)
    kernelcache._tell(False)
    assert (told, capsys.readouterr().err) == ([True, False], "")
    kernelcache.COMPILING.pop()
    for _ in range(2):
        kernelcache._tell(True)
        kernelcache._tell(False)
    assert capsys.readouterr().err == f"note: {kernelcache.COMPILING_TEXT}\n"
