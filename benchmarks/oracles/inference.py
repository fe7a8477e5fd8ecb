"""The network that answers queries as problems for the oracles: made up, and trained on real images."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.learning.replayed import gained
from benchmarks.oracles.problems import (
    EXCITATORY,
    INHIBITORY,
    INPUTS,
    MIXED,
    DenseConnection,
    OraclePopulation,
    Problem,
    Result,
    engine_result,
)
from benchmarks.places import encoded, learn
from lava_vpr.backends.interface import query_presentations
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.plan import RELAY_THRESHOLD, RELAY_WEIGHT
from lava_vpr.engine.inference.counting import count_spikes, inhibitory_spikes
from lava_vpr.engine.inference.fixed import FAN_IN, FixedNetwork, bias_registers
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.rates import draw_trains
from lava_vpr.errors import InputError
from lava_vpr.loihi import NO_MEMORY_DECAY, WEIGHT_BITS, WEIGHT_LIMIT
from lava_vpr.model import IntegerModel, integer_model


class Made(NamedTuple):
    """An inference network that is made up: its weights, the spikes of its inputs, and how large it is."""

    bits: int
    signed: bool
    regular: bool
    threshold: int
    inputs: int = 60
    neurons: int = 12
    steps: int = 61
    exponent: int = 0


SMALL = (
    Made(1, False, False, 12),
    Made(2, False, True, 30),
    Made(8, False, False, 3000, exponent=4),
    Made(1, True, False, 6),
    Made(3, True, True, 40),
    Made(6, True, False, 300),
    Made(7, True, True, 500, exponent=1),
    Made(3, True, True, 30, inputs=40, neurons=1100, steps=28),
    Made(2, True, False, 20, inputs=24, neurons=4200, steps=27),
)
"""Small inference networks: without and with a sign, of both kinds of trains. The last two have relays of the inputs,
the last has two leaves as well. The exponent is that of inhibition."""


def _passing_on(size: int) -> OraclePopulation:
    """Neurons that fire whenever a spike reaches them, and remember nothing: inhibitory ones and relays."""
    thresholds = np.full(size, RELAY_THRESHOLD, np.int64)
    return OraclePopulation(NO_MEMORY_DECAY, NO_MEMORY_DECAY, thresholds, np.zeros(size, np.int64))


def _inhibitory(network: FixedNetwork) -> tuple[list[OraclePopulation], list[DenseConnection]]:
    """Leaves, if any, and the root, as the populations from 1 on, and the synapses to them and from the root."""
    n, leaves = network.neurons, network.leaves
    populations, connections = [_passing_on(1)], [DenseConnection(0, 1, np.full((n, 1), RELAY_WEIGHT, np.int64))]
    if leaves:
        listens = np.arange(n)[:, None] // FAN_IN == np.arange(leaves)
        populations.insert(0, _passing_on(leaves))
        connections = [
            DenseConnection(0, 1, RELAY_WEIGHT * listens.astype(np.int64)),
            DenseConnection(1, 2, np.full((leaves, 1), RELAY_WEIGHT, np.int64)),
        ]
    taken = np.full((1, n), -network.inhibition, np.int64)
    connections.append(
        DenseConnection(len(populations), 0, taken, WEIGHT_BITS, network.inhibition_exponent, sign=INHIBITORY)
    )
    return populations, connections


def inference_problem(name: str, network: FixedNetwork, rates: NDArray[np.uint16], keys: NDArray[np.uint64]) -> Problem:
    """The inference network, its input injected: exc, inhibitory neurons (leaves, then the root), relays of the inputs.

    Weights of 7 bits, sign included, stand in 8, as on the chip, which has no 7.

    Args:
        name: Of the problem.
        network: The network; its inputs must not integrate a bias.
        rates: Spike probabilities, uint16 (n, inputs).
        keys: Key of each presentation, uint64 (n,).
    Raises:
        InputError: inputs are compartments that integrate a bias.
    """
    if network.bias_input:
        raise InputError(f"{name}: its inputs integrate a bias, and problems inject spikes; set network.input_mode")
    spikes = draw_trains(rates, keys, network.steps, network.interval, regular=network.regular).astype(bool)
    thresholds = np.full(network.neurons, network.threshold, np.int64)
    exc = OraclePopulation(NO_MEMORY_DECAY, network.decay, thresholds, network.bias.astype(np.int64))
    inhibitory, connections = _inhibitory(network)
    populations, source = [exc, *inhibitory], INPUTS
    if network.relayed:
        relays = DenseConnection(INPUTS, len(populations), RELAY_WEIGHT * np.eye(network.inputs, dtype=np.int64))
        source = len(populations)
        populations, connections = [*populations, _passing_on(network.inputs)], [*connections, relays]
    stored, bits, exponent = network.stored
    sign = MIXED if network.signed else EXCITATORY
    weights = DenseConnection(source, 0, stored.T.astype(np.int64), WEIGHT_BITS if bits == 7 else bits, exponent, sign)
    return Problem(name, spikes, tuple(populations), (weights, *connections))


def inference(
    group: str,
    network: FixedNetwork,
    rates: NDArray[np.uint16],
    keys: NDArray[np.uint64],
    bias: NDArray[np.int32] | None = None,
) -> tuple[Problem, Result]:
    """The inference network; both of our engines have to agree on it first.

    Args:
        group, network, rates, keys: As in `inference_problem`.
        bias: Biases of the one presentation, int32 (1, neurons); None: the network's own.
    Raises:
        InputError: they do not.
    """
    network.check()
    problem = inference_problem(group, network if bias is None else replace(network, bias=bias[0]), rates, keys)
    expected = engine_result(problem)
    _, _, film = count_spikes(network, rates, keys, bias=bias, raster=True)
    both = np.concatenate([film, inhibitory_spikes(network, film)], axis=2)
    if not np.array_equal(both, expected.spikes[:, :, : both.shape[2]]):
        raise InputError(f"{group}: the inference engine and the step kernels differ; mend them first")
    return problem, expected


def made_up(made: Made, bias: bool) -> FixedNetwork:
    """The network that ``made`` describes, with biases or without any."""
    rng = np.random.default_rng([made.bits, made.signed, made.neurons])
    shape, top = (made.inputs, made.neurons), (1 << made.bits) - 1
    sizes = rng.integers(0, top + 1, shape) * (rng.random(shape) < 0.6)
    weights = np.where(rng.random(shape) < 0.4, -sizes, sizes) if made.signed else sizes
    network = FixedNetwork(
        weights=weights.astype(np.int16),
        bias=np.zeros(made.neurons, np.int32),
        bits=made.bits,
        signed=made.signed,
        threshold=made.threshold,
        inhibition=min(WEIGHT_LIMIT, made.threshold >> made.exponent),
        inhibition_exponent=made.exponent,
        decay=137,
        steps=made.steps,
        regular=made.regular,
    )
    if not bias:
        return network
    highest = network.highest_bias
    wanted = rng.integers(-4 * highest, highest + 1, made.neurons)
    mantissas, exponent = bias_registers(wanted)
    return replace(network, bias=mantissas << exponent)


def small_inference(bias: bool = True) -> list[tuple[Problem, Result]]:
    """The networks of `SMALL`, with biases or without any."""
    problems = []
    for made in SMALL:
        queries = 3 if made.neurons < 1000 else 1
        rates = np.random.default_rng(made.inputs).integers(0, 12_000, (queries, made.inputs)).astype(np.uint16)
        keys = presentation_keys(0, "query", np.arange(queries))
        problems.append(inference("inference, made up", made_up(made, bias), rates, keys))
    return problems


@cache
def real_models() -> dict[int, IntegerModel]:
    """Models trained on real images, by the bits of their weights.

    Raises:
        InputError: LAVA_VPR_DATA does not name the images.
    """
    configs = {bits: update(preset("loihi"), {"network": {"weight_bits": bits}}) for bits in (3, 7)}
    return {bits: integer_model(learn((0, 100), config), "the comparison") for bits, config in configs.items()}


def real_inference(queries: int, bias: bool) -> list[tuple[Problem, Result]]:
    """Real networks and real queries, one a case; with 3 bits, then fewer with 7. Without ``bias`` theirs are left out.

    As many again are presented under the gains that a drive over all places had learned by then, with biases of each.

    Raises:
        InputError: LAVA_VPR_DATA does not name the images.
    """
    made = []
    for (bits, model), count in zip(real_models().items(), (queries, max(1, queries // 4)), strict=True):
        network = model.network if bias else replace(model.network, bias=np.zeros_like(model.network.bias))
        images = encoded("winter", model.config.encoder).take(slice(0, model.places))
        plain = query_presentations(model, images.take(slice(0, count)))
        for asked, shown in (("real queries", plain), ("real queries under gains", gained(model, images, count))):
            group = f"inference, {asked}, {bits} bits{'' if bias else ', no biases'}"
            for i in range(count):
                own = shown.part(slice(i, i + 1))
                made.append(inference(group, network, own.rates, own.keys, own.bias if bias else None))
    return made
