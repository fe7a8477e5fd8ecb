"""The interface of backends: an object that counts the spikes of presentations, and a row that describes it.

Every other backend is compared with the host's, the compiled engine on this machine's processor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.engine.blocks import Block, in_blocks, of_conductances, of_integers
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.engine.inference import counting
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.whole import WholeNetwork
from lava_vpr.engine.presentations import PixelBlock, Trains
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.engine.rates import query_rates, spike_trains
from lava_vpr.errors import ConfigError, InputError
from lava_vpr.inputs.encoder import EncodedTraverse, Keep, check_encoded
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.model import Model, checked_network, integer_model

Advance = Callable[[int], None]
"""A function called with how many more presentations are done."""

RunFrontEnd = Callable[[Model, Iterable[PixelBlock], Advance | None], Iterator[Mapping[str, NDArray[np.uint8]]]]
"""Runs the spiking front end of a model (`front_end_of`) on blocks of images: of each block every spike of each
population by name, uint8 (n, steps, neurons)."""


RunGains = Callable[[NDArray[np.uint16], NDArray[np.uint8], NDArray[np.int32], Advance | None], NDArray[np.int64]]
"""Multiplies digits of activity, uint16 (n, digits, inputs), by the gains of each query's epoch: gains uint8 (epochs,
inputs), epochs int32 (n,). Returns the products, int64 (n, digits, inputs)."""


def front_end_of(model: Model) -> FrontEnd:
    """The spiking front end of a model that has one, with the network that hears its cells if one does.

    Raises:
        ConfigError: it has none.
    """
    spec = model.config.encoder.front_end
    if spec is None:
        raise ConfigError(f"input {model.config.encoder.kind} has no spiking front end; train with --input frontend")
    return WholeNetwork.of(spec, integer_model(model, "a front end").network) if spec.reading else spec


AT_ONCE = 20
"""Images that a front end is shown in one run: every spike of each is held, twice 2 MB."""

Events = dict[str, int]
"""The counted events of a run by name, summed over its presentations."""


def events_of(
    network: FixedNetwork, counts: NDArray[np.int32], inputs: NDArray[np.int64], inh: NDArray[np.int64]
) -> Events:
    """The events of presentations of which only spikes were counted.

    Args:
        network: What ran.
        counts: Spikes of exc in each presentation, (n, neurons).
        inputs: Spikes of each input, (inputs,).
        inh: Spikes of each inhibitory neuron, leaves and then the root, (inhibitory,).
    """
    operations = inputs @ network.prepared.row_sizes
    raw = np.array([operations, inputs.sum(), counts.sum(), inh[:-1].sum(), inh[-1]], np.int64)
    return counting.named_events(network, raw, len(counts))


@dataclass(frozen=True)
class Presentations:
    """Presentations for a backend; the noise of each follows from its rates, whatever its position.

    Attributes:
        rates: Rates of the inputs, (n, inputs): uint16 in units of 2^-16 for integer networks, uint32
            in units of 2^-32 for the float conductance model.
        seed: The seed of the noise.
        role: Role of the noise, one of `lava_vpr.engine.random.ROLES`.
        bias: Biases of the neurons in each presentation, int32 (n, neurons), where the network adapts
            (`lava_vpr.engine.adaptation`); None: the network's own.
        plain: Where ``rates`` include gains (`lava_vpr.engine.gains`): the rates without gains, from which the noise
            follows; None: ``rates`` are without gains.
        grey: What pixels take of the images (`Keep.GREY`), uint8 (n, height, width), where neurons hear the cells of
            the front end themselves; None: nobody kept it, and only the host's engine needs none.
    """

    rates: NDArray[Any]
    seed: int
    role: str = "query"
    bias: NDArray[np.int32] | None = None
    plain: NDArray[np.uint16] | None = None
    grey: NDArray[np.uint8] | None = None

    @property
    def _given(self) -> list[str]:
        """The names of what has a row a presentation."""
        return [name for name in ("rates", "bias", "plain", "grey") if getattr(self, name) is not None]

    @property
    def seen(self) -> NDArray[Any]:
        """Rates without gains, (n, inputs)."""
        return self.rates if self.plain is None else self.plain

    @cached_property
    def keys(self) -> NDArray[np.uint64]:
        """The key of each presentation's random numbers, uint64 (n,)."""
        return presentation_keys(self.seed, self.role, image_keys(self.seen))

    def part(self, chosen: slice | NDArray[np.int64]) -> Presentations:
        """Some of the presentations."""
        some = {name: getattr(self, name)[chosen] for name in self._given}
        return replace(self, **some)

    @classmethod
    def joined(cls, parts: Sequence[Presentations]) -> Presentations:
        """The presentations of all ``parts``, at least one, in their order; seed and role are those of the first."""
        joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in parts[0]._given}
        return replace(parts[0], **joined)


def query_presentations(model: Model, queries: EncodedTraverse, seed: int | None = None) -> Presentations:
    """The presentations of ``queries`` to ``model``; ``seed`` defaults to the model's.

    Raises:
        InputError: the queries were encoded with other settings, or are not encoded images.
    """
    check_encoded(queries, model.config.encoder, "queries")
    rates = query_rates(queries.activity, model.config)
    grey = None if model.config.encoder.direct is None else queries.grey
    return Presentations(rates, model.config.seed if seed is None else seed, grey=grey)


