"""What commands ask a model: the model itself, the query images, where they were taken, and which places they show."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from lava_vpr.cli.common import PATH, Number, noun, stderr
from lava_vpr.cli.nouns import tolerance_option
from lava_vpr.cli.outputs import Outputs
from lava_vpr.cli.show.headings import POSITIONS, TRUTH, under
from lava_vpr.datasets.selecting import Selection
from lava_vpr.errors import InputError, shown
from lava_vpr.model import Model
from lava_vpr.positions.frames import EXIF, in_photos
from lava_vpr.positions.track import MOST_GAP_S
from lava_vpr.show.numbers import agreeing
from lava_vpr.traverse import Traverse, located, open_traverse, ranges_of, readable, unread_exif
from lava_vpr.truth.alignment import (
    NEAR_M,
    Located,
    aligned_truth,
    by_number,
    choose_queries,
    located_by,
    read_ground_truth,
)

_POSITIONS = (
    "Positions, CSV or GPX: one row for each image, or timed; or exif: position and time from each photo (default: "
    "from names @UTM_east@UTM_north@...)."
)
_STAMPS = "When the images were taken: CSV, a row for each; or when a video begins (default: from names and frames)."


@dataclass(frozen=True)
class WhereOptions:
    """What the user says of where and when one traverse's images were taken.

    Attributes:
        positions: CSV or GPX file with positions, or `EXIF`; None: those in the images' names, if they tell any.
        stamps: CSV file with times, or when a video begins; None: those of names and frames.
        gap: Most seconds between two positions between which an image is placed.
    """

    positions: Path | None = None
    stamps: str | None = None
    gap: float = MOST_GAP_S

    @property
    def files(self) -> tuple[Path, ...]:
        """The files to be read."""
        return tuple(Path(file) for file in (self.positions, self.stamps) if file is not None)

    def check(self, model: Model) -> None:
        """Refuse positions that nothing can be done with.

        Raises:
            InputError: they are given, but the model has none.
        """
        if self.positions is not None and model.positions is None:
            raise InputError(
                "--query-positions needs a model that knows where its places are; train it with --positions, or use "
                "eval --positions REF.csv QUERY.csv"
            )

    def of(self, traverse: Traverse, whole: int) -> Traverse:
        """``traverse``, some of ``whole`` images, with the reports about them.

        Raises:
            InputError: a file cannot be used, or does not tell of each image.
        """
        return located(traverse, whole, self.positions, self.stamps, self.gap)


_GAP = click.option(
    "--gap",
    type=Number(min=0),
    default=MOST_GAP_S,
    show_default=True,
    metavar="SECONDS",
    help="Longest gap between two positions in which an image is placed by its time.",
)
_EACH = " Once for each traverse, in order."

query_positions_options = noun(
    "where",
    lambda query_positions, stamps, gap: WhereOptions(query_positions, stamps, gap),
    under(
        POSITIONS,
        click.option("--query-positions", type=PATH, default=None, metavar=f"FILE|{EXIF}", help=_POSITIONS),
        click.option("--stamps", default=None, metavar="FILE|TIME", help=_STAMPS),
        _GAP,
    ),
)
"""The options ``--query-positions``, ``--stamps`` and ``--gap``, given to the command as ``where``."""

reference_positions_options = under(
    POSITIONS,
    click.option("--positions", type=PATH, multiple=True, metavar=f"FILE|{EXIF}", help=_POSITIONS + _EACH),
    click.option("--stamps", multiple=True, metavar="FILE|TIME", help=_STAMPS + _EACH),
    _GAP,
)
"""Give a command the options ``--positions``, ``--stamps`` and ``--gap`` of several traverses."""


def open_queries(model: Model, source: str, places: tuple[int, int] | None, every: float, outputs: Outputs) -> Traverse:
    """The query images to answer, which show the model's places in their order; arguments as of `_opened`.

    Raises:
        InputError: the images cannot be used; see `choose_queries`.
    """
    return choose_queries(model, _opened(model, source, every, outputs), places, aligned=True)


def _opened(model: Model, source: str, every: float, outputs: Outputs) -> Traverse:
    """All query images.

    Args:
        model: The model that answers.
        source: Folder, list, video or image.
        every: Seconds between two frames of a video, or two windows of events.
        outputs: Of the command; none may be one of the images of ``source``.
    """
    whole = open_traverse(source, every=every, events=model.config.events)
    outputs.spare(whole.paths)
    return whole


def _note_left(model: Model, whole: Traverse, chosen: Traverse, places: tuple[int, int] | None) -> None:
    """Report which images of ``whole``, or of its ``places``, are not among the ``chosen``: the map lacks theirs."""
    asked = whole.indices if places is None else whole.indices[slice(*places)]
    left = np.setdiff1d(asked, chosen.indices)
    if len(left):
        are = agreeing(len(left), "is", "are")
        what = agreeing(len(left), "place of its number", "places of their numbers")
        said = f"{len(left)} of {len(asked)} images {are} left out, since the map has no {what}: {ranges_of(left)}"
        stderr.print(f"note: {shown(whole.source)}: {said}")


def asked_places(route: Selection, model: Model, places: tuple[int, int] | None) -> tuple[int, int] | None:
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


@dataclass(frozen=True)
class TruthOptions:
    """What the user says of which places are correct.

    Attributes:
        gt: File with the correct places of each query.
        positions: Files with the positions of the reference and of the query images.
        radius: Metres within which a place is correct, by positions.
        tolerance: Places along the route that a match may be off, by order or by ``gt``; without positions.
        where: Where the queries were taken, to be compared with the model's own positions.
        in_step: Whether order may tell which place a query shows.
    """

    gt: Path | None
    positions: tuple[Path, Path] | None
    radius: float | None
    tolerance: int
    where: WhereOptions
    in_step: bool = True

    def __post_init__(self) -> None:
        by_files, told = self.positions is not None, self.where.positions is not None
        for wrong, why in (
            (
                by_files and (self.radius is None or self.gt is not None),
                "--positions needs --radius M, and excludes --gt",
            ),
            (
                any(map(in_photos, self.positions or ())),
                "--positions takes files here; train with --positions exif, and give --query-positions exif",
            ),
            (by_files and told, "--positions gives the positions of both traverses; leave out --query-positions"),
            (
                self.radius is not None and self.gt is not None,
                "--radius needs positions, while --gt lists the correct answers; give one of them",
            ),
            (
                self.tolerance and self.gt is None and (by_files or told),
                "--tolerance counts places along the route; positions (with --radius M) say themselves what is correct",
            ),
        ):
            if wrong:
                raise click.UsageError(why)

    def for_route(self, route: Selection) -> TruthOptions:
        """The same for the traverses of ``route``: where these are not in step, and places are some metres apart, an
        answer is correct within half of that, unless the user says otherwise."""
        if not route.by_position or route.opened is None:
            return self
        if self.tolerance and self.gt is None:
            raise click.UsageError("--tolerance counts along the route, and no order tells that here; give --radius M")
        spacing = route.opened.layout.spacing
        exact = spacing is not None and self.radius is None and self.gt is None
        return replace(self, in_step=False, radius=spacing / 2 if exact and spacing is not None else self.radius)

    @property
    def aligned(self) -> bool:
        """Whether nothing but the order of the queries says which place each shows, as far as the options tell."""
        return self.gt is None and self.positions is None

    @property
    def files(self) -> tuple[Path, ...]:
        """The files to be read."""
        return (*(() if self.gt is None else (self.gt,)), *(self.positions or ()), *self.where.files)

    def open(
        self, model: Model, route: Selection, places: tuple[int, int] | None, outputs: Outputs, skip: bool = False
    ) -> tuple[Traverse, Located | None, NDArray[np.bool_]]:
        """The query images to answer, where they and the places were taken (`located`), and which are correct (`of`).

        Args:
            model: The model that answers.
            route: Where the query images lie.
            places: Range of images that the user asked for.
            outputs: Of the command; none may be one of the query images.
            skip: Whether images that cannot be read are left out (`readable`).
        Raises:
            InputError: the images cannot be used, see `choose_queries`; or a file that says what is correct.
        """
        places = asked_places(route, model, places)
        whole = _opened(model, route.sources[0], route.every, outputs)
        chosen, told = self._chosen(model, whole, places)
        if self.in_step:
            _note_left(model, whole, chosen, places)
        (queries,) = readable([chosen], [self.where.positions]) if skip else (chosen,)
        queries = self.where.of(queries, len(whole)) if told else queries
        located = self.located(model, queries)
        return queries, located, self.of(model, queries, located, chosen.indices)

    def _chosen(self, model: Model, whole: Traverse, places: tuple[int, int] | None) -> tuple[Traverse, bool]:
        """The queries among all images, and whether ``where`` is to be asked of them, too; where positions are known,
        they need not be in order.

        Where order tells nothing and there is no ground truth, the image nearest to each place is its query.
        """
        if self.tolerance and self.gt is None:  # by order, whatever their names tell
            return choose_queries(model, whole, places, aligned=True), False
        self.where.check(model)
        known = model.positions is not None and (self.where.positions is not None or whole.positions is not None)
        if not self.in_step and known:
            from lava_vpr.training.preparing import nearest

            found = self.where.of(whole, len(whole))
            if model.whereabouts is not None and found.positions is not None:
                return found.take(nearest(model.whereabouts, found.positions)[0].tolist()), False
        if not self.in_step and self.aligned:
            raise InputError(
                f"{shown(whole.source)}: nothing tells which place a query shows, since the traverses of this dataset "
                "are not in step; train with --positions and give --query-positions FILE, or give --gt FILE, or "
                "--positions REF.csv QUERY.csv --radius M"
            )
        return choose_queries(model, whole, places, aligned=self.aligned and not known), True

    def located(self, model: Model, queries: Traverse) -> Located | None:
        """Where the model's places and the queries were taken, if both are known.

        Raises:
            InputError: a file cannot be used, or the frames cannot be compared.
        """
        if self.positions is not None:
            return located_by(model, queries, self.positions)
        places = model.whereabouts
        if places is None or queries.positions is None:
            return None
        return Located.of(places, queries.positions, str(self.where.positions or queries.source))

    def of(
        self, model: Model, queries: Traverse, located: Located | None, among: NDArray[np.int64] | None = None
    ) -> NDArray[np.bool_]:
        """Which places are correct for which query, bool (queries, places); assumptions are reported on stderr.

        Args:
            model: The model that answers.
            queries: The queries.
            located: Where places and queries were taken.
            among: As in `aligned_truth`.
        Raises:
            InputError: a file cannot be used, or says nothing about a query.
        """
        if self.gt is not None:
            truth = read_ground_truth(self.gt, queries.indices, model.place_indices, self.tolerance)
        elif located is not None and not self.tolerance:
            truth = located.truth(self.near)
        elif self.radius is not None:
            raise click.UsageError(
                "--radius needs --positions REF.csv QUERY.csv, or a model that knows where its places are and "
                "--query-positions FILE"
            )
        else:
            if not by_number(model, queries.indices if among is None else among):
                taken, places = ranges_of(queries.indices), ranges_of(model.place_indices)
                stderr.print(f"note: images {taken} are taken, in order, as the places {places}")
            if unread_exif(queries):
                how = "" if model.positions is not None else "train with --positions exif and "
                stderr.print(
                    f"note: image i is taken to show place i, though the photos of {shown(queries.source)} say where "
                    f"they were taken; if they are in another order, {how}give --query-positions exif"
                )
            truth = aligned_truth(model, queries, self.tolerance, among)
        without = int(np.count_nonzero(~truth.any(axis=1)))
        if without:
            stderr.print(f"note: {without} of {len(truth)} queries show none of the places; they count as not recalled")
        return truth

    @property
    def near(self) -> float:
        """Metres within which a match counts."""
        return NEAR_M if self.radius is None else self.radius


truth_options = noun(
    "truth",
    TruthOptions,
    under(
        TRUTH,
        click.option(
            "--gt",
            type=PATH,
            default=None,
            metavar="FILE",
            help="Correct places of each query: txt, csv, json or npy.",
        ),
        click.option(
            "--positions",
            type=(PATH, PATH),
            default=None,
            metavar="REF.csv QUERY.csv",
            help="Positions of all images; with --radius.",
        ),
        query_positions_options,
        click.option(
            "--radius",
            type=Number(min=0),
            default=None,
            metavar="M",
            help=f"Metres within which a place is correct, where positions are known.  [default: {NEAR_M:g}]",
        ),
        tolerance_option,
    ),
)
"""The options that say which places are correct, given to the command as ``truth``."""
