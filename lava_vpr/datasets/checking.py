"""What there is of a benchmark dataset, held against what the paper needs of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from lava_vpr.datasets.layouts import Dataset, DatasetLayout, OpenedDataset, check_lengths, find_layout
from lava_vpr.errors import InputError
from lava_vpr.storage.text import shown
from lava_vpr.traverse import Traverse, open_traverse


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
            size = _ends(traverse)
        except InputError as error:
            faults.append(str(error))
            traverse, size = None, None
        images = 0 if traverse is None else len(traverse)
        seen.append(Seen(folder, images, 0 if traverse is None else len(opened.sampled(traverse)), size))
    if not faults:
        faults += _unequal(opened, whole)
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
    for _ in traverse.take([len(traverse) - 1]).images() if traverse.found is None else ():
        pass
    if first.ndim < 2:
        raise InputError(f"{shown(traverse.source)}: holds vectors; a dataset is checked by its images")
    return int(first.shape[1]), int(first.shape[0])


def _unequal(opened: OpenedDataset, whole: list[Traverse]) -> list[str]:
    try:
        check_lengths(opened, whole)
    except InputError as error:
        return [str(error)]
    return []


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
