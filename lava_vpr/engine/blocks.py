"""Presentations in blocks, each counted independently, by threads of this process or as a task of a cluster's
workers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config
from lava_vpr.engine.conductance import model as conductance
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.inference import counting
from lava_vpr.engine.inference.fixed import FixedNetwork

BLOCK = 128
"""Presentations per task: half a second of work for 10,000 neurons; for 100 neurons as much work as starting a task."""

N = TypeVar("N")
Counted = tuple[NDArray[np.int32], dict[str, int]]
"""Spike counts int32 (n, neurons), and the events of the presentations by name, summed."""


class Block(NamedTuple):
    """Some presentations.

    Attributes:
        rates: Rates of the inputs, (n, inputs).
        keys: Their presentation keys, uint64 (n,).
        bias: Biases of the neurons in each, int32 (n, neurons); None: the network's.
        kept: The neurons that the network consists of, bool (neurons,); None: all.
    """

    rates: NDArray[Any]
    keys: NDArray[np.uint64]
    bias: NDArray[np.int32] | None = None
    kept: NDArray[np.bool_] | None = None

    def parts(self, size: int) -> list[Block]:
        """The same presentations in blocks of at most ``size``."""
        cuts = [slice(start, start + size) for start in range(0, len(self.rates), size)]
        biases = [None if self.bias is None else self.bias[cut] for cut in cuts]
        return [Block(self.rates[cut], self.keys[cut], bias, self.kept) for cut, bias in zip(cuts, biases, strict=True)]


Count = Callable[[N, Block, int], Counted]
"""A module-level function that counts a block, called with a network, the block and a number of threads."""


def of_integers(network: FixedNetwork, block: Block, threads: int) -> Counted:
    """Counts by the integer network; see `counting.count_spikes`."""
    if block.kept is not None:
        weights, bias = network.weights[:, block.kept], network.bias[block.kept]
        network = replace(network, weights=np.ascontiguousarray(weights), bias=np.ascontiguousarray(bias))
    return counting.count_spikes(network, block.rates, block.keys, bias=block.bias, threads=threads)[:2]


def of_conductances(network: tuple[ConductanceState, Config], block: Block, threads: int) -> Counted:
    """Counts by the conductance network of some settings; see `conductance.count_spikes`."""
    state, config = network
    return conductance.count_spikes(state, block.rates, block.keys, config, threads=threads)


class _BlockTask(NamedTuple):
    """A block as a task: how it is counted, and its presentations."""

    counting: Callable[[Any, Block, int], Counted]
    block: Block


def counted(count: Count[N], network: N, blocks: Iterable[Block], *, pool: Pool, total: int) -> Iterator[Counted]:
    """The counts of ``total`` blocks in order, each as soon as it is known; equal on threads and on a cluster.

    Args:
        count: Counts a block.
        network: First argument of ``count``; a cluster's workers keep it until another network is used.
        blocks: The presentations, made lazily, only as many at once as are being counted.
        pool: Threads of this process share each block; a cluster's workers count one block per thread.
        total: How many blocks there are.
    """
    if pool.here:
        yield from (count(network, block, pool.threads) for block in blocks)
        return
    tasks = (_BlockTask(count, block) for block in blocks)
    for sparse, events in pool.map(sparsely, tasks, shared=network, called="blocks", total=total):
        yield sparse.toarray(), events


def sparsely(network: Any, task: _BlockTask) -> tuple[Any, dict[str, int]]:
    """A task: the counts of one block as a sparse array, since with many places nearly all are 0."""
    from scipy.sparse import csr_matrix  # only a cluster's workers need it

    counts, events = task.counting(network, task.block, 1)
    return csr_matrix(counts), events


def in_blocks(count: Count[N], network: N, shown: Block, *, pool: Pool) -> Counted:
    """Spike counts and events of presentations; as `counted`, but all at once."""
    if pool.here or not len(shown.rates):
        return count(network, shown, pool.threads)
    parts = shown.parts(BLOCK)
    counts, summed = [], dict[str, int]()
    for some, events in counted(count, network, parts, pool=pool, total=len(parts)):
        counts.append(some)
        summed = {name: summed.get(name, 0) + number for name, number in events.items()}
    return np.concatenate(counts), summed
