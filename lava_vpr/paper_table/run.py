"""The whole table: sections that are kept, sections that are computed, and rows that say why they are absent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.datasets.layouts import DATASETS, Dataset
from lava_vpr.errors import InputError
from lava_vpr.experiments.grid import Advance, Outcome, Spread, compute, ignored, rows
from lava_vpr.paper_table.methods import DESCRIPTORS, METHODS, NETWORKS, Method, printed
from lava_vpr.paper_table.sections import SectionTask, Source, kept_in, measure, read, tasks


@dataclass(frozen=True)
class PaperRequest:
    """What the table is computed from.

    Attributes:
        sources: The datasets that are at hand, by name.
        descriptors: Files of descriptors of references and queries, by dataset.
        networks: Names in `NETWORKS`.
        sections: Numbers of the sections, from 1; empty: all that the images are enough for.
        seed: Of start weights and spikes.
        epochs: Times that every image is shown; None: as often as each preset says.
    """

    sources: Mapping[str, Source]
    descriptors: Mapping[str, tuple[Path, Path]] = field(default_factory=dict)
    networks: tuple[str, ...] = NETWORKS
    sections: tuple[int, ...] = ()
    seed: int = 0
    epochs: int | None = None

    def sections_of(self, source: Source) -> tuple[int, ...]:
        """The sections of a dataset that are wanted and that its images are enough for."""
        there = range(1, source.sections + 1)
        return tuple(number for number in there if not self.sections or number in self.sections)

    def tasks(self) -> list[SectionTask]:
        """All tasks, the quick networks first.

        Raises:
            InputError: descriptors that cannot be used, or no section at all.
        """
        found = [
            task
            for network in NETWORKS
            if network in self.networks
            for name, source in self.sources.items()
            for task in tasks(
                source, network, self.sections_of(source), self.seed, self.epochs, self.descriptors.get(name)
            )
        ]
        for name, source in self.sources.items():
            if not self.sections_of(source):
                raise InputError(
                    f"--sections: none of them is among sections 1 to {source.sections} of {name}, for which the "
                    "images are enough; name others"
                )
        return found


@dataclass(frozen=True)
class MethodRow:
    """A method on a dataset.

    Attributes:
        method: The method.
        printed: Mean R@100P that the paper prints, a fraction; None: it prints none.
        figures: Each of `FIGURES` over the sections, by their number from 1; empty if absent.
        left: Sections that are wanted and were not computed.
        absent: Why there are no figures; None if there are.
    """

    method: Method
    printed: float | None
    figures: Mapping[str, Spread]
    left: tuple[int, ...]
    absent: str | None

    @property
    def sections(self) -> tuple[int, ...]:
        """The numbers of the sections that were computed."""
        return tuple(self.figures["released"].by_seed) if self.figures else ()


@dataclass(frozen=True)
class DatasetRows:
    """The rows of a dataset.

    Attributes:
        dataset: Its row.
        source: Where its images are; None: it is absent.
        rows: A row for each method.
    """

    dataset: Dataset
    source: Source | None
    rows: tuple[MethodRow, ...]


def paper_table(
    wanted: PaperRequest,
    keep: Path | None = None,
    *,
    pool: Pool = ONE_THREAD,
    kept_only: bool = False,
    advance: Advance = ignored,
) -> tuple[DatasetRows, ...]:
    """Compute the table, or what is not kept of it: a part for each dataset of the paper.

    Args:
        wanted: What it is computed from.
        keep: The folder of the figures of finished sections; None: they are not kept.
        pool: Who measures, a thread one section at a time; a cluster's are read here. It changes no figure.
        kept_only: Compute nothing: take what is kept.
        advance: Called after each section.
    Raises:
        LavaVprError: images or descriptors that cannot be used, or figures that cannot be kept.
    """
    found = compute(
        measure,
        wanted.tasks(),
        cache=None if keep is None else kept_in(keep),
        kept_only=kept_only,
        read=read,
        called="sections",
        in_words=lambda task: task.in_words,
        pool=pool,
        advance=advance,
    )
    by_dataset = rows(Outcome(task.dataset, None, task.section, figures) for task, figures in found.items())
    figures = {row.label: row.figures for row in by_dataset}
    return tuple(_part(row, wanted, figures.get(row.name, {})) for row in DATASETS.values())


def _part(dataset: Dataset, wanted: PaperRequest, figures: Mapping[str, Mapping[str, Spread]]) -> DatasetRows:
    """The rows of a dataset, with the figures of each method."""
    source = wanted.sources.get(dataset.name)
    there = () if source is None else wanted.sections_of(source)
    made = []
    for method in METHODS.values():
        said, own = printed(dataset.name, method.name), figures.get(method.name, {})
        absent = None if own else _absent(dataset.name, source, method, wanted)
        done = own["released"].by_seed if own else ()
        left = tuple(number for number in there if number not in done)
        made.append(MethodRow(method, None if said is None else said / 100, own, left, absent))
    return DatasetRows(dataset, source, tuple(made))


def _absent(name: str, source: Source | None, method: Method, wanted: PaperRequest) -> str:
    """Why a method has no figures on a dataset."""
    if source is None:
        return f"no images are given (--dataset {name}=DIR); lava-vpr datasets {name} says what to download"
    if method.network not in wanted.networks:
        return f"left out: --only names other networks than {method.network}"
    if method.network == DESCRIPTORS and name not in wanted.descriptors:
        return f"no descriptors are given (--descriptors {name}=REF.npy,QUERY.npy)"
    return "not computed: --kept-only takes what is kept, and nothing is"


def counted(sections: Sequence[int]) -> str:
    """Numbers of sections as text: ranges with commas between, for instance ``1 to 3, 7``."""
    runs = groupby(enumerate(sections), lambda pair: pair[1] - pair[0])
    parts = ([number for _, number in run] for _, run in runs)
    return ", ".join(str(part[0]) if len(part) == 1 else f"{part[0]} to {part[-1]}" for part in parts)
