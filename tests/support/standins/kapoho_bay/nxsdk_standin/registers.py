"""Registers that can be written once, by their names, within their ranges, and not read before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from nxsdk_standin.faults import StandinError

Ranges = Mapping[str, tuple[int, int]]


class Register:
    """One register with named fields."""

    def __init__(self, where: str, fields: Ranges, inner: Mapping[str, Ranges] | None = None) -> None:
        object.__setattr__(self, "where", where)
        object.__setattr__(self, "fields", fields)
        object.__setattr__(self, "values", {})
        for name, ranges in (inner or {}).items():
            object.__setattr__(self, name, Register(f"{where}.{name}", ranges))

    def configure(self, **values: Any) -> None:
        """Write fields."""
        for name, value in values.items():
            setattr(self, name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in self.fields:
            raise StandinError(f"{self.where} has no field {name}")
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
            raise StandinError(f"{self.where}.{name} is a {type(value).__name__}, not an integer")
        low, high = self.fields[name]
        if not low <= value <= high:
            raise StandinError(f"{self.where}.{name} {value} is not in {low}..{high}")
        if name in self.values:
            raise StandinError(f"{self.where}.{name} is written twice")
        self.values[name] = int(value)

    def __getattr__(self, name: str) -> int:
        if name not in self.fields:
            raise StandinError(f"{self.where} has no field {name}")
        if name not in self.values:
            raise StandinError(f"{self.where}.{name} is used but was not configured")
        return int(self.values[name])


class Array:
    """Registers by number; those that were touched."""

    def __init__(self, where: str, size: int, fields: Ranges, inner: Mapping[str, Ranges] | None = None) -> None:
        self.where, self.size, self.fields, self.inner = where, size, fields, inner
        self.used: dict[int, Register] = {}

    def __getitem__(self, number: int) -> Register:
        if isinstance(number, bool) or not isinstance(number, (int, np.integer)) or not 0 <= number < self.size:
            raise StandinError(f"{self.where}[{number!r}] is not in 0..{self.size - 1}")
        if number not in self.used:
            self.used[int(number)] = Register(f"{self.where}[{number}]", self.fields, self.inner)
        return self.used[int(number)]

    def __iter__(self) -> Iterator[Register]:
        return iter(self.used[number] for number in sorted(self.used))

    def contiguous(self) -> int:
        """How many there are, numbered from 0 without a gap."""
        if sorted(self.used) != list(range(len(self.used))):
            raise StandinError(f"{self.where}: {len(self.used)} are used, but not the first ones")
        return len(self.used)


PROFILE = {
    "decayU": (0, 4095),
    "decayV": (0, 4095),
    "refractDelay": (1, 63),
    "enableNoise": (0, 1),
    "bapAction": (0, 1),
}
THRESHOLD = {"vth": (1, (1 << 17) - 1)}
FORMAT = {
    **dict.fromkeys(
        ("wgtLimitMant", "wgtLimitExp", "discMaxWgt", "learningCfg", "skipBits", "synType", "stdpProfile"), (0, 15)
    ),
    **{"wgtExp": (-7, 7), "tagBits": (0, 3), "dlyBits": (0, 7), "wgtBits": (1, 7), "reuseSynData": (0, 1)},
    **{"numSynapses": (0, 63), "cIdxOffset": (0, 15), "cIdxMult": (0, 15), "idxBits": (0, 7), "fanoutType": (1, 3)},
    **{"compression": (0, 3), "ignoreDly": (0, 1)},
}
SHARED = {"posVmLimit": (0, 7), "negVmLimit": (0, 23)}
COMPARTMENT = {"bias": (-4095, 4095), "biasExp": (0, 7), "vthProfile": (0, 7), "cxProfile": (0, 31)}
PHASES = dict.fromkeys(("phase0", "phase1", "phase2", "phase3"), (0, 3))
SYNAPSE = {"CIdx": (0, 1023), "Wgt": (-256, 255), "synFmtId": (1, 15), "LrnEn": (0, 1)}
MAP = {"synapsePtr": (0, 1 << 20), "synapseLen": (1, 1 << 12)}
UPDATES = {"numUpdates": (0, 256), "numStdp": (0, 0)}
EPOCH = {"tepoch": (0, 63)}
