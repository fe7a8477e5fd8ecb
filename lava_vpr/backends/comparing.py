"""The comparison of a backend with the host: spikes of every population, and products of activity and gains."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.asking import Asking
from lava_vpr.backends.interface import AT_ONCE, Advance, Presentations, RunFrontEnd, RunGains, front_end_of
from lava_vpr.config import EncoderConfig
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.gains import FULL, digits_of
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.engine.rates import query_rates16
from lava_vpr.errors import InputError
from lava_vpr.inputs.encoder import Keep
from lava_vpr.model import Model


@dataclass(frozen=True)
class Mismatch:
    """The first difference between a backend and the host.

    Attributes:
        query: Name of the query.
        step: Step of the presentation; None where counts or products are compared.
        population: Name of the population, or `GAINED`.
        neuron: Number of the neuron in its population, or of the input.
        host, backend: The value of each: a spike (0 or 1), a count, or a product of activity and gain.
    """

    query: str
    step: int | None
    population: str
    neuron: int
    host: float
    backend: float

    def __str__(self) -> str:
        where = "" if self.step is None else f" step {self.step},"
        return (
            f"query {self.query},{where} population {self.population}, neuron {self.neuron}: "
            f"host {self.host:.9g}, backend {self.backend:.9g}"
        )


class SpikesCompared(NamedTuple):
    """The result of a comparison.

    Attributes:
        spikes: Spikes of the host that were compared, by population.
        differing: Number of (query, step, neuron) at which spikes differ.
        first: The first of these by query and step; None: all are equal.
    """

    spikes: dict[str, int]
    differing: int = 0
    first: Mismatch | None = None


def compare(
    host: Mapping[str, NDArray[np.uint8]], other: Mapping[str, NDArray[np.uint8]], names: Sequence[str]
) -> SpikesCompared:
    """Compare the trains (n, steps, neurons) of the populations that both have.

    Raises:
        InputError: the trains are of different shapes, so nothing can be compared.
    """
    compared: dict[str, int] = {}
    differing, first = 0, []
    for order, (population, ours) in enumerate(host.items()):
        if population not in other:
            continue
        theirs = other[population]
        if ours.shape != theirs.shape:
            raise InputError(
                f"{population} trains of shape {theirs.shape} instead of {ours.shape}; the backend runs another network"
            )
        compared[population] = int(ours.sum(dtype=np.int64))
        where = np.argwhere(ours != theirs)
        differing += len(where)
        for query, step, neuron in where[:1].tolist():
            said = (int(each[query, step, neuron]) for each in (ours, theirs))
            first.append(((query, step, order), Mismatch(names[query], step, population, neuron, *said)))
    return SpikesCompared(compared, differing, min(first, key=lambda pair: pair[0])[1] if first else None)


class FrontEndQueries(NamedTuple):
    """Queries for the spiking front end of a model.

    Attributes:
        model: The model.
        views: The encoded queries in each of their views, with the pixels that the front end takes (`Keep.GREY`).
        asked: Makes the presentations of encoded views, view after view.
        bias: Biases of the neurons that hear the cells, view after view, int32 (n, neurons); None: their own.
    """

    model: Model
    views: Sequence[EncodedTraverse]
    asked: Callable[[Sequence[EncodedTraverse]], Presentations]
    bias: NDArray[np.int32] | None = None

    @property
    def names(self) -> list[str]:
        """The names of all images, view after view."""
        return [name for view in self.views for name in view.names]

    @property
    def blocks(self) -> list[PixelBlock]:
        """Blocks of at most `AT_ONCE` images."""
        grey = np.concatenate([view.kept(Keep.GREY, "comparing the front end") for view in self.views])
        return PixelBlock(grey, self.bias).in_parts(AT_ONCE)


def compare_front_ends(
    run: RunFrontEnd | None, shown: FrontEndQueries | None, advance: Advance | None
) -> SpikesCompared:
    """Compare the spikes of a backend's front end with the host's, block by block.

    The comparison is empty if the backend or the model has no front end.
    """
    if run is None or shown is None:
        return SpikesCompared({})
    spec, blocks, names = front_end_of(shown.model), shown.blocks, iter(shown.names)
    found = [
        compare(spec.trains(*block), theirs, list(islice(names, len(block.grey))))
        for block, theirs in zip(blocks, run(shown.model, blocks, advance), strict=True)
    ]
    spikes = {population: sum(each.spikes[population] for each in found) for population in found[0].spikes}
    first = next((each.first for each in found if each.first is not None), None)
    return SpikesCompared(spikes, sum(each.differing for each in found), first)


def of_own_cells(run: RunFrontEnd, shown: FrontEndQueries, advance: Advance | None) -> Presentations:
    """The presentations of queries with the activity that a backend's own front end gives them."""
    films = run(shown.model, shown.blocks, advance)
    activity = np.concatenate([film["cells"].sum(axis=1, dtype=np.float32) for film in films])
    parts = np.split(activity, len(shown.views))
    return shown.asked([replace(view, activity=part) for view, part in zip(shown.views, parts, strict=True)])


GAINED = "inputs under gains"
"""What is called a population where products of activity and gain differ."""


class GainedQueries(NamedTuple):
    """What queries are presented with under gains.

    Attributes:
        names: Name of each presentation.
        activity: Without gains, float32 (n, inputs).
        gains: Of each epoch, uint8 (epochs, inputs).
        epoch: Of each presentation, int32 (n,).
        encoder: Settings of the inputs.
    """

    names: Sequence[str]
    activity: NDArray[np.float32]
    gains: NDArray[np.uint8]
    epoch: NDArray[np.int32]
    encoder: EncoderConfig

    @classmethod
    def of(cls, model: Model, asking: Asking, views: Sequence[EncodedTraverse]) -> GainedQueries | None:
        """Those of queries in each of their views; None where inputs have no gains."""
        n, encoder = len(views[0]), model.config.encoder
        if encoder.direct is not None:  # gains are in the weights
            return None
        if asking.replay is not None:
            gains, epoch = asking.replay.gains, asking.replay.epoch[:n]
        elif asking.season is not None:
            gains, epoch = asking.season.gains[None], np.zeros(n, np.int32)
        else:
            return None
        names, activity = views[0].names * len(views), np.concatenate([view.activity for view in views])
        return cls(names, activity, gains, np.tile(epoch, len(views)), encoder)


def compare_gains(
    run: RunGains | None, queries: GainedQueries | None, shown: Presentations, advance: Advance | None
) -> tuple[Presentations, int, SpikesCompared]:
    """Compare activity times gain on a backend with the host's, and present what follows from the backend's.

    Returns:
        The presentations, how many products were compared, and what differs.
    """
    if run is None or queries is None:
        return shown, 0, SpikesCompared({})
    gains, whole = queries.gains[queries.epoch], digits_of(queries.activity)
    ours = queries.activity * gains.astype(np.float32)
    theirs = whole.activity(run(whole.digits, queries.gains, queries.epoch, advance))
    where, lessened, rates = np.argwhere(ours != theirs), (gains < FULL).any(axis=1), shown.rates.copy()
    rates[lessened] = query_rates16(theirs[lessened], queries.encoder)
    first = [
        Mismatch(queries.names[query], None, GAINED, which, float(ours[query, which]), float(theirs[query, which]))
        for query, which in where[:1].tolist()
    ]
    return replace(shown, rates=rates), ours.size, SpikesCompared({}, len(where), next(iter(first), None))
