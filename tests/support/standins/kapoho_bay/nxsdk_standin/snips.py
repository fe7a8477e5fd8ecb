"""Embedded programs: compiled by the system's C compiler, called after each step, every register write watched."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from nxsdk_standin.channels import Channel
from nxsdk_standin.faults import FAULTS, StandinError

INCLUDE = Path(__file__).parents[1] / "include"
STRICT = "-std=c99 -O1 -Wall -Wextra -Wconversion -Wno-sign-conversion -Wshadow -Wundef -Werror".split()
CORES = 256
STATE = np.dtype([("U", "<i4"), ("V", "<i4")])
CONFIG = np.dtype([(name, "<i4") for name in ("Bias", "BiasExp", "VthProfile", "CxProfile")])
CORE = np.dtype([("state", STATE, 1024), ("config", CONFIG, 1024), ("phases", "<u4", 256), ("stands", "<i4", 1024)])


def _compile(source: str, command: list[str]) -> None:
    """Run a compiler of ``source``.

    Raises:
        StandinError: it complains.
    """
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    if done.returncode or done.stderr:
        raise StandinError(f"{source} does not compile: {done.stderr[:2000]}")


def _standin(command: list[str]) -> str:
    """The stand-in's own part: its source, or what is made of it once in the folder that STANDIN_OBJECTS names."""
    source, folder = str(INCLUDE / "standin.c"), os.environ.get("STANDIN_OBJECTS")
    if folder is None:
        return source
    made = Path(folder, f"standin{int(FAULTS.no_type)}.o")
    if not made.exists():
        own = f"{made}.{os.getpid()}"
        _compile(source, [*command, "-c", source, "-o", own])
        os.replace(own, made)
    return str(made)


class RunState(ctypes.Structure):
    """NxSDK's runState."""

    _fields_ = (("time_step", ctypes.c_int32), ("total_steps", ctypes.c_int32))


