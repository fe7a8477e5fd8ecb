"""Which traverses and which of their images are in use: a benchmark dataset's, or those that a user names; and what
there is of a dataset, compared with what the paper needs of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from lava_vpr.datasets.layouts import Dataset, DatasetLayout, OpenedDataset, check_lengths, find_layout
from lava_vpr.errors import InputError, UsageError, shown
from lava_vpr.traverse import Traverse, open_traverse


@dataclass(frozen=True)
class Selection:
    """Where traverses lie, and which of their images are in use: of a benchmark dataset, or as the user says.

    Attributes:
        sources: Folder, list, video or file of vectors of each traverse.
        every: Seconds between two frames of a video.
        opened: The dataset, if they are one's.
        section: One of its sections, from 1; None: all places.
    """

    sources: tuple[str, ...]
    every: float
    opened: OpenedDataset | None = None
    section: int | None = None

    @property
    def by_position(self) -> bool:
        """Whether the traverses are a dataset's of which order tells nothing."""
        return self.opened is not None and self.opened.layout.ground_truth == "positions"

    def sampled(self, whole: Sequence[Traverse], places: tuple[int, int] | None) -> list[Traverse]:
        """The images of ``whole`` traverses that are in use: those of ``places``, or the dataset's sampling.

        Raises:
            InputError: there are too few, or unequally many where image k must show the same place.
        """
        if self.opened is None:
            return [traverse.between(*places) if places else traverse for traverse in whole]
        check_lengths(self.opened, whole)
        return [self.opened.sampled(traverse) for traverse in whole]

    def spacing(self, asked: float | None, traverses: Sequence[Traverse]) -> float | None:
        """Metres between two places: what the user asks, or the dataset's own.

        Raises:
            InputError: the dataset's places need positions, and some traverse has none.
        """
        if self.opened is None or not self.opened.layout.needs_positions:
            return asked
        blind = [shown(traverse.source) for traverse in traverses if traverse.positions is None]
        if blind:
            each = " once for each of the traverses, in this order" if len(traverses) > 1 else ""
            raise InputError(
                f"{', '.join(blind)}: only positions tell which images are the places of "
                f"{self.opened.dataset.title}; give --positions FILE{each}"
            )
        return self.opened.layout.spacing if asked is None else asked

    def of_section(self, chosen: Sequence[Traverse]) -> list[Traverse]:
        """The places of the section; all, where none is asked for.

        Raises:
            InputError: the places do not reach so far.
        """
        if self.opened is None or self.section is None:
            return list(chosen)
        return [self.opened.of_section(traverse, self.section) for traverse in chosen]


@dataclass(frozen=True)
class Benchmark:
    """What a user says of a benchmark dataset.

    Attributes:
        name: Its name in `DATASETS`; None: the sources are the user's own.
        section: One of its sections, from 1; None: all places.
    Raises:
        UsageError: a section of no dataset.
    """

    name: str | None = None
    section: int | None = None

    def __post_init__(self) -> None:
        if self.section is not None and self.name is None:
            raise UsageError("--section is one of a dataset's; give --dataset NAME, or --places A:B")

    def learned(self, sources: Sequence[str], every: float, **excluded: Any) -> Selection:
        """Where the reference traverses lie.

        Args:
            sources: What the user gave: traverses, or the dataset's one folder.
            every: Seconds between two frames of a video, of traverses that are the user's own.
            excluded: Values of options that exclude a dataset, by their names.
        Raises:
            InputError: the dataset does not lie there, or has no such section.
            UsageError: there are several folders, or options that exclude a dataset.
        """
        if self.name is None:
            return Selection(tuple(sources), every)
        if len(sources) != 1:
            raise UsageError(f"--dataset takes one folder, which holds the dataset; {len(sources)} are given")
        opened = self._opened(sources[0], excluded)
        return Selection(tuple(map(str, opened.references)), opened.layout.every, opened, self.section)

    def recognised(self, source: str, every: float, **excluded: Any) -> Selection:
        """Where the query traverse lies; arguments and errors as in `learned`."""
        if self.name is None:
            return Selection((source,), every)
        opened = self._opened(source, excluded)
        if self.section is not None and opened.layout.ground_truth == "positions":
            raise UsageError("the queries are the images nearest to the model's places; leave out --section")
        return Selection((str(opened.query),), opened.layout.every, opened, self.section)

    def _opened(self, root: str, excluded: dict[str, Any]) -> OpenedDataset:
        given = [f"--{name.replace('_', '-')}" for name, value in excluded.items() if value]
        if given:
            raise UsageError(f"--dataset selects the images; leave out {', '.join(given)}")
        opened = find_layout(self.name or "", root)
        if self.section is not None:
            opened.dataset.section(self.section)
        return opened


