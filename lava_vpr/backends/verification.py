"""The same model and queries on every backend that can run here, spikes compared one by one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends import registry as backends
from lava_vpr.backends.asking import PLAINLY, Asker, Asking, summed
from lava_vpr.backends.interface import (
    AT_ONCE,
    Advance,
    BackendRow,
    HostBackend,
    Presentations,
    RunFrontEnd,
    RunGains,
    front_end_of,
)
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import EncoderConfig
from lava_vpr.encoding import EncodedTraverse, query_rates16
from lava_vpr.engine.gains import FULL, digits_of
from lava_vpr.engine.presentations import Trains
from lava_vpr.errors import BackendUnavailableError, ConfigError, InputError, NetworkLimitError, PluginError
from lava_vpr.inputs.encoder import Keep
from lava_vpr.matching.decoders import confidence
from lava_vpr.matching.evaluation import evaluate
from lava_vpr.model import Model, as_integer, decode


@dataclass(frozen=True)
class Mismatch:
    """The first spike in which a backend differs from the host: where, and what each of them says (0 or 1).

    For a backend that tells counts only, the first count that differs; ``step`` is then None, as it is of activity
    under gains.
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


@dataclass(frozen=True)
class Verdict:
    """What one backend made of the queries.

    Attributes:
        name: Name of the backend.
        reason: Why it cannot run here; None if it did.
        equal: Whether every spike equals the host's; None for a float backend.
        queries: Number of queries that were compared.
        compared: Spikes of the host that were compared (and every step without one), by population; those that the
            backend has.
        differing: (step, neuron) pairs in which spikes differ.
        mismatch: The first spike that differs.
        recall: R@1 of the default decoder on these queries.
        gained: Products of activity and gain that were compared.
    """

    name: str
    reason: str | None = None
    equal: bool | None = None
    queries: int = 0
    compared: dict[str, int] = field(default_factory=dict)
    differing: int = 0
    mismatch: Mismatch | None = None
    recall: float | None = None
    gained: int = 0

    @property
    def spikes(self) -> int:
        """All spikes of the host that were compared, those of inputs included."""
        return sum(self.compared.values())

    @property
    def decided(self) -> int:
        """Those of them that the network decided: of exc and inh."""
        return sum(self.compared.get(population, 0) for population in Trains.DECIDED)

    @property
    def before(self) -> int:
        """Those of a spiking front end, of all its populations."""
        return sum(spikes for population, spikes in self.compared.items() if population not in Trains.POPULATIONS)

    @property
    def hosts_kernel(self) -> bool:
        """Whether the backend calls the host's own kernel."""
        return self.name in BACKENDS and BACKENDS[self.name].hosts_kernel

    def as_json(self) -> dict[str, Any]:
        """The layout that scripts rely on."""
        if self.reason is not None:
            return {"available": False, "reason": self.reason}
        values: dict[str, Any] = {"available": True, "equal": self.equal, "queries": self.queries}
        if self.equal is None:
            return values | {"recall_at_1": self.recall}
        if self.gained:
            values["products_compared"] = self.gained
        return values | {
            "spikes_compared": self.spikes,
            "spikes_decided": self.decided,
            "spikes_by_population": self.compared,
            "hosts_kernel": self.hosts_kernel,
        }


class SpikesCompared(NamedTuple):
    """What a comparison found.

    Attributes:
        spikes: Spikes of the host that were compared, by population.
        differing: How many (query, step, neuron) differ.
        first: The first of them by query and step.
    """

    spikes: dict[str, int]
    differing: int = 0
    first: Mismatch | None = None


