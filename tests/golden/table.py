"""The cases: rows of the tables in ``cases/``, one table a theme, and what each of them starts from.

A row is a name and a command. ``>>>`` before it says that it is Python, ``$`` that it is a program in a process of its
own; ``< NAME`` at its end connects standard input. Indented lines go on with the row above them.

A row of ``made.txt`` is named like the file or folder that it writes: whoever names that file finds it, and all that
was written beside it, in the folder in which it runs. So it is with the inputs of `golden.inputs`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

from golden.inputs import INPUTS, Changed

FOLDER = Path(__file__).parent / "cases"
MADE = "made"
IMAGES = "real images: set LAVA_VPR_DATA"
PROCESSOR = "AVX-512: numpy's logarithms, of which events are drawn, differ in their last bits without"


@dataclass(frozen=True)
class Case:
    """A row of the table ``theme``."""

    theme: str
    name: str
    command: str

    @property
    def key(self) -> str:
        """What the record calls it."""
        return f"{self.theme}/{self.name}"

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """Names of the `INPUTS` that it starts from, and of those from which these are made."""
        return tuple(name for name in _named(self.command) if name in INPUTS)

    @cached_property
    def needs(self) -> tuple[str, ...]:
        """Names of the rows of ``made.txt`` whose files it starts from."""
        return tuple(name for name in _named(self.command) if made().get(name, self) is not self)

    @cached_property
    def wants(self) -> frozenset[str]:
        """What it wants of the machine: `IMAGES`, `PROCESSOR`."""
        images = re.search(r"\bdata/", self.command) is not None
        events = self.command.startswith("synth") and "--events" in self.command
        own = {name for name, wanted in ((IMAGES, images), (PROCESSOR, events)) if wanted}
        return frozenset(own).union(*(made()[name].wants for name in self.needs))


@cache
def cases() -> tuple[Case, ...]:
    """All rows of all tables."""
    found = []
    for path in sorted(FOLDER.glob("*.txt")):
        text = re.sub(r"^#.*\n", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
        for row in re.findall(r"^\S.*\n(?:(?:[ ].*)?\n)*", text, re.MULTILINE):
            name, command = re.split(r"\s+", row, maxsplit=1)
            found.append(Case(path.stem, name, command.strip()))
    return tuple(found)


@cache
def made() -> dict[str, Case]:
    """The rows of ``made.txt`` by their names."""
    return {case.name: case for case in cases() if case.theme == MADE}


@cache
def _pattern() -> re.Pattern[str]:
    """Any name of an input or of what is made, at the beginning of a path."""
    names = sorted({*INPUTS, *made()}, key=len, reverse=True)
    return re.compile(rf"(?<![\w./-])({'|'.join(map(re.escape, names))})(?![\w.-])")


def _named(text: str) -> list[str]:
    """Names of inputs and of what is made that a text has, and those that the inputs' own texts have."""
    found: dict[str, None] = {}
    for name in _pattern().findall(text):
        found[name] = None
        found.update(dict.fromkeys(_named(_text(INPUTS.get(name)))))
    return list(found)


def _text(value: object) -> str:
    """What an input says of others."""
    if isinstance(value, Changed):
        return value.source
    if isinstance(value, dict):
        return " ".join(map(_text, value.values()))
    return value if isinstance(value, str) else ""
