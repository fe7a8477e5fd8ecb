"""docs/results.json: figures by row, section and seed, with hashes of the settings and sources that gave them."""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.results.places import Section
from benchmarks.results.rows import SEEDS, Figures, Row
from lava_vpr.storage.writing import write_atomically

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "docs" / "results.json"
REMEDY = "run `make results` (LAVA_VPR_DATA names the images), and commit docs/results.json, its page and README.md"
DECIDING = (
    *(f"lava_vpr/{name}.py" for name in ("config", "encoding", "loihi", "model", "recognition", "traverse")),
    *(f"lava_vpr/{room}" for room in ("images", "inputs", "matching", "settings", "training")),
    *(f"lava_vpr/engine/{name}" for name in ("general", "inference", "learning")),
    *(f"lava_vpr/engine/{name}.py" for name in ("adaptation", "draw", "random", "trains")),
    *(f"lava_vpr/backends/{name}.py" for name in ("asking", "host", "interface", "rivals")),
    "lava_vpr/experiments/points.py",
    *(f"deploy/{room}" for room in ("boards", "compression", "cost", "mapping")),
    "benchmarks/results/places.py",
    "benchmarks/results/rows.py",
    "requirements/lock.txt",
)
"""Modules and rooms that decide the figures, beside the settings, which each row's own hash covers."""
SIMPLER_TITLES = {"template": "without learning", "cosine": "`cosine`", "hog": "HOG", "sad": "SAD"}


def short_hash(text: str) -> str:
    """A hash of ``text``, 16 digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def settings_hash(row: Row) -> str:
    """A hash of everything that a row says, the preset's settings among it."""
    return short_hash(json.dumps([asdict(row), SEEDS], sort_keys=True))


def _code(path: Path) -> str:
    """What a source does: its syntax tree without docstrings, comments and layout; another file's text."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        return text
    tree = ast.parse(text)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [part for part in body if not _is_text(part)]  # type: ignore[attr-defined]
    return ast.dump(tree)


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def sources_hash(root: Path = ROOT) -> str:
    """A hash of the sources that decide the figures; docstrings, comments and layout do not count."""
    found = []
    for name in DECIDING:
        place = root / name
        found += sorted(place.rglob("*.py")) if place.is_dir() else [place]
    return short_hash("\n".join(f"{path.relative_to(root)} {_code(path)}" for path in found))


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

    def lacks(self, rows: Sequence[Row]) -> list[str]:
        """Names of rows that the file lacks, has under other settings, or has though there is no such row any more."""
        today = {row.name: settings_hash(row) for row in rows}
        kept = {name: row["settings"] for name, row in self.rows.items()}
        return sorted({name for name in today.keys() | kept.keys() if today.get(name) != kept.get(name)})

    def current(self, row: Row, sources: str) -> bool:
        """Whether a row was computed under today's settings and from ``sources``."""
        kept = self.rows.get(row.name)
        return kept is not None and kept["settings"] == settings_hash(row) and kept["sources"] == sources

    @property
    def origin(self) -> tuple[str, str]:
        """One hash of the settings of all rows, and one of the sources (of all, where they differ)."""
        settings, sources = (sorted({row[part] for row in self.rows.values()}) for part in ("settings", "sources"))
        return short_hash(" ".join(settings)), sources[0] if len(sources) == 1 else short_hash(" ".join(sources))

    def put(self, row: Row, sources: str, figures: dict[str, Figures]) -> None:
        """Take up a row that was computed; ``figures`` by section and seed, as `key` writes them."""
        self.rows[row.name] = {"settings": settings_hash(row), "sources": sources, "figures": figures}

    def figures(self, row: Row, section: Section, seed: int) -> Figures:
        """The figures of one section with one seed."""
        found: Figures = self.rows[row.name]["figures"][key(section, seed)]
        return found

    def mean(
        self,
        row: Row,
        matcher: str = "network",
        sections: Sequence[Section] | None = None,
        seeds: Sequence[int] = SEEDS,
    ) -> list[float]:
        """The means of a matcher's figures over sections and seeds; costs are those of the first seed."""
        seeds = SEEDS[:1] if matcher == "costs" else seeds
        chosen = row.sections if sections is None else sections
        values = [self.figures(row, section, seed)[matcher] for section in chosen for seed in seeds]
        return [float(value) for value in np.mean(values, axis=0)]

    def cell(self, row: Row, matcher: str = "network", sections: Sequence[Section] | None = None) -> str:
        """R@1, R@100P and AUC as a table has them."""
        return " / ".join(f"{value:.1f}" for value in self.mean(row, matcher, sections))


def key(section: Section, seed: int) -> str:
    """What the figures of a section and a seed are kept under."""
    return f"{section}, seed {seed}"
