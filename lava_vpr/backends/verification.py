"""A model and queries run on every backend that can run here, and compared spike by spike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends import registry as backends
from lava_vpr.backends.asking import PLAINLY, Asker, Asking, summed
from lava_vpr.backends.comparing import (
    FrontEndQueries,
    GainedQueries,
    Mismatch,
    SpikesCompared,
    compare,
    compare_front_ends,
    compare_gains,
    of_own_cells,
)
from lava_vpr.backends.interface import Advance, BackendRow, HostBackend, Presentations
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.cluster.tasks import Pool
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.presentations import Trains
from lava_vpr.errors import BackendUnavailableError, ConfigError, InputError, NetworkLimitError, PluginError
from lava_vpr.matching.decoders import confidence
from lava_vpr.matching.evaluation import evaluate
from lava_vpr.model import Model, as_integer, decode

Begin = Callable[[str], Advance | None]
"""Called with the name of a run when it starts; returns a callback for its progress, or None."""


@dataclass(frozen=True)
class Verdict:
    """The result of one backend.

    Attributes:
        name: Name of the backend.
        reason: Why it cannot run here; None if it did.
        equal: Whether every spike equals the host's; None for a float backend.
        queries: Number of queries that were compared.
        compared: Number of the host's spikes that were compared, for each population that the backend has; steps
            without a spike are compared, too.
        differing: Number of (query, step, neuron) at which spikes differ.
        mismatch: The first difference; None: all spikes are equal.
        recall: R@1 of the default decoder on these queries.
        gained: Number of products of activity and gain that were compared.
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
        """Number of the host's spikes that were compared, inputs included."""
        return sum(self.compared.values())

    @property
    def decided(self) -> int:
        """Number of compared spikes that the network decided: of exc and inh."""
        return sum(self.compared.get(population, 0) for population in Trains.DECIDED)

    @property
    def before(self) -> int:
        """Number of compared spikes of a spiking front end, all populations together."""
        return sum(spikes for population, spikes in self.compared.items() if population not in Trains.POPULATIONS)

    @property
    def hosts_kernel(self) -> bool:
        """Whether the backend calls the host's own kernel."""
        return self.name in BACKENDS and BACKENDS[self.name].hosts_kernel

    def as_json(self) -> dict[str, Any]:
        """The verdict in the layout of ``verify --json``, on which scripts rely."""
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


