"""All the energy that a query takes, by every way to answer it: a board and its host, or a processor alone.

What a board takes is modelled (`lava_vpr.deploy.cost.costs`). What a processor does is timed on this machine, single
queries on one thread, and multiplied by an assumed power (`lava_vpr.deploy.boards.constants.HOST_POWER`), the same for
every way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lava_vpr.deploy.boards.constants import HOST_POWER
from lava_vpr.deploy.boards.estimate import Estimate, total
from lava_vpr.deploy.cost.costs import Modelled


@dataclass(frozen=True)
class AnsweringWay:
    """A way to answer a query, with all the energy that it takes, in uJ.

    Attributes:
        name: The board, or what the processor runs instead: ``host`` (this network), ``cosine``, ``hog``, ``sad``.
        recall: R@1 on the same queries, 0..1.
        work_milliseconds: The processor's time after the encoding, median: beside a board input spikes drawn and counts
            decoded, without one the whole match.
        encoding_milliseconds: The processor's time from an image file to what is compared, median.
        dynamic: Modelled dynamic energy on the board; None: there is no board.
        static: Modelled static energy of the whole board while its chips work; None: there is no board.
        io_static: That of the time for which host I/O goes on after the chips' work; None: there is no board.
    """

    name: str
    recall: float
    work_milliseconds: float
    encoding_milliseconds: float
    dynamic: Estimate | None = None
    static: Estimate | None = None
    io_static: Estimate | None = None

    @property
    def work(self) -> Estimate:
        """Energy of the processor's work after the encoding."""
        return HOST_POWER.estimate * self.work_milliseconds  # mW ms

    @property
    def encoding(self) -> Estimate:
        """Energy of the encoding."""
        return HOST_POWER.estimate * self.encoding_milliseconds

    @property
    def without_encoding(self) -> Estimate:
        """All energy but that of the encoding, which every way takes."""
        parts = (self.dynamic, self.static, self.io_static, self.work)
        return total(part for part in parts if part is not None)

    @property
    def whole(self) -> Estimate:
        """All energy of a query."""
        return self.without_encoding + self.encoding

    def as_json(self) -> dict[str, Any]:
        """The figures by name, as scripts read them; the way's name is the key."""
        return {
            "recall_at_1": self.recall,
            "dynamic_microjoules": self.dynamic,
            "static_microjoules": self.static,
            "io_static_microjoules": self.io_static,
            "work_microjoules": self.work,
            "without_encoding_microjoules": self.without_encoding,
            "encoding_microjoules": self.encoding,
            "total_microjoules": self.whole,
            "work_milliseconds": self.work_milliseconds,
            "encoding_milliseconds": self.encoding_milliseconds,
        }


def on_board(costs: Modelled, recall: float, work: float, encoding: float) -> AnsweringWay | None:
    """The way through a board; None: there are no energies of it.

    Args:
        costs: What the cost model says of a query.
        recall: R@1 of the network.
        work: The host's own work for a query besides the encoding, ms.
        encoding: Time of the encoding, ms.
    """
    figures = costs.figures
    if figures is None:
        return None
    static, whole = figures.static_millijoules, figures.wall_static_millijoules
    later = Estimate.of(lambda level: 1e3 * (whole.at(level) - static.at(level)))
    return AnsweringWay(costs.target, recall, work, encoding, figures.dynamic_microjoules, static * 1e3, later)
