"""Shared fixtures; and what is left out where Lava cannot run."""

from __future__ import annotations

import fcntl
import gc
import os
import signal
import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: its threads would wait for a processor by turning

import pytest
from support.common import children
from support.common.commands import linked_route, make_route
from support.lava import copies

from lava_vpr.backends.lava import lava_missing
from lava_vpr.isolated import runner

MISSING = lava_missing()
WHOLE_MODULE = "pytestmark = pytest.mark.lava\n"
"""The line of a module whose every test needs Lava; it may import Processes, so without Lava it is not imported."""


class NeedsLava(pytest.Module):
    """A module of tests that all need Lava, where there is none."""

    def collect(self) -> Iterator[Any]:
        return iter([LeftOut.from_parent(self, name="all of it")])


class LeftOut(pytest.Item):
    """What stands for all tests of a module that is not imported."""

    def runtest(self) -> None:
        raise AssertionError("it is skipped in `pytest_runtest_setup`")


def pytest_pycollect_makemodule(module_path: Path, parent: Any) -> pytest.Module | None:
    """Leave a module unread if all of it needs Lava and there is none."""
    if MISSING is None or WHOLE_MODULE not in module_path.read_text(encoding="utf-8"):
        return None
    module = NeedsLava.from_parent(parent, path=module_path)
    module.add_marker(pytest.mark.lava)
    return module


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the cases of a test beyond its ``quick(n)`` as slow, before ``-m`` selects by marks."""
    cases: Counter[Any] = Counter()
    for item in items:
        if (mark := item.get_closest_marker("quick")) and isinstance(item, pytest.Function):
            cases[item.function] += 1
            if cases[item.function] > mark.args[0]:
                item.add_marker(pytest.mark.slow)


def pytest_collection_finish() -> None:
    """Leave the tests themselves, half a million objects that stay to the end, out of every collection of garbage."""
    gc.freeze()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what is marked ``lava`` where Lava cannot run: all in this one place, so that pytest counts them as one."""
    if MISSING is not None and item.get_closest_marker("lava") is not None:
        pytest.skip(f"Lava's parts are left out: {MISSING}")


@pytest.fixture(scope="session", autouse=True)
def _signals() -> None:
    """All programs that tests start heed signals, also if the tests were started as a background job."""
    children.heed()


@pytest.fixture(scope="session", autouse=True)
def _disks() -> Iterator[None]:
    """No test waits until a disk has what it writes: none could see what a power cut would leave."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", os.fstat)  # it refuses closed files, too
        yield


@pytest.fixture(scope="session", autouse=True)
def _kernels(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A kernel that another worker of pytest-xdist compiles is waited for and read, not compiled once more."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        yield
        return
    from numba.core.dispatcher import Dispatcher, global_compiler_lock

    compiled = Dispatcher.compile
    with (tmp_path_factory.getbasetemp().parent / "kernels").open("ab") as locks, pytest.MonkeyPatch.context() as patch:

        def in_turn(kernel: Any, signature: Any) -> Any:
            if not kernel.__module__.startswith("lava_vpr."):  # those have no cycles of calls, nor cycles of waiting
                return compiled(kernel, signature)
            byte = zlib.crc32(f"{kernel.__module__}.{kernel.__qualname__}".encode())
            with global_compiler_lock:  # first, else two threads could wait for each other
                fcntl.lockf(locks, fcntl.LOCK_EX, 1, byte)
                try:
                    return compiled(kernel, signature)
                finally:
                    fcntl.lockf(locks, fcntl.LOCK_UN, 1, byte)

        patch.setattr(Dispatcher, "compile", in_turn)
        yield


@pytest.fixture(autouse=True)
def _children() -> Iterator[None]:
    """What a test has started ends with it at the latest; what serves several tests was started before."""
    with children.ended():
        yield


@pytest.fixture(scope="session")
def _original() -> Iterator[None]:
    """What runs of Lava are copied from ends with the tests."""
    yield
    copies.end()


@pytest.fixture(autouse=True)
def _copies(request: pytest.FixtureRequest, _original: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs of Lava start at once, but for the tests that are about how they start."""
    if MISSING is None and "isolated" not in request.path.parts:
        monkeypatch.setattr(runner, "started", copies.started)


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """SIGINT raises `KeyboardInterrupt`, also if the tests were started with it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def data_root() -> Path:
    """The folder with real images and the decoder oracle, or skip."""
    root = os.environ.get("LAVA_VPR_DATA", "")
    if not root or not (Path(root) / "data").is_dir():
        pytest.skip("needs real images: set LAVA_VPR_DATA to the folder that holds data/ and oracle/")
    return Path(root)


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic route and a model of it; never written to."""
    return make_route(tmp_path_factory.mktemp("made") / "w")


@pytest.fixture
def here(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of its own to work in, which sees what was made."""
    monkeypatch.chdir(tmp_path)
    with linked_route(made, tmp_path) as folder:
        yield folder
