"""The one table of beliefs about hardware, against which stand-ins for the vendors' libraries check."""

from __future__ import annotations

from collections.abc import Collection

from lava_vpr.deploy.boards.constants import HOST_POWER, LOIHI_1, Constant
from lava_vpr.deploy.hardware import loihi_1, loihi_2, nxsdk_calls, nxsdk_registers
from lava_vpr.deploy.hardware.belief import Given, HardwareBelief
from lava_vpr.rows.registry import Registry

ASSUMED = frozenset({"host_message", "host_power", "register_time", "word_time"})
"""Constants of the cost model that no public text shows."""

SECTIONS: dict[str, tuple[HardwareBelief, ...]] = {
    "Loihi 1: what a core and the board hold": loihi_1.CORE,
    "Loihi 1: arithmetic": loihi_1.ARITHMETIC,
    "Kapoho Bay: registers of neurons": nxsdk_registers.NEURONS,
    "Kapoho Bay: registers of synapses": nxsdk_registers.SYNAPSES,
    "Kapoho Bay: calls from the host": nxsdk_calls.HOST,
    "Kapoho Bay: power": nxsdk_calls.POWER,
    "Kapoho Bay: the embedded program": nxsdk_calls.EMBEDDED,
    "Loihi 2: what it holds, and how it clears states": loihi_2.CHIP,
    "Loihi 2: Vars of Lava's neurons": loihi_2.LIF,
    "Loihi 2: synapses and learning": loihi_2.SYNAPSES,
    "Loihi 2: input, read-out, measurements": loihi_2.INPUT,
}
"""All rows except those of the cost model, by the sections of docs/hardware.md."""


def _figure(constant: Constant) -> HardwareBelief:
    """The row of a constant of the cost model."""
    assumed = constant.name in ASSUMED
    return HardwareBelief(
        f"{constant.name}: {constant.what}",
        "host" if constant is HOST_POWER else "Loihi 1",
        "figure",
        Given(f"{constant.low:g} / {constant.nominal:g} / {constant.high:g}"),
        constant.unit,
        "modelled energy" if constant.unit in ("pJ", "mW") else "modelled time, and static energy with it",
        None if assumed else constant.source,
        constant.source if assumed else None,
    )


SECTIONS["Cost model of Loihi 1: low / nominal / high"] = tuple(map(_figure, (*LOIHI_1.listed(), HOST_POWER)))

BELIEFS: Registry[HardwareBelief] = Registry("belief about hardware")
"""Every row by its name."""

for _rows in SECTIONS.values():
    for _row in _rows:
        BELIEFS.register(_row)


def unproven_values(name: str) -> tuple[HardwareBelief, ...]:
    """The rows of values of the register ``name`` that no public source shows: ``name`` and a kind in brackets."""
    return tuple(row for key, row in BELIEFS.items() if key.startswith(f"{name} (") and not row.proven)


def kind_of(row: HardwareBelief) -> str:
    """The text in brackets after the name of an unproven row: the word that requests it."""
    return row.name.partition(" (")[2].removesuffix(")")


def relied_on(has: Collection[str]) -> tuple[HardwareBelief, ...]:
    """The unproven rows that a bundle rests on of which all in ``has`` is true (`HardwareBelief.rests`)."""
    return tuple(row for row in BELIEFS.values() if not set(row.rests).isdisjoint(has))


def refusal(name: str, value: int, asked: Collection[str] = ()) -> str:
    """Why the chip is not known to take ``value`` as ``name``; empty if it is known, or if the unproven kind was
    requested.

    Args:
        name: The name of a row.
        value: The value.
        asked: Requested kinds of unproven values (`kind_of`).
    """
    said = BELIEFS[name].refusal(value)
    for row in unproven_values(name) if said else ():
        if row.allows(value):
            kind = kind_of(row)
            return "" if kind in asked else f"{name} {value}: {kind} is shown by no public source; ask for it by name"
    return said
