"""Options that take traverses, sampling and sections of a benchmark dataset from its row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any, TypeVar

import click

from lava_vpr.cli.common import RegisteredName
from lava_vpr.datasets.layouts import DATASETS, Opened, check_lengths, find_layout
from lava_vpr.errors import InputError
from lava_vpr.model import Model
from lava_vpr.storage.text import shown
from lava_vpr.traverse import Traverse

F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True)
class Route:
    """Where traverses lie, and which of their images are in use: of a benchmark dataset, or as the user says.

    Attributes:
        sources: Folder, list, video or file of vectors of each traverse.
        every: Seconds between two frames of a video.
        opened: The dataset, if they are one's.
        section: One of its sections, from 1; None: all places.
    """

    sources: tuple[str, ...]
    every: float
    opened: Opened | None = None
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
class BenchmarkOptions:
    """What the user says of a benchmark dataset.

    Attributes:
        name: Its name in `DATASETS`; None: the sources are the user's own.
        section: One of its sections, from 1; None: all places.
    """

    name: str | None
    section: int | None

    def __post_init__(self) -> None:
        if self.section is not None and self.name is None:
            raise click.UsageError("--section is one of a dataset's; give --dataset NAME, or --places A:B")

    def learned(self, sources: Sequence[str], every: float, **excluded: Any) -> Route:
        """Where the reference traverses lie.

        Args:
            sources: What the user gave: traverses, or the dataset's one folder.
            every: Seconds between two frames of a video, of traverses that are the user's own.
            excluded: Values of options that exclude a dataset, by their names.
        Raises:
            InputError: the dataset does not lie there, or has no such section.
        """
        if self.name is None:
            return Route(tuple(sources), every)
        if len(sources) != 1:
            raise click.UsageError(f"--dataset takes one folder, which holds the dataset; {len(sources)} are given")
        opened = self._opened(sources[0], excluded)
        return Route(tuple(map(str, opened.references)), opened.layout.every, opened, self.section)

    def recognised(self, source: str, every: float, **excluded: Any) -> Route:
        """Where the query traverse lies; arguments and errors as in `learned`."""
        if self.name is None:
            return Route((source,), every)
        opened = self._opened(source, excluded)
        if self.section is not None and opened.layout.ground_truth == "positions":
            raise click.UsageError("the queries are the images nearest to the model's places; leave out --section")
        return Route((str(opened.query),), opened.layout.every, opened, self.section)

    def _opened(self, root: str, excluded: dict[str, Any]) -> Opened:
        given = [f"--{name}" for name, value in excluded.items() if value]
        if given:
            raise click.UsageError(f"--dataset says itself which images are taken; leave out {', '.join(given)}")
        opened = find_layout(self.name or "", root)
        if self.section is not None:
            opened.dataset.section(self.section)
        return opened


def asked_places(route: Route, model: Model, places: tuple[int, int] | None) -> tuple[int, int] | None:
    """The range of query images that ``route`` and the user ask ``model`` for, in whole traverses; None: the model's.

    Raises:
        InputError: the model has not learned the section.
    """
    if route.opened is None or route.section is None or route.by_position:
        return places
    first, end = (place * route.opened.layout.step for place in route.opened.dataset.section(route.section))
    if not ((model.place_indices >= first) & (model.place_indices < end)).any():
        raise InputError(
            f"section {route.section} of {route.opened.dataset.title} is images {first}:{end}, of which the model "
            f"has learned none; train it with --dataset {route.opened.dataset.name} --section {route.section}"
        )
    return first, end


def benchmark_options(command: F) -> F:
    """The options ``--dataset`` and ``--section``, given to the command as ``benchmark``."""

    @wraps(command)
    def collected(*args: Any, dataset: str | None, section: int | None, **others: Any) -> Any:
        return command(*args, benchmark=BenchmarkOptions(dataset, section), **others)

    text = "One of the dataset's sections, from 1 (default: all its places)."
    wrapped: Any = click.option("--section", type=click.IntRange(min=1), default=None, metavar="K", help=text)(
        collected
    )
    text = "The folder holds this benchmark dataset: take the paper's traverses and sampling."
    optional: F = click.option("--dataset", type=RegisteredName(DATASETS), default=None, help=text)(wrapped)
    return optional