class FrontEndQueries(NamedTuple):
    """What a model's front end is shown.

    Attributes:
        model: The model.
        views: The queries in each of their views, with what pixels take of them (`Keep.GREY`).
        asked: Makes their presentations, view after view, of their activity.
    """

    model: Model
    views: Sequence[EncodedTraverse]
    asked: Callable[[Sequence[EncodedTraverse]], Presentations]

    @property
    def names(self) -> list[str]:
        """The names of all images, view after view."""
        return [name for view in self.views for name in view.names]

    @property
    def blocks(self) -> list[tuple[NDArray[np.uint8], list[str]]]:
        """What pixels take of some images at a time, uint8 (n, height, width), and their names."""
        grey = np.concatenate([view.kept(Keep.GREY, "comparing the front end") for view in self.views])
        starts = range(0, len(grey), AT_ONCE)
        return [(grey[start : start + AT_ONCE], self.names[start : start + AT_ONCE]) for start in starts]


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
        if asking.replay is not None:
            gains, epoch = asking.replay.gains, asking.replay.epoch[:n]
        elif asking.season is not None:
            gains, epoch = asking.season.gains[None], np.zeros(n, np.int32)
        else:
            return None
        names, activity = views[0].names * len(views), np.concatenate([view.activity for view in views])
        return cls(names, activity, gains, np.tile(epoch, len(views)), encoder)


