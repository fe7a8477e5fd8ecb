"""The parts of docs/security.md that the code decides: limits, ranges of settings, arrays of a model (`make pages`)."""

from __future__ import annotations

from lava_vpr.config import preset
from lava_vpr.configfile import sections
from lava_vpr.modelfile import Sizes, array_rules
from lava_vpr.settings.ranges import declared
from lava_vpr.storage.arrays import ArrayRule
from lava_vpr.storage.limits import LIMITS, variable


def limits() -> str:
    """The table of all limits."""
    rows = [f"| `{variable(name)}` | {row.default:,} {row.unit} | {row.reason} |" for name, row in LIMITS.items()]
    return "\n".join(["| variable | default | why so much |", "|---|---|---|", *rows])


def settings() -> str:
    """The table of the ranges of all settings."""
    rows = ["| section | settings and their ranges |", "|---|---|"]
    for section, name in sections().items():
        ranges = [f"`{key}` {setting}".replace(" in ", " ") for key, setting in declared(section).items()]
        rows.append(f"| {f'`[{name}]`' if name else ''} `{section.__name__}` | {', '.join(ranges)} |")
    return "\n".join(rows)


class Axis(int):
    """A length that a table shows by its name."""

    name: str

    @classmethod
    def called(cls, name: str, length: int) -> Axis:
        """The axis ``name``, of some length."""
        axis = cls(length)
        axis.name = name
        return axis


def arrays() -> str:
    """The table of what every array of a model must be, with the integer network and with preset ``paper``."""
    sizes = Sizes(*(Axis.called(name, 200 if name == "images" else 100) for name in Sizes._fields))
    rows = ["| array | with preset | type and shape | values |", "|---|---|---|---|"]
    both = {name: array_rules(preset(name), sizes) for name in ("loihi", "paper")}
    for array in sorted({array for rules in both.values() for array in rules}):
        found = {name: _written(rules[array]) for name, rules in both.items() if array in rules}
        if len(found) == 2 and len(set(found.values())) == 1:
            found = {"any": found["loihi"]}
        rows += [f"| `{array}` | {name} | {rule} |" for name, rule in found.items()]
    return "\n".join(rows)


def _written(rule: ArrayRule) -> str:
    shape = ", ".join(getattr(length, "name", str(length)) for length in rule.shape)
    return f"{rule.dtype} ({shape}) | {rule.least:g} .. {rule.most:g}"


PARTS = {"limits": limits, "settings": settings, "arrays": arrays}
