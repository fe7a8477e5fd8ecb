"""How long a processor takes for a query by itself: the host's share beside a board, and matchers without a network.

Single queries, one after another, on one thread, as a robot asks them; a batch takes less of each.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import HostBackend
from lava_vpr.backends.rivals import chosen
from lava_vpr.bench.measure.child import decoder_of, host_answer, singles
from lava_vpr.bench.peers import Places, cosine_answer, hog_answer, one_blas_thread, sad_answer
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.engine.draw import poisson_spikes
from lava_vpr.engine.inference.biases import biases, schedule, slopes, start_membranes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.inputs.encoder import Keep
from lava_vpr.model import checked_network

SINGLES, SECONDS = 1000, 1.0
"""Queries that are timed, at most, and how long at most."""


def _median(answer: Callable[[int], object], queries: int) -> float:
    """The median time of a query in ms; ``answer`` takes its number."""

    def of_one(chosen: NDArray[np.int64]) -> Places:
        answer(int(chosen[0]))
        return chosen

    of_one(np.zeros(1, np.int64))  # what is compiled or prepared at the first use is not timed
    return float(np.median(singles(of_one, np.arange(queries), SINGLES, SECONDS)))


def _draw(network: FixedNetwork, rates: NDArray[np.uint16], key: np.uint64) -> None:
    """Draw what the host sends of a presentation: input spikes, or settings of the inputs that integrate a bias."""
    if network.bias_input:
        biases(rates)
        start_membranes(int(key), len(rates))
    elif network.regular:
        schedule(slopes()[rates], key, network.steps)
    else:
        poisson_spikes(rates, key, network.steps)


def beside_board(queries: QuerySet) -> float:
    """Median time in ms of the host's own work for a query that a board answers, encoding and traffic apart.

    Input spikes are drawn, or settings of inputs worked out, and spike counts are decoded.

    Raises:
        ConfigError: the model has no integer network.
    """
    network, match = checked_network(queries.model, "bench"), decoder_of(queries.model)
    counts, _ = HostBackend().count_spikes(queries.model, queries.shown.part(slice(1)))
    rates, keys = queries.shown.rates, queries.shown.keys

    def work(k: int) -> None:
        _draw(network, rates[k], keys[k])
        match(counts)

    with one_blas_thread():
        return _median(work, len(queries))


def host(queries: QuerySet) -> float:
    """Median time in ms of a query on the host engine, from input rates to match."""
    answer, rates = host_answer(queries.model, queries.shown.seed), queries.shown.rates
    with one_blas_thread():
        return _median(lambda k: answer(rates[k : k + 1]), len(queries))


def cosine(queries: QuerySet) -> float:
    """Median time in ms of a query from input rates to the place of the nearest reference by cosine, float32."""
    rates = queries.shown.rates[:SINGLES]
    answer, _ = cosine_answer(queries.model, rates)
    with one_blas_thread():
        return _median(lambda k: answer(slice(k, k + 1)), len(rates))


def sad(queries: QuerySet) -> float:
    """Median time in ms of a query from patch to the place of the nearest reference by SAD, 8-bit integers.

    Raises:
        InputError: the queries were encoded without patches.
    """
    patches = queries.images.kept(Keep.PATCHES, "SAD")[:SINGLES]
    answer, _ = sad_answer(queries.model, patches)
    return _median(lambda k: answer(slice(k, k + 1)), len(patches))


def hog(queries: QuerySet) -> float:
    """Median time in ms of a query from its HOG descriptor to the place of the nearest reference by cosine, float32.

    Raises:
        InputError: the queries were encoded without HOG descriptors.
        ConfigError: the model keeps none.
    """
    chosen(queries.model, ("hog",))
    descriptors = queries.images.kept(Keep.HOG, "HOG")[:SINGLES]
    answer, _ = hog_answer(queries.model, descriptors)
    with one_blas_thread():
        return _median(lambda k: answer(slice(k, k + 1)), len(descriptors))