def _under_gains(
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


def _before(run: RunFrontEnd | None, shown: FrontEndQueries | None, advance: Advance | None) -> SpikesCompared:
    """Compare what a backend's front end makes of the images, some at a time, with the host's."""
    if run is None or shown is None:
        return SpikesCompared({})
    spec, blocks = front_end_of(shown.model), shown.blocks
    films = run(shown.model, (grey for grey, _ in blocks), advance)
    found = [compare(spec.trains(grey), theirs, names) for (grey, names), theirs in zip(blocks, films, strict=True)]
    spikes = {population: sum(each.spikes[population] for each in found) for population in found[0].spikes}
    first = next((each.first for each in found if each.first is not None), None)
    return SpikesCompared(spikes, sum(each.differing for each in found), first)


def _of_own_cells(run: RunFrontEnd, shown: FrontEndQueries, advance: Advance | None) -> Presentations:
    """The queries as presented where a backend's own front end decides their activity."""
    films = run(shown.model, (grey for grey, _ in shown.blocks), advance)
    activity = np.concatenate([film["cells"].sum(axis=1, dtype=np.float32) for film in films])
    parts = np.split(activity, len(shown.views))
    return shown.asked([replace(view, activity=part) for view, part in zip(shown.views, parts, strict=True)])


def recall_at_1(model: Model, counts: NDArray[np.int32], truth: NDArray[np.bool_]) -> float:
    """R@1 of the model's default decoder on spike counts (views n, neurons) of the presentations of n queries."""
    name = model.config.decoder.default
    scores = decode(model, summed(counts, len(counts) // len(truth)), name)
    return evaluate(scores, confidence(name, scores), truth).recall_at_1


def verify(
    model: Model,
    queries: EncodedTraverse,
    truth: NDArray[np.bool_],
    *,
    names: Sequence[str] | None = None,
    asking: Asking = PLAINLY,
    further: Sequence[EncodedTraverse] = (),
    seed: int | None = None,
    threads: int = 1,
    begin: Callable[[str], Callable[[int], None] | None] | None = None,
) -> list[Verdict]:
    """Run ``queries`` on the host and on every other backend in ``names``; None: on every backend there is.

    Args:
        model: A trained model.
        queries: Encoded with the model's settings.
        truth: bool (n, places), for the recall of float backends.
        names: Backends; the host always comes first.
        asking: How they are asked, checked (`Asking.check`).
        further: The queries in the further views in which they are presented (`Asking.of`).
        seed: The seed of the queries' noise; None: the model's.
        threads: Threads of the host engine.
        begin: Called with each backend before its run; returns what is called as its presentations are done.
    Raises:
        InputError: a query without any spike of an excitatory neuron: its comparison would be empty.
    """
    shown = Asker(model, asking, seed).presentations((queries, *further))
    images = queries.names * asking.views
    host = HostBackend(Pool(threads))
    verdicts = []
    trains = None if as_integer(model) is None else host.trains(model, shown)
    counts, _ = host.count_spikes(model, shown)
    silent = np.flatnonzero(summed(counts, asking.views).sum(axis=1) == 0)
    if len(silent):
        raise InputError(
            f"{queries.names[silent[0]]}: no neuron spikes for this query, so there is nothing to compare "
            f"({len(silent)} of {len(queries)} such queries); choose others with --places"
        )
    before = None
    if model.config.encoder.front_end is not None:
        before = FrontEndQueries(
            model, (queries, *further), lambda views: Asker(model, asking, seed).presentations(views)
        )
    compared = _before(BACKENDS["host"].front_end, before, None).spikes
    if model.config.encoder.direct is None:
        compared |= compare(trains.films, trains.films, images).spikes if trains else {"exc": int(counts.sum())}
    gained = GainedQueries.of(model, asking, (queries, *further))
    products = 0 if gained is None else gained.activity.size
    recall = recall_at_1(model, counts, truth)
    reference = Verdict("host", None, True, len(queries), compared, recall=recall, gained=products)
    for name in BACKENDS if names is None else names:
        try:
            found = (
                reference
                if name == "host"
                else _verdict(name, model, shown, before, gained, trains, images, truth, reference, begin)
            )
        except (BackendUnavailableError, ConfigError, NetworkLimitError, PluginError) as error:
            found = Verdict(name, str(error))
        verdicts.append(found)
    return verdicts


def _in_one_run(
    row: BackendRow,
    shown: FrontEndQueries,
    truth: NDArray[np.bool_],
    reference: Verdict,
    advance: Advance | None,
) -> Verdict:
    """What a backend makes of queries in one run from pixels to places.

    Raises:
        ConfigError: it runs no front end.
    """
    if row.front_end is None:
        raise ConfigError(f"{row.name} runs no front end, whose cells the neurons hear; train with --input frontend")
    if not row.exact:
        films = row.front_end(shown.model, (grey for grey, _ in shown.blocks), advance)
        counts = np.concatenate([film["exc"].sum(axis=1, dtype=np.int32) for film in films])
        return replace(reference, name=row.name, equal=None, recall=recall_at_1(shown.model, counts, truth))
    found = _before(row.front_end, shown, advance)
    return replace(
        reference,
        name=row.name,
        equal=found.first is None,
        compared=found.spikes,
        differing=found.differing,
        mismatch=found.first,
    )


def _verdict(
    name: str,
    model: Model,
    shown: Presentations,
    before: FrontEndQueries | None,
    gained: GainedQueries | None,
    host: Trains | None,
    images: Sequence[str],
    truth: NDArray[np.bool_],
    reference: Verdict,
    begin: Callable[[str], Callable[[int], None] | None] | None,
) -> Verdict:
    """What the backend ``name`` makes of the queries.

    Raises:
        LavaVprError: it cannot run here, or not this model.
    """
    backends.require(name, model)
    row, begin = BACKENDS[name], begin or (lambda name: None)
    if before is not None and model.config.encoder.direct is not None:
        return _in_one_run(row, before, truth, reference, begin(f"pixels to places on {name}"))
    earlier = SpikesCompared({})
    if before is not None and row.front_end is not None:
        advance = begin(f"the front end on {name}")
        if row.exact:
            earlier = _before(row.front_end, before, advance)
        elif gained is None:  # a gain table is of images that have the host's activity
            shown = _of_own_cells(row.front_end, before, advance)
    advance = begin(f"gains on {name}") if gained is not None and row.gains is not None else None
    shown, products, weighed = _under_gains(row.gains, gained, shown, advance)
    backend = backends.get(name, advance=begin(name))
    exact = host if row.exact else None
    spikes = None if exact is None or row.counts_only else backend.trains(model, shown)
    counts = backend.count_spikes(model, shown)[0] if spikes is None else spikes.exc.sum(axis=1, dtype=np.int32)
    verdict = replace(reference, name=name, equal=None, recall=recall_at_1(model, counts, truth), gained=products)
    if exact is None:
        return verdict
    if spikes is None:  # counts are compared as the spikes of one step
        exact, spikes = (Trains(np.asarray(each)[:, None]) for each in (exact.exc.sum(axis=1), counts))
    found = compare(exact.films, spikes.films, images)
    mismatch = found.first
    if mismatch is not None and row.counts_only:
        mismatch = replace(mismatch, step=None)
    mismatch = earlier.first or weighed.first or mismatch
    compared, differing = earlier.spikes | found.spikes, earlier.differing + weighed.differing + found.differing
    return replace(verdict, equal=mismatch is None, compared=compared, differing=differing, mismatch=mismatch)
