"""A belief about hardware: a limit, an arithmetic, a register, a call or a figure, with or without a source."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from lava_vpr import loihi

BIAS_INPUT, DENSE, LEARNING = "inputs integrate a bias", "rows without indices", "the network that learns"
NARROW, LONG = "weights of fewer than 8 bits", "long presentations"
"""Properties that some bundles have, for `HardwareBelief.rests`."""

Kind = Literal["limit", "arithmetic", "register", "call", "figure"]
"""The subject of a belief. A ``limit`` is a largest number of something, a ``figure`` an energy, a time or a power."""


@dataclass(frozen=True)
class Span:
    """Whole numbers from ``low`` to ``high``, both included."""

    low: int
    high: int

    def __str__(self) -> str:
        return f"{self.low:,} to {self.high:,}"


@dataclass(frozen=True)
class Given:
    """The value of a belief that is not one of `lava_vpr.loihi`'s constants, in words."""

    text: str

    def __str__(self) -> str:
        return self.text


Value = int | float | str | Span | Given | tuple[int, ...] | dict[int, float]


@dataclass(frozen=True)
class HardwareBelief:
    """A row of the table of hardware.

    Attributes:
        name: The register, limit or call.
        on: The chip, board or software.
        kind: The subject of the belief.
        value: The believed value; `constants` where it is a constant's.
        unit: The unit of the value; None where it has none.
        breaks: The consequence of a wrong belief.
        source: The public text that shows the value; None: unproven.
        why: For an unproven belief, the reason to hold it, or what is missing; None where there is a source.
        constants: The names in `lava_vpr.loihi` that hold the value, so that it is written only once.
        rests: For an unproven belief, the bundles that rest on it: all of a chip, ``"Loihi 1"``, or those with a
            property, ``"Loihi 1: bias input"`` (`lava_vpr.deploy.bundle.deployment.unproven`).
    """

    name: str
    on: str
    kind: Kind
    value: Value
    unit: str | None
    breaks: str
    source: str | None = None
    why: str | None = None
    constants: tuple[str, ...] = ()
    rests: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if (self.source is None) == (self.why is None):
            raise TypeError(f"{self.name}: give a source, or why it is believed without one")
        if self.proven and self.rests:
            raise TypeError(f"{self.name}: has a source, so no bundle is said to rest on it without one")

    @property
    def proven(self) -> bool:
        """Whether a public text shows the value."""
        return self.source is not None

    @property
    def shown(self) -> str:
        """The value in words."""
        return _text(self.value)

    @property
    def evidence(self) -> str:
        """The source, or the word unproven with the reason for the belief."""
        return self.source or f"**unproven**: {self.why}"

    def allows(self, value: int) -> bool:
        """Whether the chip takes ``value``: a believed value, or one within a limit."""
        if isinstance(self.value, Span):
            return self.value.low <= value <= self.value.high
        if isinstance(self.value, tuple):
            return value in self.value
        if isinstance(self.value, bool) or not isinstance(self.value, int):
            raise TypeError(f"{self.name} is {self.shown}, which no number can be compared with")
        return 0 <= value <= self.value if self.kind == "limit" else value == self.value

    def refusal(self, value: int) -> str:
        """Why ``value`` is refused; empty if it is not."""
        if self.allows(value):
            return ""
        most = "more than" if self.kind == "limit" else "not"
        return f"{self.name} {value:,} is {most} {self.shown} ({self.source or f'unproven: {self.why}'})"


def _text(value: object) -> str:
    """A value, or several, in words."""
    if isinstance(value, dict):
        return ", ".join(f"{key}: {_text(number)}" for key, number in value.items())
    if isinstance(value, (Span, Given)):
        return str(value)
    if isinstance(value, tuple):
        return ", ".join(map(_text, value))
    if isinstance(value, int):
        return f"{value:,}"
    return f"{value:g}" if isinstance(value, float) else str(value)


def of_constants(
    name: str,
    on: str,
    kind: Kind,
    at: str,
    unit: str | None,
    breaks: str,
    source: str | None = None,
    why: str | None = None,
    rests: tuple[str, ...] = (),
) -> HardwareBelief:
    """A belief whose value is that of the constants ``at``, names in `lava_vpr.loihi` with blanks between them.

    One number, or several widths, are the value itself; numbers of several constants become a list for people.
    """
    names = tuple(at.split())
    values = [getattr(loihi, each) for each in names]
    value: Value = values[0] if len(values) == 1 else Given(", ".join(map(_text, values)))
    if isinstance(value, range):
        value = Span(value.start, value.stop - 1)
    return HardwareBelief(name, on, kind, value, unit, breaks, source, why, names, rests)