def recall_at_1(model: Model, counts: NDArray[np.int32], truth: NDArray[np.bool_]) -> float:
    """R@1 of the model's default decoder on spike counts (views n, neurons) of the presentations of n queries."""
    name = model.config.decoder.default
    scores = decode(model, summed(counts, len(counts) // len(truth)), name)
    return evaluate(scores, confidence(name, scores), truth).recall_at_1


@dataclass(frozen=True)
class HostRun:
    """The queries and the host's results, with which every other backend is compared.

    Attributes:
        model: The model.
        shown: The presentations of the queries, view after view.
        images: The name of each presentation's image.
        truth: bool (n, places): which places each query shows.
        trains: The host's spikes; None for a network in floating point.
        front_end: The queries for a spiking front end; None without one.
        gained: The activity that gains multiply; None if inputs have no gains.
        verdict: The verdict on the host itself.
    """

    model: Model
    shown: Presentations
    images: Sequence[str]
    truth: NDArray[np.bool_]
    trains: Trains | None
    front_end: FrontEndQueries | None
    gained: GainedQueries | None
    verdict: Verdict

    @classmethod
    def of(
        cls,
        model: Model,
        asking: Asking,
        seed: int | None,
        views: Sequence[EncodedTraverse],
        truth: NDArray[np.bool_],
        host: HostBackend,
    ) -> HostRun:
        """Run queries, in each of their ``views``, on the host; for the arguments see `verify`.

        Raises:
            InputError: no excitatory neuron spikes for a query, so its comparison would be empty.
        """

        presented = partial(_presented, model, asking, seed)
        asker = Asker(model, asking, seed)
        queries, shown = views[0], asker.presentations(views)
        model, images = asker.model, queries.names * asking.views
        trains = None if as_integer(model) is None else host.trains(model, shown)
        counts, _ = host.count_spikes(model, shown)
        silent = np.flatnonzero(summed(counts, asking.views).sum(axis=1) == 0)
        if len(silent):
            raise InputError(
                f"{queries.names[silent[0]]}: no neuron spikes for this query, so there is nothing to compare "
                f"({len(silent)} of {len(queries)} such queries); choose others with --places"
            )
        has_front_end = model.config.encoder.front_end is not None
        front_end = FrontEndQueries(model, views, presented, shown.bias) if has_front_end else None
        compared = compare_front_ends(BACKENDS["host"].front_end, front_end, None).spikes
        if model.config.encoder.direct is None:
            compared |= compare(trains.films, trains.films, images).spikes if trains else {"exc": int(counts.sum())}
        gained = GainedQueries.of(model, asking, views)
        products = 0 if gained is None else gained.activity.size
        recall = recall_at_1(model, counts, truth)
        verdict = Verdict("host", None, True, len(queries), compared, recall=recall, gained=products)
        return cls(model, shown, images, truth, trains, front_end, gained, verdict)


def _presented(model: Model, asking: Asking, seed: int | None, views: Sequence[EncodedTraverse]) -> Presentations:
    """Presentations of queries in each of their ``views``, the first of a drive."""
    return Asker(model, asking, seed).presentations(views)


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
    begin: Begin | None = None,
) -> list[Verdict]:
    """Run queries on the host and on other backends, and compare these with the host.

    Args:
        model: A trained model.
        queries: Encoded with the model's settings.
        truth: bool (n, places), for the recall of float backends.
        names: Names of backends, in the order of the verdicts; None: all. The host runs in any case.
        asking: How they are asked, checked (`Asking.check`).
        further: The queries in the further views in which they are presented (`Asking.of`).
        seed: The seed of the queries' noise; None: the model's.
        threads: Threads of the host engine.
        begin: Called before each run of a backend; None: progress is not reported.
    Raises:
        InputError: no excitatory neuron spikes for a query, so its comparison would be empty.
    """
    host = HostRun.of(model, asking, seed, (queries, *further), truth, HostBackend(Pool(threads)))
    verdicts = []
    for name in BACKENDS if names is None else names:
        try:
            found = host.verdict if name == "host" else _verdict(name, host, begin or (lambda name: None))
        except (BackendUnavailableError, ConfigError, NetworkLimitError, PluginError) as error:
            found = Verdict(name, str(error))
        verdicts.append(found)
    return verdicts


def _verdict(name: str, host: HostRun, begin: Begin) -> Verdict:
    """The verdict on the backend ``name``.

    Raises:
        LavaVprError: the backend cannot run here, or cannot run this model.
    """
    backends.require(name, host.model)
    row, shown, earlier = BACKENDS[name], host.shown, SpikesCompared({})
    if host.front_end is not None and host.model.config.encoder.direct is not None:
        return _in_one_run(row, host, host.front_end, begin(f"pixels to places on {name}"))
    if host.front_end is not None and row.front_end is not None:
        advance = begin(f"the front end on {name}")
        if row.exact:
            earlier = compare_front_ends(row.front_end, host.front_end, advance)
        elif host.gained is None:  # gains belong to the activity that the host computes
            shown = of_own_cells(row.front_end, host.front_end, advance)
    advance = begin(f"gains on {name}") if host.gained is not None and row.gains is not None else None
    shown, products, weighed = compare_gains(row.gains, host.gained, shown, advance)
    backend = backends.get(name, advance=begin(name))
    exact = host.trains if row.exact else None
    spikes = None if exact is None or row.counts_only else backend.trains(host.model, shown)
    counts = backend.count_spikes(host.model, shown)[0] if spikes is None else spikes.exc.sum(axis=1, dtype=np.int32)
    recall = recall_at_1(host.model, counts, host.truth)
    verdict = replace(host.verdict, name=name, equal=None, recall=recall, gained=products)
    if exact is None:
        return verdict
    if spikes is None:  # counts are compared as the spikes of one step
        exact, spikes = (Trains(np.asarray(each)[:, None]) for each in (exact.exc.sum(axis=1), counts))
    found = compare(exact.films, spikes.films, host.images)
    mismatch = found.first
    if mismatch is not None and row.counts_only:
        mismatch = replace(mismatch, step=None)
    mismatch = earlier.first or weighed.first or mismatch
    compared, differing = earlier.spikes | found.spikes, earlier.differing + weighed.differing + found.differing
    return replace(verdict, equal=mismatch is None, compared=compared, differing=differing, mismatch=mismatch)


def _in_one_run(row: BackendRow, host: HostRun, shown: FrontEndQueries, advance: Advance | None) -> Verdict:
    """The verdict on a backend that runs queries from pixels to places in one run.

    Raises:
        ConfigError: the backend runs no front end.
    """
    if row.front_end is None:
        raise ConfigError(f"{row.name} runs no front end, whose cells the neurons hear; train with --input frontend")
    if not row.exact:
        films = row.front_end(shown.model, shown.blocks, advance)
        counts = np.concatenate([film["exc"].sum(axis=1, dtype=np.int32) for film in films])
        return replace(host.verdict, name=row.name, equal=None, recall=recall_at_1(shown.model, counts, host.truth))
    found = compare_front_ends(row.front_end, shown, advance)
    return replace(
        host.verdict,
        name=row.name,
        equal=found.first is None,
        compared=found.spikes,
        differing=found.differing,
        mismatch=found.first,
    )
