"""docs/results.json: figures by row, section and seed, with hashes of the settings and sources that gave them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.places import PlacesSection
from benchmarks.results.rows import SEEDS, Figures, ResultRow, measure
from lava_vpr.experiments.cache import sources_hash
from lava_vpr.storage.writing import write_atomically

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "docs" / "results.json"
REMEDY = "run `make results` (LAVA_VPR_DATA names the images), and commit docs/results.json and the pages"


def short_hash(text: str) -> str:
    """A hash of ``text``, 16 digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def settings_hash(row: ResultRow) -> str:
    """A hash of everything that a row says, the preset's settings among it."""
    return short_hash(json.dumps([asdict(row), SEEDS], sort_keys=True))


def sources() -> str:
    """A hash of what decides the figures: the sources of the modules that `measure` imports, and pinned versions."""
    return short_hash(sources_hash(measure) + (ROOT / "requirements" / "lock.txt").read_text(encoding="utf-8"))


@dataclass
class Record:
    """The content of docs/results.json.

    Attributes:
        rows: By the name of a row ``settings``, ``sources`` (hashes) and ``figures`` by section and seed.
    """

    rows: dict[str, dict[str, Any]]

    @classmethod
    def read(cls, file: Path = FILE) -> Record:
        """The file; nothing of it where there is none."""
        return cls(json.loads(file.read_text(encoding="utf-8"))["rows"] if file.exists() else {})

    def write(self, file: Path = FILE) -> None:
        """Write the file, a line for every section and seed."""
        rows = []
        for name, row in sorted(self.rows.items()):
            keys = "".join(f'  "{key}": {json.dumps(row[key])},\n' for key in ("settings", "sources"))
            figures = ",\n".join(f"   {json.dumps(key)}: {json.dumps(value)}" for key, value in row["figures"].items())
            rows.append(f' {json.dumps(name)}: {{\n{keys}  "figures": {{\n{figures}\n  }}\n }}')
        text = '{"rows": {\n' + ",\n".join(rows) + "\n}}\n"
        write_atomically(file, lambda out: out.write(text.encode()))

    def lacks(self, rows: Sequence[ResultRow]) -> list[str]:
        """Names of rows that the file lacks, has under other settings, or has though there is no such row any more."""
        today = {row.name: settings_hash(row) for row in rows}
        kept = {name: row["settings"] for name, row in self.rows.items()}
        return sorted({name for name in today.keys() | kept.keys() if today.get(name) != kept.get(name)})

    def current(self, row: ResultRow, sources: str) -> bool:
        """Whether a row was computed under today's settings and from ``sources``."""
        kept = self.rows.get(row.name)
        return kept is not None and kept["settings"] == settings_hash(row) and kept["sources"] == sources

    @property
    def origin(self) -> tuple[str, str]:
        """One hash of the settings of all rows, and one of the sources (of all, where they differ)."""
        settings, sources = (sorted({row[part] for row in self.rows.values()}) for part in ("settings", "sources"))
        return short_hash(" ".join(settings)), sources[0] if len(sources) == 1 else short_hash(" ".join(sources))

    def put(self, row: ResultRow, sources: str, figures: dict[str, Figures]) -> None:
        """Take up a row that was computed; ``figures`` by section and seed, as `key` writes them."""
        self.rows[row.name] = {"settings": settings_hash(row), "sources": sources, "figures": figures}

    def figures(self, row: ResultRow, section: PlacesSection, seed: int) -> Figures:
        """The figures of one section with one seed."""
        found: Figures = self.rows[row.name]["figures"][key(section, seed)]
        return found

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
        values = [self.figures(row, section, seed)[matcher] for section in chosen for seed in seeds]
        return [float(value) for value in np.mean(values, axis=0)]

    def cell(self, row: ResultRow, matcher: str = "network", sections: Sequence[PlacesSection] | None = None) -> str:
        """R@1, R@100P and AUC as a table has them."""
        return " / ".join(f"{value:.1f}" for value in self.mean(row, matcher, sections))


def key(section: PlacesSection, seed: int) -> str:
    """What the figures of a section and a seed are kept under."""
    return f"{section}, seed {seed}"
