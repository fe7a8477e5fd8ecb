"""Our metrics (`lava_vpr.bench.measure.workload`) beside those of the package neurobench, on the same spikes.

    LAVA_VPR_DATA=... python -m benchmarks.neurobench.metrics [--queries 20]

`make neurobench` installs the package in an environment beside; `benchmarks/neurobench/package.py` runs there, in a
process of its own, and builds the network again in torch. The neurons there must spike as ours do, and every metric be
equal: counts exactly, fractions to the digits that the package rounds to.
"""

from __future__ import annotations

import json
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.places import encoded, learn
from benchmarks.program import Printed, program, python_of, run_elsewhere, verdict
from lava_vpr.bench.measure.workload import of_trains
from lava_vpr.bench.results import Workload
from lava_vpr.config import PRESETS, preset
from lava_vpr.configfile import update
from lava_vpr.engine.inference.counting import count_spikes, inhibitory_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.presentations import Trains
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.engine.rates import draw_trains, query_rates
from lava_vpr.errors import BackendUnavailableError, LavaRunError
from lava_vpr.model import integer_model
from lava_vpr.show.table import Table
from lava_vpr.storage.writing import temporary_folder

PYTHON, PROGRAM = python_of("torch"), Path(__file__).with_name("package.py")
NUMBERS = ("threshold", "decay", "inhibition", "inhibition_exponent")
ROUNDED = 0.5e-4
"""neurobench 2.3.0 rounds connection sparsity to 4 digits."""

Pair = tuple[float, float]


def trains_of(network: FixedNetwork, rates: NDArray[np.uint16], keys: NDArray[np.uint64]) -> Trains:
    """Every spike of some presentations, as the host engine has them."""
    _, _, exc = count_spikes(network, rates, keys, raster=True)
    inputs = draw_trains(rates, keys, network.steps, network.interval, regular=network.regular)
    return Trains(exc, inputs, inhibitory_spikes(network, exc))


def compare(network: FixedNetwork, rates: NDArray[np.uint16], keys: NDArray[np.uint64]) -> dict[str, Pair]:
    """Every metric by name: ours, neurobench's.

    Inputs must be injected directly, into a network without leaves: neurobench takes inputs for data.

    Raises:
        BackendUnavailableError: inputs or inhibition are otherwise.
        InputError: the package is not installed, or failed.
        LavaRunError: its neurons spike otherwise.
    """
    if network.input_compartments or network.leaves:
        raise BackendUnavailableError("neurobench is given networks without compartments of inputs, and without leaves")
    trains = trains_of(network, rates, keys)
    ours = of_trains(network, trains, rates, keys)
    with temporary_folder() as folder:
        problem = folder / "problem.npz"
        numbers = {name: np.int64(getattr(network, name)) for name in NUMBERS}
        np.savez(problem, weights=network.weights, bias=network.bias, spikes=trains.inputs, **numbers)
        ended = run_elsewhere("neurobench", PYTHON, "neurobench", PROGRAM, problem, seconds=1200)
    answer = json.loads(ended.out.strip().splitlines()[-1])
    if not np.array_equal(np.array(answer["counts"]), trains.exc.sum(axis=1, dtype=np.int64)):
        raise LavaRunError("the network built for neurobench spikes otherwise than ours", ended.err)
    theirs = answer["metrics"] | answer["metrics"].pop("SynapticOperations")
    return {name: (float(getattr(ours, name)), float(theirs[key])) for name, key in THEIRS.items()}


THEIRS = {
    "footprint_bytes": "Footprint",
    "parameters": "ParameterCount",
    "connection_sparsity": "ConnectionSparsity",
    "activation_sparsity": "ActivationSparsity",
    "dense_operations": "Dense",
    "effective_macs": "Effective_MACs",
    "effective_acs": "Effective_ACs",
    "membrane_updates": "MembraneUpdates",
}
"""Fields of `Workload` and neurobench's names."""


def equal(pairs: dict[str, Pair]) -> bool:
    """Whether our figure and neurobench's agree for every metric, within what the package rounds."""
    if set(pairs) != set(Workload.__dataclass_fields__):
        return False
    allowed = {"connection_sparsity": ROUNDED, "activation_sparsity": 1e-12}
    return all(abs(a - b) <= allowed.get(name, 0.0) for name, (a, b) in pairs.items())


def problems(queries: int) -> list[tuple[str, FixedNetwork, NDArray[np.uint16], NDArray[np.uint64]]]:
    """Networks learned from real images, and winter queries."""
    configs = {name: preset(name) for name in PRESETS if name != "paper"}
    configs["loihi, 1 bit"] = update(preset("loihi"), {"network": {"weight_bits": 1}})
    configs["loihi, without signs"] = update(preset("loihi"), {"network": {"signed": False}})
    made = []
    for name, config in configs.items():
        for places in ((0, 100), (0, 200)):
            network = integer_model(learn(places, config), "the comparison").network
            winter = encoded("winter", config.encoder).take(slice(0, queries))
            rates = query_rates(winter.activity, config)
            keys = presentation_keys(config.seed, "query", image_keys(rates))
            made.append((f"{name}, {places[1]} places", network, rates, keys))
    return made


@program("nordland")
@click.option("--queries", default=20, show_default=True, help="Winter images that are presented.")
def main(queries: int) -> Printed:
    """Both sides of every metric."""
    failed = []
    for name, network, rates, keys in problems(queries):
        pairs = compare(network, np.asarray(rates, np.uint16), keys)
        rows = [
            [metric, *(f"{value:,.6g}" if value < 1 else f"{value:,.2f}" for value in both)]
            for metric, both in pairs.items()
        ]
        columns = ("per query where it depends on it", "ours", "neurobench 2.3.0")
        yield Table(columns, rows, title=f"{name}, {len(keys)} queries")
        failed += [] if equal(pairs) else [f"not equal: {name}"]
    yield from verdict(failed, "all equal, and so are the spikes")


if __name__ == "__main__":
    main()
