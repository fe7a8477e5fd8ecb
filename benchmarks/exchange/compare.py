"""Exported graphs in snnTorch beside the host engine, on real images: which spike counts differ, and why.

    LAVA_VPR_DATA=... python -m benchmarks.exchange.compare [--queries N]      (`make nir-peers` sets it up)

Summer places 0:100 of Nordland are learned, winter images asked, all of them the same input spikes in both. NIR has no
integers and snnTorch computes in single precision, so a decayed membrane keeps the fraction that the chip truncates.
Every difference is attributed by a literal model that reads the same graph: in single precision and without truncation
it must give every spike of snnTorch, with truncation every spike of the host. Two networks that need no truncation, the
same one without leak and without memory, must be equal in every spike. Fails where any of that does not hold.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import click
import nir
import numpy as np
from numpy.typing import NDArray

from benchmarks.exchange.literal import spikes_of
from benchmarks.places import encoded, learn
from benchmarks.program import BenchmarkTable, Printed, program, python_of, run_elsewhere, verdict
from lava_vpr.backends.interface import HostBackend, query_presentations
from lava_vpr.config import preset
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.exchange.formats import TIME_STEP
from lava_vpr.exchange.nir_writing import graph_of
from lava_vpr.loihi import DECAY_UNITY
from lava_vpr.model import IntegerModel, Model, decode, integer_model
from lava_vpr.storage.writing import temporary_folder

PYTHON = python_of("torch")
WORKER = Path(__file__).with_name("in_snntorch.py")
LIMIT_S = 1800
NOTE = (
    "R@1: of the host's counts / of snnTorch's. float32 = snnTorch: NIR's equations in single precision give every "
    "spike of snnTorch; truncated = host: with truncation, every spike of the host. own import: what snnTorch's "
    "import_from_nir makes."
)


@dataclass(frozen=True)
class ExchangeCase:
    """A network and the queries that it is asked.

    Attributes:
        name: What it is.
        model: The network, with its references.
        equal: Whether snnTorch must give every spike.
    """

    name: str
    model: IntegerModel
    equal: bool = False


@dataclass(frozen=True)
class CaseSpikes:
    """Spikes of one case, uint8 (queries, interval, population), of each simulator.

    Attributes:
        host: The host engine, then its inhibitory neurons.
        there: snnTorch, node by node.
        few: What snnTorch's own import makes, of the first few queries.
        single, whole: The literal model in single precision, and with truncation.
    """

    host: NDArray[np.uint8]
    there: NDArray[np.uint8]
    few: NDArray[np.uint8]
    single: NDArray[np.uint8]
    whole: NDArray[np.uint8]


def cases() -> Iterator[ExchangeCase]:
    """The default network, what it becomes where nothing is truncated, and the fastest preset."""
    model = integer_model(learn((0, 100), preset("loihi")), "NIR")
    yield ExchangeCase("preset loihi", model)
    # A step alone brings less than many do, so the threshold of the one without memory is a third.
    for name, decay, share in (("without leak", 0, 1), ("without memory", DECAY_UNITY, 3)):
        network = replace(model.network, decay=decay, threshold=model.network.threshold // share)
        network = replace(network, bias=np.minimum(network.bias, 0))  # no neuron spikes by its bias alone
        yield ExchangeCase(f"loihi {name}", replace(model, network=network), equal=True)
    yield ExchangeCase("preset fast", integer_model(learn((0, 100), preset("fast")), "NIR"))


def case_spikes(chosen: list[ExchangeCase], queries: int) -> list[CaseSpikes]:
    """The spikes of every case.

    Raises:
        InputError: the environment is missing, or snnTorch fails in it.
    """
    with temporary_folder() as folder:
        shown = []
        for number, case in enumerate(chosen):
            images = np.linspace(0, case.model.places - 1, queries).astype(np.int64)
            trains = HostBackend().trains(
                case.model, query_presentations(case.model, encoded("winter", case.model.config.encoder).take(images))
            )
            if trains.inputs is None or trains.inh is None:
                raise BackendUnavailableError("the host tells no spikes of inputs; this is a defect")
            path = folder / f"{number}.nir"
            nir.write(path, graph_of(case.model.network, TIME_STEP))
            packed = np.packbits(trains.inputs, axis=2)
            np.savez(path.with_suffix(".trains.npz"), packed=packed, inputs=trains.inputs.shape[2])
            shown.append((path, trains.inputs, np.concatenate([trains.exc, trains.inh], axis=2)))
        run_elsewhere("snnTorch", PYTHON, "nir-peers", "-I", WORKER, folder, seconds=LIMIT_S)
        return [_spikes(*parts) for parts in shown]


def _spikes(path: Path, inputs: NDArray[np.uint8], host: NDArray[np.uint8]) -> CaseSpikes:
    """What snnTorch wrote beside ``path``, and what the literal model makes of the graph."""
    graph, width = nir.read(path), host.shape[2]
    with np.load(path.with_suffix(".result.npz")) as file:
        there, few = (np.unpackbits(file[name], axis=2, count=width) for name in ("spikes", "few"))
    single, whole = (spikes_of(graph, inputs, single=not cut, truncates=cut) for cut in (False, True))
    return CaseSpikes(host, there, few, single, whole)


def failures(case: ExchangeCase, spikes: CaseSpikes) -> list[str]:
    """What does not hold, in words; empty if every difference is attributed."""
    found = []
    if not np.array_equal(spikes.single, spikes.there):
        found.append(f"{case.name}: snnTorch differs from NIR's equations in single precision")
    if not np.array_equal(spikes.whole, spikes.host):
        found.append(f"{case.name}: the host differs from NIR's equations with truncation")
    if case.equal and not np.array_equal(spikes.there, spikes.host):
        found.append(f"{case.name}: snnTorch differs from the host, though nothing is truncated")
    if not spikes.host.any():
        found.append(f"{case.name}: no neuron spikes, so nothing is shown")
    return found


def recall_at_1(model: Model, counts: NDArray[np.int64], queries: int) -> float:
    """R@1 of spike ``counts``; query i shows the place from which it was taken."""
    right = np.linspace(0, model.places - 1, queries).astype(np.int64)
    scores = decode(model, counts.astype(np.int32), model.config.decoder.default)
    return float((scores.argmax(axis=1) == right).mean())


def row(case: ExchangeCase, spikes: CaseSpikes) -> list[str]:
    """A row of the table."""
    neurons, queries = case.model.neurons, len(spikes.host)
    own, there = (of[:, :, :neurons].sum(axis=1, dtype=np.int64) for of in (spikes.host, spikes.there))
    apart = np.abs(own - there)
    recall = [f"{100 * recall_at_1(case.model, counts, queries):.0f}" for counts in (own, there)]
    few = spikes.few[:, :, :neurons].sum(axis=1, dtype=np.int64)
    return [
        case.name,
        f"{own.sum():,}",
        f"{there.sum():,}",
        f"{int((apart == 0).all(axis=1).sum())} / {queries}",
        f"{int((apart > 0).sum()):,} / {apart.size:,}",
        f"{int(apart.max())}",
        " / ".join(recall),
        "yes" if np.array_equal(spikes.single, spikes.there) else "NO",
        "yes" if np.array_equal(spikes.whole, spikes.host) else "NO",
        f"{int((few == own[: len(few)]).all(axis=1).sum())} / {len(few)}",
    ]


@program("nordland")
@click.option("--queries", type=click.IntRange(1, 100), default=100, show_default=True, help="Winter images to ask.")
def main(queries: int) -> Printed:
    """Where snnTorch's spikes of exported graphs are the host's, and what the others differ by."""
    chosen = list(cases())
    results = list(zip(chosen, case_spikes(chosen, queries), strict=True))
    columns = ("network", "host spikes", "snnTorch", "queries equal", "counts apart", "by at most", "R@1")
    columns += ("float32 = snnTorch", "truncated = host", "own import equal")
    title = "exported NIR graphs in snnTorch beside the host engine"
    rows = [row(*result) for result in results]
    yield BenchmarkTable(columns, rows, [NOTE], title, record="snntorch")
    found = [line for result in results for line in failures(*result)]
    yield from verdict(found, "every difference is attributed")


if __name__ == "__main__":
    main()