class Seen(NamedTuple):
    """What was seen of one traverse.

    Attributes:
        folder: Its folder, video or list, below the dataset's root as the layout has it.
        images: Images in all; 0 if it cannot be read.
        in_use: Images that sampling leaves.
        size: Width and height of its first image in pixels; None if that cannot be read.
    """

    folder: str
    images: int
    in_use: int
    size: tuple[int, int] | None


@dataclass(frozen=True)
class Check:
    """A dataset on disk beside what the paper needs of it.

    Attributes:
        dataset: Its row.
        traverses: What was seen of each traverse, references first.
        places: Places that the images give; None where positions decide.
        sections: The paper's sections that they are enough for; None where positions decide.
        differs: What is otherwise than it must or should be, a sentence each.
        usable: Whether at least one section can be learned and recognised.
    """

    dataset: Dataset
    traverses: tuple[Seen, ...]
    places: int | None
    sections: int | None
    differs: tuple[str, ...]
    usable: bool

    def as_json(self) -> dict[str, Any]:
        """The check as plain values, without paths."""
        return {
            "dataset": self.dataset.name,
            "traverses": [
                {"folder": seen.folder, "images": seen.images, "in_use": seen.in_use, "size": seen.size}
                for seen in self.traverses
            ],
            "places": self.places,
            "sections": self.sections,
            "sections_of_the_paper": self.dataset.sections,
            "differs": list(self.differs),
            "usable": self.usable,
        }


def check(name: str, root: str | Path) -> Check:
    """Look at dataset ``name`` below ``root``: its folders, their images, the first and the last of each.

    Raises:
        InputError: no such dataset is known, or none of its layouts is there; lists the folders looked for.
    """
    opened = find_layout(name, root)
    dataset, layout = opened.dataset, opened.layout
    faults: list[str] = []
    whole: list[Traverse] = []
    seen = []
    for folder, path in zip(layout.folders, (*opened.references, opened.query), strict=True):
        try:
            traverse = open_traverse(path, every=layout.every)
            whole.append(traverse)
            seen.append(Seen(folder, len(traverse), len(opened.sampled(traverse)), _ends(traverse)))
        except InputError as error:
            faults.append(str(error))
            seen.append(Seen(folder, 0, 0, None))
    if not faults:
        try:
            check_lengths(opened, whole)
        except InputError as error:
            faults.append(str(error))
    places = None if layout.needs_positions else min(one.in_use for one in seen[: len(layout.references)])
    sections = None if places is None else min(dataset.sections, places // dataset.places)
    differs = faults + _shapes(seen) + _more(layout, seen) + _short(dataset, layout.step, places, sections)
    return Check(dataset, tuple(seen), places, sections, tuple(differs), not faults and sections != 0)


def _ends(traverse: Traverse) -> tuple[int, int]:
    """Width and height of the first image; the last is read, too.

    Raises:
        InputError: one of them cannot be read.
    """
    first, *_ = traverse.take(sorted({0, len(traverse) - 1})).images()
    if first.ndim < 2:
        raise InputError(f"{shown(traverse.source)}: holds vectors; a dataset is checked by its images")
    return int(first.shape[1]), int(first.shape[0])


def _shapes(seen: list[Seen]) -> list[str]:
    """What to say of traverses whose images are of different sizes."""
    sizes = {one.size for one in seen if one.size is not None}
    if len(sizes) < 2:
        return []
    each = ", ".join(f"{one.folder} {one.size[0]} x {one.size[1]}" for one in seen if one.size is not None)
    return [f"images are of different sizes (pixels): {each}; all are resized alike"]


def _more(layout: DatasetLayout, seen: list[Seen]) -> list[str]:
    """What to say of folders that hold images which the authors leave out."""
    most = max(one.images for one in seen)
    if layout.kept is None or most <= layout.kept:
        return []
    return [
        f"folders of {most:,} images, of which the paper keeps {layout.kept:,}: every {layout.step}th is another place "
        "than the paper's; take the authors' lists, or leave the same images out"
    ]


def _short(dataset: Dataset, step: int, places: int | None, sections: int | None) -> list[str]:
    """What to say of too few images for the paper's sections."""
    if places is None or sections is None or sections == dataset.sections:
        return []
    images = (dataset.sections * dataset.places - 1) * step + 1
    return [
        f"{places} places are enough for {sections} of the paper's {dataset.sections} sections of {dataset.places}; "
        f"all take {images:,} images of each traverse"
    ]