class Backend(Protocol):
    """Counts spikes of a model's excitatory neurons."""

    def count_spikes(self, model: Model, shown: Presentations) -> tuple[NDArray[np.int32], Events]:
        """Show the presentations to the network of ``model``.

        Returns:
            Counts int32 (n, neurons), and the events of the run.
        Raises:
            ConfigError: the backend runs no such network.
        """
        ...

    def trains(self, model: Model, shown: Presentations) -> Trains:
        """Every spike of the presentations ``shown`` to the integer network of ``model``.

        Raises:
            BackendUnavailableError: the backend tells counts only.
            ConfigError: the model is the float conductance model.
        """
        ...


@dataclass(frozen=True)
class BackendRow:
    """The description of a backend that users can choose.

    Attributes:
        name: The name that ``--backend`` takes.
        title: The backend in words, for people.
        make: Makes the backend from the number of threads it may use and from a progress callback (None: none).
        unavailable: Why it cannot run here, and what to do; None if it can.
        exact: Its spikes are the host's, bit for bit; otherwise it computes in floating point, and its recall is
            compared instead.
        hosts_kernel: Its model calls the host engine's own kernel, so that equal spikes prove the data path, not the
            arithmetic.
        counts_only: It gives spike counts, but no single spikes.
        board: Name of the board whose bundles it runs; None: it needs no board.
        timing: How ``bench`` times it: ``compiled`` in a fresh process, ``lava`` by the times that Lava's runs report
            with, ``board`` by the vendor's profiler; None: not at all.
        default: ``bench`` times it if no backend was asked for.
        limit: Most queries that ``bench`` times it on; None: all.
        batch: Presentations that ``bench`` runs in one batch, at least.
        together: Queries of a stream in one call: few bound the memory, but a backend that starts a process or reads a
            bundle for each call gets many.
        front_end: What runs the spiking front end before the network; None: the backend begins with the inputs' spikes.
        gains: What multiplies activity by gains before rates are made of it; None: the host does.
    """

    name: str
    title: str
    make: Callable[[int, Advance | None], Backend]
    unavailable: Callable[[], str | None]
    exact: bool = True
    hosts_kernel: bool = False
    counts_only: bool = False
    board: str | None = None
    timing: Literal["compiled", "lava", "board"] | None = None
    default: bool = False
    limit: int | None = None
    batch: int = 1
    together: int = 8192
    front_end: RunFrontEnd | None = None
    gains: RunGains | None = None


@dataclass(frozen=True)
class FromPixels:
    """A backend, which also runs a network from pixels to places where neurons hear the cells of the front end.

    Attributes:
        alone: The backend, for networks whose inputs have rates.
        run: Its `BackendRow.front_end`.
        advance: Called with the number of presentations that are done.
    """

    alone: Backend
    run: RunFrontEnd
    advance: Advance | None = None

    def count_spikes(self, model: Model, shown: Presentations) -> tuple[NDArray[np.int32], Events]:
        """See `Backend.count_spikes`."""
        if model.config.encoder.direct is None:
            return self.alone.count_spikes(model, shown)
        network = checked_network(model, "the backend", direct=True)
        counts, sent = np.zeros((len(shown.rates), network.neurons), np.int32), np.zeros(network.inputs, np.int64)
        inh = np.zeros(network.inhibitory, np.int64)
        for part, films in self._films(model, shown):
            counts[part] = films["exc"].sum(axis=1, dtype=np.int32)
            sent += films["cells"].sum(axis=(0, 1), dtype=np.int64)
            inh += films["inh"].sum(axis=(0, 1), dtype=np.int64)
        return counts, events_of(network, counts, sent, inh)

    def trains(self, model: Model, shown: Presentations) -> Trains:
        """See `Backend.trains`."""
        if model.config.encoder.direct is None:
            return self.alone.trains(model, shown)
        pieces = [[films[name] for name in ("exc", "cells", "inh")] for _, films in self._films(model, shown)]
        return Trains(*map(np.concatenate, zip(*pieces, strict=True)))

    def _films(self, model: Model, shown: Presentations) -> Iterator[tuple[slice, Mapping[str, NDArray[np.uint8]]]]:
        """Every spike of some presentations at a time, and which they are.

        Raises:
            InputError: what pixels take was not kept.
        """
        if shown.grey is None:
            raise InputError(f"the queries' pixels were not kept, which neurons hear; encode them with {Keep.GREY}")
        parts = [slice(start, start + AT_ONCE) for start in range(0, len(shown.grey), AT_ONCE)]
        blocks = PixelBlock(shown.grey, shown.bias).in_parts(AT_ONCE)
        yield from zip(parts, self.run(model, blocks, self.advance), strict=True)


@dataclass(frozen=True)
class HostBackend:
    """The compiled engine; results do not depend on the number of threads."""

    pool: Pool = ONE_THREAD

    def count_spikes(self, model: Model, shown: Presentations) -> tuple[NDArray[np.int32], Events]:
        """See `lava_vpr.backends.interface.Backend.count_spikes`."""
        block = Block(shown.rates, shown.keys, shown.bias)
        if isinstance(model.network, ConductanceState):
            network = model.network, model.config
            return in_blocks(of_conductances, network, block, pool=self.pool)
        integer = checked_network(model, "host", direct=True)
        return in_blocks(of_integers, integer, block, pool=self.pool)

    def trains(self, model: Model, shown: Presentations) -> Trains:
        """See `lava_vpr.backends.interface.Backend.trains`."""
        network = checked_network(model, "host", direct=True)
        return spike_trains(network, shown.rates, shown.keys, bias=shown.bias, threads=self.pool.threads)
