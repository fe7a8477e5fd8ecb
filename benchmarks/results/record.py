"""docs/results.json: figures by row, section and seed, with hashes of the settings and sources that gave them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.places import PlacesSection
from benchmarks.results.rows import SEEDS, Figures, ResultRow, measure
from lava_vpr.experiments.cache import content_key
from lava_vpr.experiments.grid import compute
from lava_vpr.storage.writing import write_atomically

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "docs" / "results.json"
REMEDY = "run `make results` (LAVA_VPR_DATA names the images), and commit docs/results.json and the pages"

Place = tuple[ResultRow, PlacesSection, int]
"""A point of the grid: a row, one of its sections, and a seed."""


def short_hash(text: str) -> str:
    """A hash of ``text``, 16 digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def settings_hash(row: ResultRow) -> str:
    """A hash of everything that a row says, the preset's settings among it."""
    return short_hash(json.dumps([asdict(row), SEEDS], sort_keys=True))


@cache
def sources(task: Callable[..., Figures]) -> str:
    """A hash of what decides figures: the sources of the modules that a task imports, and pinned versions."""
    return content_key(task, (ROOT / "requirements" / "lock.txt").read_text(encoding="utf-8"))[:16]


@dataclass
class Record:
    """A cache of experiments that is one file: docs/results.json, or none.

    Attributes:
        rows: By the name of a row ``settings``, ``sources`` (hashes) and ``figures`` by section and seed.
        file: Where it is written after each section and seed; None: nowhere.
        task: Computes the figures of a row on a section with a seed.
    """

    rows: dict[str, dict[str, Any]]
    file: Path | None = None
    task: Callable[[ResultRow, PlacesSection, int], Figures] = measure

    @classmethod
    def read(cls, file: Path = FILE, **fields: Any) -> Record:
        """The file; nothing of it where there is none."""
        rows = json.loads(file.read_text(encoding="utf-8"))["rows"] if file.exists() else {}
        return cls(rows, file, **fields)

    def bring_up_to_date(self, rows: Iterable[ResultRow], seeds: Sequence[int] = SEEDS) -> None:
        """Compute what is not known of rows under today's hashes, each on its sections with every seed."""
        compute(
            lambda _, place: self.task(*place),
            [(row, section, seed) for row in rows for section in row.sections for seed in seeds],
            cache=self,
            in_words=lambda place: f"{place[0].name}: {key_of(*place[1:])}",
            advance=lambda done, note: click.echo(note, err=True) if done else None,
        )

    def key(self, place: Place) -> str:
        """Today's hashes of the settings of a row, and of sources."""
        return f"{settings_hash(place[0])} {sources(self.task)}"

    def find(self, place: Place, key: str) -> Figures | None:
        """The figures of a section and a seed that were computed under these hashes; None if there are none."""
        return self._under(place[0], key).get(key_of(*place[1:]))

    def keep(self, place: Place, key: str, figures: Figures) -> None:
        """Take up the figures of a section and a seed, and write the file; under other hashes the row begins anew."""
        settings, sources = key.split()
        known = self._under(place[0], key) | {key_of(*place[1:]): figures}
        self.rows[place[0].name] = {"settings": settings, "sources": sources, "figures": known}
        self.write()

    def _under(self, row: ResultRow, key: str) -> dict[str, Figures]:
        """The figures of a row that were computed under these hashes."""
        kept = self.rows.get(row.name, {})
        return kept["figures"] if [kept.get("settings"), kept.get("sources")] == key.split() else {}

    def write(self) -> None:
        """Write the file, if there is one, a line for every section and seed."""
        if self.file is None:
            return
        rows = []
        for name, row in sorted(self.rows.items()):
            keys = "".join(f'  "{key}": {json.dumps(row[key])},\n' for key in ("settings", "sources"))
            figures = ",\n".join(f"   {json.dumps(key)}: {json.dumps(value)}" for key, value in row["figures"].items())
            rows.append(f' {json.dumps(name)}: {{\n{keys}  "figures": {{\n{figures}\n  }}\n }}')
        text = '{"rows": {\n' + ",\n".join(rows) + "\n}}\n"
        write_atomically(self.file, lambda out: out.write(text.encode()))

    @property
    def origin(self) -> tuple[str, str]:
        """One hash of the settings of all rows, and one of the sources (of all, where they differ)."""
        settings, sources = (sorted({row[part] for row in self.rows.values()}) for part in ("settings", "sources"))
        return short_hash(" ".join(settings)), sources[0] if len(sources) == 1 else short_hash(" ".join(sources))

    def mean(
        self,
        row: ResultRow,
        matcher: str = "network",
        sections: Sequence[PlacesSection] | None = None,
        seeds: Sequence[int] = SEEDS,
    ) -> list[float]:
        """The means of a matcher's figures over sections and seeds; costs are those of the first seed."""
        seeds = SEEDS[:1] if matcher == "costs" else seeds
        chosen = row.sections if sections is None else sections
        figures = self.rows[row.name]["figures"]
        values = [figures[key_of(section, seed)][matcher] for section in chosen for seed in seeds]
        return [float(value) for value in np.mean(values, axis=0)]

    def cell(self, row: ResultRow, matcher: str = "network", sections: Sequence[PlacesSection] | None = None) -> str:
        """R@1, R@100P and AUC as a table has them."""
        return " / ".join(f"{value:.1f}" for value in self.mean(row, matcher, sections))


def key_of(section: PlacesSection, seed: int) -> str:
    """What the figures of a section and a seed are kept under."""
    return f"{section}, seed {seed}"
