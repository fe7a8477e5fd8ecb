"""Registers that can be written once, by their names, as the table of hardware allows, and not read before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np

from lava_vpr.deploy.hardware.table import BELIEFS, refusal
from nxsdk_standin.faults import FAULTS, StandinError

Rows = Mapping[str, str]
"""The row of the table of hardware that each field of a register has, by the field's name."""


class Register:
    """One register with named fields."""

    def __init__(self, where: str, fields: Rows, inner: Mapping[str, Rows] | None = None) -> None:
        object.__setattr__(self, "where", where)
        object.__setattr__(self, "fields", fields)
        object.__setattr__(self, "values", {})
        for name, rows in (inner or {}).items():
            object.__setattr__(self, name, Register(f"{where}.{name}", rows))

    def configure(self, **values: Any) -> None:
        """Write fields."""
        for name, value in values.items():
            setattr(self, name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in self.fields:
            raise StandinError(f"{self.where} has no field {name}")
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
            raise StandinError(f"{self.where}.{name} is a {type(value).__name__}, not an integer")
        said = refusal(self.fields[name], int(value), FAULTS.asked)
        if said:
            raise StandinError(f"{self.where}: {said}")
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

    def __init__(self, where: str, size: int, fields: Rows, inner: Mapping[str, Rows] | None = None) -> None:
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


@cache
def fields_of(register: str) -> Rows:
    """The rows of the fields of ``register`` that a public program writes."""
    found = {name.removeprefix(f"{register}."): name for name in BELIEFS if name.startswith(f"{register}.")}
    return {field: name for field, name in found.items() if field.isidentifier()}


def held(limit: str) -> int:
    """The value of a limit."""
    value = BELIEFS[limit].value
    if not isinstance(value, int):
        raise StandinError(f"{limit} is no number")
    return value
