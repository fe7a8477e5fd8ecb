"""Queries presented with the gains and biases of a gain table (`lava_vpr.season.table`), not with learned ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lava_vpr.backends.interface import Presentations
from lava_vpr.backends.teaching import under_gains
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.random import image_keys
from lava_vpr.errors import InputError
from lava_vpr.model import IntegerModel
from lava_vpr.season.table import GainTable


class Replayer:
    """Presents the queries of one traverse with the gains and biases of a table, part by part, in order."""

    def __init__(self, model: IntegerModel, table: GainTable) -> None:
        self._encoder, self._table, self._done = model.config.encoder, table, 0

    def weighed(self, shown: Sequence[Presentations], views: Sequence[EncodedTraverse]) -> list[Presentations]:
        """The presentations of the next queries, with the gains and biases of the table.

        Args:
            shown: Their presentations without gains, one item a view.
            views: The encoded queries, one item a view.
        Raises:
            InputError: the queries are not those of the table.
        """
        table, rows = self._table, slice(self._done, self._done + len(shown[0].rates))
        table.check_length(rows.stop)
        other = np.flatnonzero(table.images[rows] != image_keys(shown[0].rates))
        if len(other):
            raise InputError(
                f"{table.name}: its query {rows.start + other[0]} is another image than {views[0].names[other[0]]}; "
                "give the images that it was written with, first one first, or write it again with --learn --gains"
            )
        self._done = rows.stop
        return under_gains(shown, views, table.gains[table.epoch[rows]], table.bias[rows], self._encoder)
