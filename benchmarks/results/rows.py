"""A row of results: what is learned, what is asked, and what answers; the one way in which a figure is computed.

The rows, each on its sections with every seed, are a grid of experiments (`lava_vpr.experiments.grid`), whose cache is
docs/results.json: figures by row, section and seed, with hashes of the settings and sources that gave them."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.places import ALL_CORES, PlacesSection, learned, places
from benchmarks.program import ROOT
from lava_vpr.backends.asking import Asking
from lava_vpr.backends.rivals import BASELINES
from lava_vpr.config import Config
from lava_vpr.configfile import to_dict
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.experiments.cache import content_key
from lava_vpr.experiments.grid import compute
from lava_vpr.experiments.task import Route, modelled
from lava_vpr.inputs.views import ViewsConfig
from lava_vpr.matching.decoders import confidence, decode
from lava_vpr.matching.evaluation import Metrics, Recall, evaluate
from lava_vpr.model import Model
from lava_vpr.recognition import Comparison, Recognition, recognise
from lava_vpr.storage.writing import write_atomically

SEEDS = (0, 1, 2)
TAU = 30.0
"""Time constant of adaptation, in queries."""
STANDING = 20
"""Frames that a robot sees of each place where it stands still."""

PRINTED = ", as printed"
"""Behind the name of one of the paper's decoders: as its equations are printed, not as its code was released."""

Figures = dict[str, list[float]]
"""By matcher R@1, R@100P and AUC in percent, ``network`` being the default decoder; ``costs`` are uJ and ms."""


@dataclass(frozen=True)
class ResultRow:
    """What a row of results is computed from; a change of any of it makes it another row.

    Attributes:
        name: Its name in docs/results.json.
        config: Settings; the seed is replaced.
        sections: The sections, one model each.
        matchers: Baselines and decoders that the default decoder is compared with.
        tolerance: Places that an answer may be off.
        sequence: Queries that are matched together.
        adapt: Whether everything is computed adapted to the queries before, too.
        standing: Whether each query is seen `STANDING` times, with a camera's noise on its activity.
        costs: Whether energy and time on Kapoho Bay are modelled, for the first seed.
    """

    name: str
    config: Config
    sections: tuple[PlacesSection, ...]
    matchers: tuple[str, ...] = ()
    tolerance: int = 0
    sequence: int = 1
    adapt: bool = False
    standing: bool = False
    costs: bool = False


def measure(row: ResultRow, section: PlacesSection, seed: int) -> Figures:
    """The figures of one section with one seed.

    Raises:
        InputError: LAVA_VPR_DATA does not name the images.
    """
    model = learned(section, dataclasses.replace(row.config, seed=seed))
    return asked(row, model, section, costs=seed == SEEDS[0])


def asked(row: ResultRow, model: Model, section: PlacesSection, costs: bool = False) -> Figures:
    """The figures of a model of a section."""
    result = _asked(model, row, section)
    found = {"network": _percent(result.metrics[result.default])}
    for name in row.matchers:
        found[name] = _percent(_as_printed(model, result, name) if name.endswith(PRINTED) else result.metrics[name])
    if row.adapt:
        found["network, adapted"] = _percent(result.adapted[result.default])
        found |= {f"{name}, adapted": _percent(result.adapted[name]) for name in row.matchers if name in BASELINES}
    if row.costs and costs:
        found |= _costs(model, section)
    return found


def _as_printed(model: Model, result: Recognition, name: str) -> Metrics:
    """Figures of one of the paper's decoders read as its equations are printed, on the same spikes."""
    name = name.removesuffix(PRINTED)
    scores = decode(name, model.responses, result.counts, variant="printed", gamma=model.config.decoder.gamma)
    return evaluate(scores, confidence(name, scores), result.truth)


def _percent(metrics: Metrics) -> list[float]:
    """What is kept of the figures of a matcher."""
    return [round(100 * value, 4) for value in Recall.of(metrics)]


def _asked(model: Model, row: ResultRow, section: PlacesSection) -> Recognition:
    """What a model makes of the queries of its places."""
    (queries,) = places(section, 1, model.config, ViewsConfig())
    shown = np.repeat(np.arange(len(queries)), STANDING if row.standing else 1)
    truth: NDArray[np.bool_] = np.abs(shown[:, None] - np.arange(len(queries))) <= row.tolerance
    rivals = tuple(name for name in row.matchers if name in BASELINES)
    comparison = Comparison(row.sequence, rivals, None, False, Asking(adapt=TAU if row.adapt else None))
    asked = _standing(queries, section.first) if row.standing else queries
    return recognise(model, asked, truth, comparison, pool=ALL_CORES)


def _standing(queries: EncodedTraverse, seed: int) -> EncodedTraverse:
    """Each query `STANDING` times, with a camera's noise on its activity."""
    order = np.repeat(np.arange(len(queries)), STANDING)
    activity = queries.activity[order]
    noisy = activity * np.random.default_rng(seed).normal(1.0, 0.1, activity.shape).clip(0.5, 1.5)
    return dataclasses.replace(
        queries,
        names=tuple(queries.names[k] for k in order),
        indices=np.arange(len(order)),
        activity=noisy.astype(np.float32),
        patches=None,
        thumbnails=None,
        hog=None,
    )


