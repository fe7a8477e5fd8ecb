"""Presentations in blocks: each is counted by itself, on threads here, or as a task by a cluster's workers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from lava_vpr.cluster.tasks import Cluster, run_tasks
from lava_vpr.config import Config
from lava_vpr.engine.conductance import model as conductance
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import FixedNetwork

BLOCK = 128
"""Presentations of a task: of a network of 10,000 neurons half a second, of one of 100 what a task itself costs."""

N = TypeVar("N")
Counted = tuple[NDArray[np.int32], dict[str, int]]
"""Spike counts int32 (n, neurons), and the events of the presentations by name, summed."""


class Block(NamedTuple):
    """Some presentations.

    Attributes:
        rates: Rates of the inputs, (n, inputs).
        keys: Their presentation keys, uint64 (n,).
        bias: Biases of the neurons in each, int32 (n, neurons); None: the network's.
    """

    rates: NDArray[Any]
    keys: NDArray[np.uint64]
    bias: NDArray[np.int32] | None = None


Count = Callable[[N, Block, int], Counted]
"""A function of a module that counts a block: of a network, its presentations, and threads."""


def of_integers(network: FixedNetwork, block: Block, threads: int) -> Counted:
    """Counts by the integer network; see `fixed.count_spikes`."""
    return fixed.count_spikes(network, block.rates, block.keys, bias=block.bias, threads=threads)[:2]


def of_conductances(network: tuple[ConductanceState, Config], block: Block, threads: int) -> Counted:
    """Counts by the conductance network of some settings; see `conductance.count_spikes`."""
    state, config = network
    return conductance.count_spikes(state, block.rates, block.keys, config, threads=threads)


class _Asked(NamedTuple):
    """What all blocks of a run are counted with."""

    counting: Callable[[Any, Block, int], Counted]
    network: Any


def counted(count: Count[N], network: N, blocks: Iterable[Block], *, cluster: Cluster, total: int) -> Iterator[Counted]:
    """What ``total`` blocks count, in their order, by a cluster."""
    plain = replace(network) if isinstance(network, FixedNetwork) else network  # without what it has laid out already
    asked = _Asked(count, plain)
    for sparse, events in run_tasks(sparsely, blocks, shared=asked, cluster=cluster, called="blocks", total=total):
        yield sparse.toarray(), events


def sparsely(asked: _Asked, block: Block) -> tuple[Any, dict[str, int]]:
    """A task: counts of one block, of which nearly all are 0 where places are many, as those that are not."""
    counts, events = asked.counting(asked.network, block, 1)
    return csr_matrix(counts), events


def in_blocks(count: Count[N], network: N, shown: Block, *, threads: int, cluster: Cluster | None) -> Counted:
    """Spike counts and events of presentations; equal whoever counts.

    Args:
        count: Counts a block.
        network: What it is given first.
        shown: The presentations.
        threads: Threads of this process.
        cluster: Who counts instead; None: those threads.
    """
    if cluster is None or not len(shown.rates):
        return count(network, shown, threads)
    parts = [slice(start, start + BLOCK) for start in range(0, len(shown.rates), BLOCK)]
    blocks = (
        Block(shown.rates[part], shown.keys[part], None if shown.bias is None else shown.bias[part]) for part in parts
    )
    counts, summed = [], dict[str, int]()
    for some, events in counted(count, network, blocks, cluster=cluster, total=len(parts)):
        counts.append(some)
        summed = {name: summed.get(name, 0) + number for name, number in events.items()}
    return np.concatenate(counts), summed
