"""Backends that run a bundle: its simulation, and Kapoho Bay.

They first deploy a model that is no bundle to a temporary one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import Advance, Events, Presentations, events_of
from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.bundle import board_program, effort
from lava_vpr.deploy.bundle.core_files import BundleSpikes
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.deploy.bundle.folder import ReadBundle
from lava_vpr.deploy.bundle.targets import TARGETS, open_whole
from lava_vpr.engine.inference import counting
from lava_vpr.engine.presentations import PixelBlock, Trains
from lava_vpr.errors import BackendUnavailableError, BundleError, InputError, shown
from lava_vpr.inputs.encoder import Keep
from lava_vpr.model import Model, checked_network, integer_model
from lava_vpr.storage.writing import temporary_folder

BATCH = 16
"""Queries between two reports of progress, at most."""


@contextmanager
def bundle_of(model: Model, board: Board = KAPOHO_BAY) -> Iterator[ReadBundle]:
    """The bundle that ``model`` was read from, or else a temporary one for ``board``.

    Raises:
        BundleError: another bundle has replaced the one that ``model`` was read from.
        NetworkLimitError: the model does not fit the board.
    """
    if model.bundle is not None:
        bundle, opened = open_whole(model.bundle)
        if not _same(opened, model):
            raise BundleError(f"{shown(model.bundle)}: was replaced while it was in use; run the command again")
        yield bundle
        return
    with temporary_folder() as folder:
        yield deploy(model, board, folder / "bundle", picture=False).bundle


def _same(one: Model, other: Model) -> bool:
    """Whether two models have the same integer network."""
    own, their = (integer_model(model, "bundle").network for model in (one, other))
    equal = np.array_equal(own.weights, their.weights) and np.array_equal(own.bias, their.bias)
    return own.scalars == their.scalars and equal


@dataclass(frozen=True)
class BundleBackend:
    """The backend that simulates a bundle from its registers and memory alone.

    Attributes:
        advance: Called with the number of further queries that are done.
    """

    advance: Advance | None = None

    def count_spikes(self, model: Model, shown: Presentations) -> tuple[NDArray[np.int32], Events]:
        """See `lava_vpr.backends.interface.Backend.count_spikes`."""
        network = checked_network(model, "bundle")
        counts = np.zeros((len(shown.rates), model.neurons), np.int32)
        sent, inh = np.zeros(network.inputs, np.int64), np.zeros(network.inhibitory, np.int64)
        for part, spikes in self._play(model, shown):
            counts[part] = spikes.exc.sum(axis=1, dtype=np.int32)
            sent += spikes.inputs.sum(axis=(0, 1), dtype=np.int64)
            inh += spikes.inh.sum(axis=(0, 1), dtype=np.int64)
        return counts, events_of(network, counts, sent, inh)

    def trains(self, model: Model, shown: Presentations) -> Trains:
        """See `lava_vpr.backends.interface.Backend.trains`."""
        queries, each = len(shown.rates), effort.spike_bytes(checked_network(model, "bundle"))
        effort.check("simulation_bytes", queries * each, f"every spike of {queries:,} queries")
        pieces = [spikes for _, spikes in self._play(model, shown)]
        exc, inh, inputs = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
        return Trains(exc, inputs, inh)

    def _play(self, model: Model, shown: Presentations) -> Iterator[tuple[slice, BundleSpikes]]:
        """Simulate the presentations part by part; yield each part and its spikes."""
        network, keys, bias = checked_network(model, "bundle"), shown.keys, shown.bias
        if bias is not None:
            network.check_presented(bias, len(keys))
        size = effort.together(network, BATCH)
        with bundle_of(model) as bundle:
            play = TARGETS[bundle.target].player(bundle)
            for start in range(0, len(keys), size):
                part = slice(start, min(start + size, len(keys)))
                yield part, play(shown.rates[part], keys[part], None if bias is None else bias[part])
                if self.advance is not None:
                    self.advance(part.stop - part.start)


def front_end_trains(
    model: Model, blocks: Iterable[PixelBlock], advance: Advance | None = None
) -> Iterator[Mapping[str, NDArray[np.uint8]]]:
    """Simulate the spiking front end of a bundle from its files alone; the bundle is opened once.

    Args:
        model: The bundle's model.
        blocks: Blocks of images.
        advance: Called with the number of further images that are done.
    Yields:
        The spikes of each population by name, uint8 (n, steps, neurons), for each block; an empty mapping if the bundle
        holds no front end.
    """
    with bundle_of(model) as bundle:
        play = TARGETS[bundle.target].front_end_player(bundle)
        for block in blocks:
            yield {} if play is None else play(block)
            if advance is not None:
                advance(len(block.grey))


@dataclass(frozen=True)
class KapohoBayBackend:
    """The backend that runs a bundle's host program on the board, which reads out counts, not single spikes.

    Attributes:
        advance: Called with the number of further queries that are done.
        board: The board for which a model that is no bundle is deployed.
    """

    advance: Advance | None = None
    board: Board = KAPOHO_BAY

    def count_spikes(self, model: Model, shown: Presentations) -> tuple[NDArray[np.int32], Events]:
        """See `lava_vpr.backends.interface.Backend.count_spikes`."""
        network = checked_network(model, self.board.name, direct=True)
        if shown.bias is not None:
            network.check_presented(shown.bias, len(shown.rates))
        if network.direct and shown.grey is None:
            raise InputError(f"the queries' pixels were not kept, which the board takes; encode them with {Keep.GREY}")
        with bundle_of(model, self.board) as bundle:
            how: dict[str, Any] = {"bias": shown.bias, "pixels": shown.grey, "advance": self.advance}
            counts = board_program.run_bundle(bundle, shown.rates, shown.keys, **how)
        # The host draws the spikes that it sends the board, so its engine can count the events.
        _, events, _ = counting.count_spikes(network, shown.rates, shown.keys, bias=shown.bias)
        return counts, events

    def trains(self, model: Model, shown: Presentations) -> Trains:
        """Refuse: the board reads out no single spikes.

        Raises:
            BackendUnavailableError: always.
        """
        raise BackendUnavailableError("kapoho-bay reads out spike counts, not single spikes; use --backend bundle")
