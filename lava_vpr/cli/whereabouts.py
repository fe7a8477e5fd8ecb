"""Options that tell where and when images were taken."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

from lava_vpr.cli.common import PATH, Number, noun, several
from lava_vpr.errors import InputError
from lava_vpr.model import Model
from lava_vpr.positions.track import MOST_GAP_S
from lava_vpr.traverse import Traverse, located

_POSITIONS = "Positions, CSV or GPX: a row an image, or timed (default: from names @UTM_east@UTM_north@...)."
_STAMPS = "When they were taken: CSV, a row an image; or when a video begins (default: from names and frames)."


@dataclass(frozen=True)
class WhereOptions:
    """What the user says of where and when one traverse's images were taken.

    Attributes:
        positions: CSV or GPX file with positions; None: those in the images' names, if they tell any.
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

    def known(self, traverse: Traverse) -> bool:
        """Whether positions are told, by a file or by the names of ``traverse``."""
        return self.positions is not None or traverse.positions is not None

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
        """``traverse``, some of ``whole`` images, with what is told of them.

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
_EACH = " Once for each REFERENCE, in order."

query_positions_options = noun(
    "where",
    lambda query_positions, stamps, gap: WhereOptions(query_positions, stamps, gap),
    click.option("--query-positions", type=PATH, default=None, metavar="FILE", help=_POSITIONS),
    click.option("--stamps", default=None, metavar="FILE|TIME", help=_STAMPS),
    _GAP,
)
"""The options ``--query-positions``, ``--stamps`` and ``--gap``, given to the command as ``where``."""

reference_positions_options = several(
    click.option("--positions", type=PATH, multiple=True, metavar="FILE", help=_POSITIONS + _EACH),
    click.option("--stamps", multiple=True, metavar="FILE|TIME", help=_STAMPS + _EACH),
    _GAP,
)
"""Give a command the options ``--positions``, ``--stamps`` and ``--gap`` of several traverses."""