class Snip:
    """One chip's embedded program."""

    def __init__(self, chip: Any, name: str, source: str, include: str, function: str, guard: str) -> None:
        if not re.fullmatch(r"\w+", name) or not Path(source).is_file() or not Path(include).is_dir():
            raise StandinError(f"createSnip: {name!r}, {source!r}, {include!r}")
        if not Path(include, Path(source).stem + ".h").is_file():
            raise StandinError(f"createSnip: {source} has no header of its name")
        self.chip, self.name, self.source, self.include = chip, name, source, include
        self.function_name, self.guard_name = function, guard
        self.channels: list[Channel] = []
        self.error: BaseException | None = None
        self.step = 0
        self.injected: list[tuple[int, int]] = []
        self.before: dict[int, Any] = {}
        self.flushed: dict[int, Any] = {}
        self.whole: set[int] = set()
        self.calls = {"touch": 0, "flush": 0, "spike": 0}

    def compile(self) -> None:
        """Build and load the program.

        Raises:
            StandinError: there is no compiler, or it complains.
        """
        compiler = shutil.which(os.environ.get("CC", "gcc")) or shutil.which("cc")
        if compiler is None:
            raise StandinError("no C compiler: install gcc, the test compiles the program of the embedded processors")
        library = str(Path(self.include) / (self.name + ".so"))
        header = Path(self.include, Path(self.source).stem + ".h").read_text(encoding="utf-8")
        tables = "".join(line for line in header.splitlines() if line.startswith("static const"))
        if 0 <= FAULTS.memory < 2 * len(re.findall(r"\b\d+\b", tables)):
            raise StandinError(f"{self.source}: section .rodata does not fit, region is full")
        options = [*STRICT, "-fPIC", "-I", self.include, "-I", str(INCLUDE), *["-DSTANDIN_NO_TYPE"] * FAULTS.no_type]
        parts = ["-shared", self.source, _standin([compiler, *options])]
        _compile(self.source, [compiler, *options, *parts, "-o", library])
        self.library = ctypes.CDLL(library)
        self.library.standin_memory.restype = ctypes.c_void_p
        raw = (ctypes.c_char * (CORE.itemsize * CORES)).from_address(self.library.standin_memory())
        self.memory = np.frombuffer(raw, CORE)
        self._install()

    def _install(self) -> None:
        """Give the program NxSDK's functions."""
        integer, pointer = ctypes.c_int, ctypes.c_void_p
        kinds = (
            (self._channel_id, ctypes.CFUNCTYPE(integer, ctypes.c_char_p)),
            (self._read, ctypes.CFUNCTYPE(None, integer, pointer, integer)),
            (self._write, ctypes.CFUNCTYPE(None, integer, pointer, integer)),
            (self._spike, ctypes.CFUNCTYPE(None, integer, integer, integer)),
            (self._touch, ctypes.CFUNCTYPE(None, integer)),
            (self._flush, ctypes.CFUNCTYPE(None, integer)),
            (self.whole.add, ctypes.CFUNCTYPE(None, integer)),
        )
        self.callbacks = [kind(self._guarded(function)) for function, kind in kinds]
        self.library.standin_install(*self.callbacks)

    def _guarded(self, function: Any) -> Any:
        """C cannot raise: the first error is kept for `run`."""

        def call(*values: Any) -> Any:
            try:
                return function(*values) if self.error is None else -1
            except BaseException as error:
                self.error = error
                return -1

        return call

    def _channel_id(self, name: bytes) -> int:
        names = [channel.name for channel in self.channels]
        return names.index(name.decode()) if name.decode() in names else -1

    def _read(self, channel: int, target: int, n: int) -> None:
        for i in range(n):
            message = np.ascontiguousarray(self.channels[channel].get())
            ctypes.memmove(target + i * message.nbytes, message.ctypes.data, message.nbytes)

    def _write(self, channel: int, source: int, n: int) -> None:
        words = self.channels[channel].words
        for i in range(n):
            raw = ctypes.string_at(source + i * 4 * words, 4 * words)
            self.channels[channel].put(np.frombuffer(raw, np.int32).copy())

    def _spike(self, time: int, core: int, axon: int) -> None:
        if time != self.step & 0xFFFF:
            raise StandinError(f"a spike is sent in step {self.step} for {time}")
        self.calls["spike"] += 1
        self.injected.append((core, axon))

    def _touch(self, core: int) -> None:
        self.calls["touch"] += 1
        if core not in {own.id for own in self.chip.n2CoresAsList if own.used}:
            raise StandinError(f"chip {self.chip.number} has no core with id {core} in use")
        if core not in self.before:
            self.before[core] = self.memory[core].copy()

    def _flush(self, core: int) -> None:
        self._touch(core)
        self.calls["touch"] -= 1
        self.calls["flush"] += 1
        self.flushed[core] = self.memory[core].copy()

    def run(self, step: int) -> None:
        """Call the program after ``step``; see that it wrote only what it may, and flushed it."""
        self.step, self.injected, self.before, self.flushed = step, [], {}, {}
        self.whole.clear()
        state = RunState(step, 0)
        if getattr(self.library, self.guard_name)(ctypes.byref(state)):
            getattr(self.library, self.function_name)(ctypes.byref(state))
        if self.error is not None:
            raise self.error
        for core, before in self.before.items():
            if FAULTS.stuck:  # what was cleared stands still, unless its phase was written
                cleared = (before["state"]["V"] != 0) & (self.memory[core]["state"]["V"] == 0)
                self.memory[core]["stands"] |= cleared & ~np.repeat(self.memory[core]["phases"] != 0, 4)
                self.memory[core]["phases"] = self.flushed[core]["phases"] = 0
                self.flushed[core]["stands"] = self.memory[core]["stands"]
            if FAULTS.stale and core not in self.whole:
                self.memory[core]["state"] = self.flushed[core]["state"] = before["state"]
            if before.tobytes() != self.memory[core].tobytes():
                self._check(core, before)

    def _check(self, core: int, before: Any) -> None:
        own, after = next(one for one in self.chip.n2CoresAsList if one.id == core), self.memory[core]
        n = len(own.cxCfg.used)
        if core not in self.flushed or self.flushed[core].tobytes() != after.tobytes():
            raise StandinError(f"{own.where}registers were written and not flushed")
        if (before["state"][n:] != after["state"][n:]).any() or (before["config"][n:] != after["config"][n:]).any():
            raise StandinError(f"{own.where}a compartment was written that is not there")
        config, state = after["config"], after["state"]
        for name in ("VthProfile", "CxProfile"):
            if (before["config"][name] != config[name]).any():
                raise StandinError(f"{own.where}the profile of a compartment was lost")
        bad = [
            (config["Bias"] < -4095).any() or (config["Bias"] > 4095).any(),
            (config["BiasExp"] < 0).any() or (config["BiasExp"] > 7).any(),
            (np.abs(state["V"].astype(np.int64)) >= 1 << 23).any()
            or (state["U"][before["state"]["U"] != state["U"]] != 0).any(),
        ]
        if any(bad):
            raise StandinError(f"{own.where}a value does not fit its register: bias, exponent, state {bad}")