def _costs(model: Model, section: PlacesSection) -> Figures:
    """Modelled dynamic energy (uJ) and time (ms) of a query on Kapoho Bay: nominal, clearing counted, host I/O not."""
    (queries,) = places(section, 1, model.config, ViewsConfig())
    costs = modelled(model, Route((), queries, np.eye(len(queries), dtype=bool)))
    return {} if costs is None else {"costs": [round(costs.microjoules, 4), round(costs.milliseconds, 5)]}


FILE = ROOT / "docs" / "results.json"
REMEDY = "run `make results` (LAVA_VPR_DATA names the images), and commit docs/results.json and the pages"

Place = tuple[ResultRow, PlacesSection, int]
"""A point of the grid: a row, one of its sections, and a seed."""


def short_hash(text: str) -> str:
    """A hash of ``text``, 16 digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def settings_hash(row: ResultRow) -> str:
    """A hash of everything that a row says, the preset's settings among it."""
    return short_hash(json.dumps([{**asdict(row), "config": to_dict(row.config)}, SEEDS], sort_keys=True))


@cache
def sources(task: Callable[..., Figures]) -> str:
    """A hash of what decides figures: the sources of the modules that a task imports, and pinned versions."""
    return content_key(task, (ROOT / "requirements" / "lock.txt").read_text(encoding="utf-8"))[:16]


@dataclass
class Record:
    """A cache of experiments that is one file: docs/results.json, or none.

    Attributes:
        kept: By `name_of` a place its key and its figures.
        file: Where it is written after each section and seed; None: nowhere.
        task: Computes the figures of a row on a section with a seed.
    """

    kept: dict[str, tuple[str, Figures]]
    file: Path | None = None
    task: Callable[[ResultRow, PlacesSection, int], Figures] = measure

    @classmethod
    def read(cls, file: Path = FILE, **fields: Any) -> Record:
        """The file; nothing of it where there is none."""
        kept = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        return cls({name: (key, figures) for name, (key, figures) in kept.items()}, file, **fields)

    def bring_up_to_date(self, rows: Iterable[ResultRow], seeds: Sequence[int] = SEEDS) -> None:
        """Compute what is not known of rows under today's hashes, each on its sections with every seed."""
        compute(
            lambda _, place: self.task(*place),
            places_of(rows, seeds),
            cache=self,
            in_words=lambda place: name_of(*place),
            advance=lambda done, note: click.echo(note, err=True) if done else None,
        )

    def key(self, place: Place) -> str:
        """Today's hashes of the settings of a row, and of sources."""
        return f"{settings_hash(place[0])} {sources(self.task)}"

    def find(self, place: Place, key: str) -> Figures | None:
        """The figures of a section and a seed that were computed under these hashes; None if there are none."""
        known, figures = self.kept.get(name_of(*place), ("", None))
        return figures if known == key else None

    def keep(self, place: Place, key: str, figures: Figures) -> None:
        """Take up the figures of a section and a seed, and write the file."""
        self.kept[name_of(*place)] = key, figures
        self.write()

    def write(self) -> None:
        """Write the file, if there is one, a line for every section and seed."""
        if self.file is None:
            return
        lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(self.kept[name])}" for name in sorted(self.kept))
        write_atomically(self.file, lambda out: out.write(f"{{\n{lines}\n}}\n".encode()))

    @property
    def origin(self) -> tuple[str, str]:
        """One hash of the settings of all rows, and one of the sources (of all, where they differ)."""
        settings, sources = (
            sorted(set(of)) for of in zip(*(key.split() for key, _ in self.kept.values()), strict=True)
        )
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
        values = [self.kept[name_of(row, section, seed)][1][matcher] for section in chosen for seed in seeds]
        return [float(value) for value in np.mean(values, axis=0)]

    def cell(
        self,
        row: ResultRow,
        matcher: str = "network",
        sections: Sequence[PlacesSection] | None = None,
        figures: int = 3,
    ) -> str:
        """R@1, R@100P and AUC, or the first of these: means over the seeds, then from the least seed to the most.

        No figure is finer than a query among those of the sections.
        """
        shown = STANDING if row.standing else 1
        queries = sum((one.end - one.first) * shown - row.sequence + 1 for one in sections or row.sections)
        seeds = np.array([self.mean(row, matcher, sections, (seed,)) for seed in SEEDS])[:, :figures]
        mean, low, high = (
            [rounded(value, queries) for value in values] for values in (seeds.mean(0), seeds.min(0), seeds.max(0))
        )
        cell = " / ".join(mean)
        return cell if low == high else f"{cell} ({' / '.join(low)} to {' / '.join(high)})"


def rounded(percent: float, queries: int) -> str:
    """A figure in percent to the nearest query of so many, or the nearest tenth where a query is less."""
    one = max(100 / queries, 0.1)
    return f"{one * round(percent / one):.{int(one < 1)}f}"


def name_of(row: ResultRow, section: PlacesSection, seed: int) -> str:
    """What the figures of a row on a section with a seed are kept under."""
    return f"{row.name}: {section}, seed {seed}"


def places_of(rows: Iterable[ResultRow], seeds: Sequence[int] = SEEDS) -> list[Place]:
    """The points of the grid, each row on its sections with every seed."""
    return [(row, section, seed) for row in rows for section in row.sections for seed in seeds]
