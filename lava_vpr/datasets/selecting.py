"""Which traverses and which of their images are in use: a benchmark dataset's, or those that a user names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from lava_vpr.datasets.layouts import OpenedDataset, check_lengths, find_layout
from lava_vpr.errors import InputError, UsageError
from lava_vpr.storage.text import shown
from lava_vpr.traverse import Traverse


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
        given = [f"--{name}" for name, value in excluded.items() if value]
        if given:
            raise UsageError(f"--dataset says itself which images are taken; leave out {', '.join(given)}")
        opened = find_layout(self.name or "", root)
        if self.section is not None:
            opened.dataset.section(self.section)
        return opened
