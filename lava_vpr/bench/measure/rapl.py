"""Energy of the processor, read from its RAPL counters on Linux, for Intel and AMD.

``/sys/class/powercap`` has a folder for each counter with its ``name``, its increasing value ``energy_uj``, and
``max_energy_range_uj``, at which it wraps to 0. Packages are at the top, ``intel-rapl:0`` and so on; their values
include cores and memory controllers, but not memory chips (``dram``), which are added. Source: Linux kernel
documentation, ``Documentation/power/powercap/powercap.rst``.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np

from lava_vpr.errors import brief

ROOT = Path("/sys/class/powercap")
PERIOD = 0.05
"""Seconds between two readings. A package at 250 W needs over 15 minutes to wrap at 2^18 J, so no wrap is missed."""

_PACKAGE = re.compile(r"intel-rapl:\d+")
_PART = re.compile(r"intel-rapl:\d+:\d+")


class NoRaplError(Exception):
    """Raised where no counter can be read; the message says why."""


@dataclass(frozen=True)
class EnergyCounter:
    """One counter: its folder, its name, and the microjoules at which it wraps to 0."""

    folder: Path
    name: str
    span: int

    def read(self) -> int:
        """The counter's present value in microjoules.

        Raises:
            NoRaplError: the counter cannot be read.
        """
        return _number(self.folder / "energy_uj")


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace").strip()
    except PermissionError:
        raise NoRaplError(f"{path} may be read by root only; run as root, or: sudo chmod a+r {path}") from None
    except OSError as error:
        raise NoRaplError(f"{path} cannot be read ({error.strerror})") from None


def _number(path: Path) -> int:
    text = _text(path)
    if not text.isdigit():
        raise NoRaplError(f"{path} holds {brief(text)}, no number")
    return int(text)


def counters(root: Path = ROOT) -> tuple[EnergyCounter, ...]:
    """The counters of packages, and those of memory chips where they are separate.

    Raises:
        NoRaplError: there are none, or they may not be read.
    """
    if not root.is_dir():
        raise NoRaplError(f"{root} is missing: this machine (or virtual machine) shows no RAPL counters")
    folders = [folder for folder in sorted(root.iterdir()) if _PACKAGE.fullmatch(folder.name)]
    packages = []
    for folder in folders:
        name = _text(folder / "name")
        if name.startswith("package"):  # "psys", the whole board, would count packages twice
            parts = [part for part in sorted(root.iterdir()) if _PART.fullmatch(part.name)]
            inside = [part for part in parts if part.name.startswith(f"{folder.name}:")]
            packages.append((folder, name))
            packages += [(part, f"{name} dram") for part in inside if _text(part / "name") == "dram"]
    if not packages:
        raise NoRaplError(f"{root} lists no RAPL package: the processor has none, or its driver (intel_rapl) is absent")
    made = tuple(EnergyCounter(folder, name, _number(folder / "max_energy_range_uj")) for folder, name in packages)
    for counter in made:
        counter.read()
    return made


def joules(counters: Sequence[EnergyCounter], before: Sequence[int], after: Sequence[int]) -> float:
    """Energy between two readings, between which the counter may have wrapped once."""
    total = 0
    for counter, first, last in zip(counters, before, after, strict=True):
        total += last - first if last >= first else last - first + counter.span
    return total * 1e-6


class Meter:
    """Samples the counters while it is open, so that the energy of other processes' work can be looked up afterwards.

    ``with Meter() as meter: ...; meter.joules(began, ended)``, in seconds of `time.monotonic`, which on Linux is the
    same clock in every process.
    """

    def __init__(self, root: Path = ROOT, period: float = PERIOD) -> None:
        self.reason = ""
        self._period, self._end = period, threading.Event()
        self._at: list[float] = []
        self._total: list[float] = []
        self._counters: tuple[EnergyCounter, ...] = ()
        try:
            self._counters = counters(root)
        except NoRaplError as error:
            self.reason = str(error)
        self._thread = threading.Thread(target=self._sample, daemon=True)

    @property
    def sources(self) -> str:
        """The names of the counters, for people."""
        return ", ".join(counter.name for counter in self._counters)

    def __enter__(self) -> Meter:
        if self._counters:
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._end.set()
        if self._thread.is_alive():
            self._thread.join()

    def _sample(self) -> None:
        """Sample until the meter closes, and once more then."""
        before: list[int] | None = None
        total, over = 0.0, False
        while True:
            try:
                now = [counter.read() for counter in self._counters]
            except NoRaplError as error:
                self.reason = str(error)
                return
            total += joules(self._counters, before or now, now)
            before = now
            self._total.append(total)
            self._at.append(time.monotonic())
            if over:
                return
            over = self._end.wait(self._period)

    def joules(self, began: float, ended: float) -> float | None:
        """Energy of all counters between two moments; None, with a `reason`, if it is unknown.

        Call it after the meter is closed.
        """
        if self.reason or len(self._at) < 2:
            self.reason = self.reason or "the counters were read for too short a time"
            return None
        if began < self._at[0] or ended > self._at[-1]:
            self.reason = "the counters were not read all the while"
            return None
        first, last = np.interp([began, ended], self._at, self._total)
        return float(last - first)


def idle_watts(seconds: float = 1.0, root: Path = ROOT) -> float | None:
    """Power while this program idles (others may run); None: unknown. It is reported, never subtracted."""
    with Meter(root) as meter:
        began = time.monotonic()
        if not meter.reason:
            time.sleep(seconds)
        ended = time.monotonic()
    spent = meter.joules(began + PERIOD, ended) if not meter.reason else None
    return None if spent is None else spent / (ended - began - PERIOD)
