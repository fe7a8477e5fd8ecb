"""Figures of finished sections, kept in a folder, so that a run that was interrupted goes on where it was."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from lava_vpr.errors import InputError
from lava_vpr.paper_table.sections import Figures, Task
from lava_vpr.storage.reading import parse_json, read_bytes
from lava_vpr.storage.text import shown
from lava_vpr.storage.writing import write_atomically


@dataclass(frozen=True)
class Kept:
    """A folder with a file for each section and network.

    Attributes:
        folder: The folder, made when the first section is kept; None: nothing is kept.
    """

    folder: Path | None

    def file(self, task: Task) -> Path | None:
        """Where the figures of ``task`` are kept."""
        if self.folder is None:
            return None
        return self.folder / f"{task.dataset}-{task.network}-{task.section:02d}-seed-{task.seed}.json"

    def find(self, task: Task, key: str) -> dict[str, Figures] | None:
        """The figures of a section, if they were made under the same fingerprint ``key``; None if not, or unreadable.

        What cannot be read is computed anew: nothing in it is trusted but figures of the form that is written.
        """
        path = self.file(task)
        if path is None or not path.is_file():
            return None
        try:
            values = parse_json(read_bytes(path, "text_bytes"))
            if values["fingerprint"] != key:
                return None
            return {str(name): _figures(row) for name, row in values["figures"].items()}
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            return None

    def keep(self, task: Task, key: str, figures: dict[str, Figures]) -> None:
        """Keep the figures of a section.

        Raises:
            InputError: the folder or file cannot be written.
        """
        path = self.file(task)
        if path is None:
            return
        values = {"fingerprint": key, "figures": {name: list(row) for name, row in figures.items()}}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, lambda file: file.write((json.dumps(values) + "\n").encode()))
        except OSError as error:
            raise InputError(
                f"{shown(path)}: cannot be kept ({error.strerror}); name another folder with --keep"
            ) from None


def _figures(row: list[float]) -> Figures:
    """Figures as they were kept.

    Raises:
        ValueError: they are none.
    """
    values = [float(value) for value in row]
    if len(values) != len(Figures._fields) or not all(0.0 <= value <= 1.0 for value in values):
        raise ValueError("no figures")
    return Figures(*values)
