"""What is missing is said in one line, before any work is done."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from lava_vpr.errors import BackendUnavailableError
from lava_vpr.isolated.runner import run_isolated
from lava_vpr.processes.base import lava_checks
from lava_vpr.processes.base.lava_checks import loihi_available, require_lava


def absent(name: str) -> Any:
    raise importlib.metadata.PackageNotFoundError(name)


def refusal() -> str:
    with pytest.raises(BackendUnavailableError) as caught:
        require_lava()
    return str(caught.value)


@pytest.mark.lava
def test_lava_is_here() -> None:
    require_lava()


@pytest.fixture
def python_3_10(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever runs the tests passes for the Python that Lava wants."""
    monkeypatch.setattr(lava_checks, "sys", SimpleNamespace(version_info=(3, 10, 13, "final", 0)))


@pytest.mark.usefixtures("python_3_10")
def test_lava_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(importlib.metadata, "version", absent)
        assert refusal() == "lava-nc is not installed: pip install lava-nc==0.10.*"
    with monkeypatch.context() as patch:
        patch.setattr(importlib.metadata, "version", lambda name: "0.10.0")
        patch.setattr(importlib.util, "find_spec", lambda name: None)
        assert refusal() == "lava-nc is not installed: pip install lava-nc==0.10.*"


@pytest.mark.usefixtures("python_3_10")
@pytest.mark.parametrize("version", ["0.9.0", "0.1", "0.100.0", "1.10"])
def test_lava_is_another_version(version: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.metadata, "version", lambda name: version)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object())
    assert refusal() == f"lava-nc {version} is installed, 0.10 is needed: pip install lava-nc==0.10.*"


def test_the_system_does_not_suit_lava(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(lava_checks, "sys", SimpleNamespace(version_info=(3, 11, 4, "final", 0)))
        assert refusal() == "lava-nc 0.10 needs Python 3.10, this is 3.11.4; install lava-vpr under Python 3.10"
    monkeypatch.delattr(os, "fork")
    monkeypatch.setattr(lava_checks, "sys", SimpleNamespace(platform="win32"))
    assert refusal() == "Lava starts its models by fork, which win32 lacks; use Linux or WSL"


def test_loihi_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    """With Lava, and without it, where the question itself fails."""
    said = "lava-loihi is not installed; it is Intel's closed package, from its neuromorphic research cloud"
    assert loihi_available() == said

    def fail(name: str) -> None:
        raise ModuleNotFoundError("No module named 'lava'")

    monkeypatch.setattr(importlib.util, "find_spec", fail)
    assert loihi_available() == said


def test_a_host_of_loihi_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object())
    for name in ("SLURM", "NXSDKHOST"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setitem(sys.modules, "lava.utils.loihi", SimpleNamespace(host=None))
    assert loihi_available() == (
        "no Loihi host is configured; call lava.utils.loihi.use_slurm_host() or use_ethernet_host(ADDRESS), "
        "or set SLURM=1 or NXSDKHOST=ADDRESS"
    )
    for name, value in (("SLURM", "1"), ("NXSDKHOST", "10.0.0.2")):
        with monkeypatch.context() as patch:
            patch.setenv(name, value)
            assert loihi_available() is None
    monkeypatch.setitem(sys.modules, "lava.utils.loihi", SimpleNamespace(host="SLURM"))
    assert loihi_available() is None


@pytest.mark.lava
def test_models_on_the_cpu_are_refused() -> None:
    """In a process of their own, with Lava's real run configurations."""
    said = {
        name: str(text) for name, text in run_isolated("support.lava.lava_targets:hardware", {}, timeout=240).items()
    }
    vendor = "it is Intel's closed package, from its neuromorphic research cloud"
    for number in (1, 2):
        assert said[f"library {number}"] == (
            f"Loihi{number}HwCfg cannot choose models for the chip without lava-loihi; {vendor}, "
            "or use the backend lava-fixed"
        )
    remedy = f"; install lava-loihi ({vendor}), or use the backend lava-fixed"
    actor, listener = "Actor Process_6 (PyActor)", "Listener Process_7 (PyListener)"
    assert said["pair"] == f"Loihi2HwCfg would run on the CPU: {actor}, {listener}{remedy}"
    assert said["pair, one allowed"] == f"Loihi1HwCfg would run on the CPU: Actor Process_8 (PyActor){remedy}"
    one, two, three = (f"{c} {n} (Py{m}ModelBitAcc)" for c, n, m in PARTS)
    assert said["library, C models"] == f"Loihi2HwCfg would run on the CPU: {two}, {one}, {three}{remedy}"
    floats = "LIFReset one (PyLifResetModelFloat), LIFReset three (PyLifResetModelFloat)"
    assert said["library, C models, Dense allowed"] == f"Loihi2HwCfg would run on the CPU: {floats}{remedy}"


PARTS = [("LIFReset", "one", "LifReset"), ("Dense", "two", "Dense"), ("LIFReset", "three", "LifReset")]
