"""Speed of the network in Lava on this machine, side by side with the programs that it is compared with.

    python -m benchmarks lava_speed

Two comparisons, each alternating the two sides within one run, so that what else the machine does hits both:

- the network composed of this project's Processes against the same network wired from Lava's own library, six Processes
  each, 784 inputs and 400 neurons, in integers: time steps per second, of the wall clock;
- the fused Process, one batch of 64 presentations a Lava step, against the host engine on one thread, on a network of
  the default size (2048 inputs, 100 neurons, 64 steps): presentations per second, of the wall clock.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from lava.magma.core.run_conditions import RunSteps
from lava.magma.core.run_configs import Loihi2SimCfg
from lava.proc.io.source import RingBuffer
from numpy.typing import NDArray

from benchmarks.program import BenchmarkTable, Printed, elapsed, program, turns
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.engine.rates import draw_trains
from lava_vpr.errors import LavaRunError
from lava_vpr.isolated.runner import run_isolated
from lava_vpr.processes.base.magma import FIXED_TAG
from lava_vpr.processes.base.shared_memory import shared_array
from lava_vpr.processes.encoders.process import RegularEncoder
from lava_vpr.processes.networks.process import FusedPlaceNetwork, PlaceNetwork

ROUNDS = 9
BATCH, BATCHES = 64, 40
TIMEOUT = 900.0
Arrays = dict[str, NDArray[Any]]
SPIKES_PER_STEP = 20.0
ACTIVE = 0.45
"""Share of the inputs that have a rate, as in real images."""
CONFIG = {"select_tag": FIXED_TAG}


def some_network(inputs: int, neurons: int) -> FixedNetwork:
    """A network of about the weights, threshold and inhibition that training leaves with 3 bits and a sign."""
    rng = np.random.default_rng(0)
    weights = np.clip(np.round(rng.normal(0, 1.5, (inputs, neurons))), -7, 7)
    network = FixedNetwork(
        weights=weights.astype(np.int16),
        bias=np.full(neurons, -64, np.int32),
        bits=3,
        signed=True,
        threshold=15,
        inhibition=10,
        inhibition_exponent=0,
        decay=341,
        steps=61,
        regular=True,
    )
    network.check()
    return network


def some_input(network: FixedNetwork, n: int) -> tuple[NDArray[np.uint16], NDArray[np.uint64]]:
    """Rates and keys of ``n`` images."""
    rng = np.random.default_rng(1)
    rates = rng.random((n, network.inputs)) * (rng.random((n, network.inputs)) < ACTIVE)
    rates *= 65536 * SPIKES_PER_STEP / rates.sum(axis=1, keepdims=True)
    made = rates.astype(np.uint16)
    return made, presentation_keys(0, "query", image_keys(made))


def start_composed(network: FixedNetwork, n: int) -> tuple[Any, PlaceNetwork]:
    """The Process to run, and the network behind it, of our own Processes."""
    rates, keys = some_input(network, n)
    encoder = RegularEncoder(rates=rates, keys=keys, steps=network.steps, silent_steps=network.silent_steps)
    composed = PlaceNetwork(network=network)
    encoder.s_out.connect(composed.s_in)
    return encoder, composed


def start_library(network: FixedNetwork, n: int) -> tuple[Any, PlaceNetwork]:
    """The Process to run, and the network behind it, of nothing but Lava's library; trains are made beforehand."""
    rates, keys = some_input(network, n)
    trains = draw_trains(rates, keys, network.steps, network.interval, regular=network.regular).astype(np.int32)
    source, library = RingBuffer(data=trains.reshape(n * network.interval, -1).T), PlaceNetwork(network=network)
    source.s_out.connect(library.s_in)
    return source, library


def alternate(first: Callable[[], object], second: Callable[[], object], rounds: int) -> NDArray[np.float64]:
    """Seconds of each call, (2, rounds)."""
    return np.array(list(turns({0: elapsed(first), 1: elapsed(second)}, rounds).values()))


def composed_and_library(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Steps per second in each presentation, (2, rounds), ours first."""
    network, rounds = some_network(784, 400), options["rounds"]
    interval = network.interval
    (source, ours), (theirs, library) = start_composed(network, rounds + 1), start_library(network, rounds + 1)
    step = {"condition": RunSteps(num_steps=interval)}
    times = alternate(
        lambda: source.run(**step, run_cfg=Loihi2SimCfg(**CONFIG)),
        lambda: theirs.run(**step, run_cfg=Loihi2SimCfg(**CONFIG, select_sub_proc_model=True)),
        rounds,
    )
    equal = np.array_equal(ours.v.get(), library.v.get())
    source.stop()
    theirs.stop()
    if not equal:
        raise LavaRunError("our network and the library's differ; run tests/processes/test_processes.py")
    return {"rates": interval / times}


def fused_and_host(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Presentations per second in some batches, (2, rounds), the fused Process first."""
    network, rounds, batch, batches = some_network(2048, 100), options["rounds"], options["batch"], options["batches"]
    n = batch * batches
    rates, keys = some_input(network, n)
    every = (np.tile(rates, (rounds + 1, 1)), np.tile(keys, rounds + 1))
    counts = shared_array((len(every[0]), network.neurons), np.int32)
    fused = FusedPlaceNetwork(network=network, rates=every[0], keys=every[1], batch=batch, counts=counts)
    expected: list[NDArray[np.int32]] = []

    def host() -> None:
        """Present as many batches to the host engine, one after the other."""
        parts = [slice(start, start + batch) for start in range(0, n, batch)]
        expected[:] = [count_spikes(network, rates[part], keys[part])[0] for part in parts]

    step = {"condition": RunSteps(num_steps=batches), "run_cfg": Loihi2SimCfg(**CONFIG)}
    times = alternate(lambda: fused.run(**step), host, rounds)
    fused.stop()
    if not np.array_equal(counts, np.tile(np.concatenate(expected), (rounds + 1, 1))):
        raise LavaRunError("the fused Process and the host engine differ; run tests/processes/test_processes.py")
    # The first batch of a run was computed at the end of the one before: it does not count.
    return {"rates": np.array([[n - batch], [n]]) / times}


@program()
def main() -> Printed:
    """Speed of our networks in Lava beside the programs that they are compared with."""
    options, rows = {"rounds": ROUNDS, "batch": BATCH, "batches": BATCHES}, []
    for names, measure in (
        (("composed Processes: time steps", "Lava's library"), composed_and_library),
        (("fused Process: presentations", "host engine, one thread"), fused_and_host),
    ):
        target = f"benchmarks.lava_speed:{measure.__name__}"
        rates = run_isolated(target, {}, options, timeout=TIMEOUT)["rates"]
        ratio = np.median(rates[0]) / np.median(rates[1])
        for name, speeds, last in zip(names, rates, (f"{ratio:.2f}", ""), strict=True):
            rows.append([name, f"{np.median(speeds):,.0f}", f"{speeds.min():,.0f} .. {speeds.max():,.0f}", last])
    yield BenchmarkTable(["", "per second, median", "least .. most", "ratio of medians"], rows)
