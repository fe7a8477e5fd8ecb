"""Random place networks with numbers of the size that trained ones have, and their runs in Lava beside the host's.

Used by deploy, processes and support.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from lava_vpr.backends.interface import Presentations
from lava_vpr.backends.teaching import under_gains
from lava_vpr.config import EncoderConfig
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.gains import FULL, digits_of
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.biases import bias_registers
from lava_vpr.engine.inference.counting import EVENTS, count_spikes, inhibitory_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.rates import draw_trains, query_rates16
from lava_vpr.isolated.runner import run_isolated
from lava_vpr.loihi import BIAS_BITS, BIAS_EXPONENT_LIMIT

Arrays = dict[str, NDArray[Any]]
Runs = list[tuple[str, str]]
"""Jobs of `lava_vpr.processes.jobs.inference`, and the tags of the models that they run."""
FIXED: Runs = [(job, "fixed_pt") for job in ("fused", "composed", "library")]
FLOAT: Runs = [(job, "floating_pt") for job in ("composed", "library")]

SMALL_LIMITS = {"FAN_IN": 4, "DIRECT": 3}
"""`limits` with which five neurons need leaves and relays."""


@contextmanager
def limits(**numbers: int) -> Iterator[None]:
    """`fixed.FAN_IN` and `fixed.DIRECT` as given, for every network that is made and run meanwhile."""
    with ExitStack() as stack:
        for name, number in numbers.items():
            stack.enter_context(mock.patch.object(fixed, name, number))
        yield


def random_bias(rng: np.random.Generator, network: FixedNetwork) -> NDArray[np.int32]:
    """Biases of both signs that ``network`` may have."""
    most = min(network.highest_bias, ((1 << BIAS_BITS) - 1) << BIAS_EXPONENT_LIMIT)
    mantissas, exponent = bias_registers(rng.integers(-most, most + 1, network.neurons))
    return (mantissas << exponent).astype(np.int32)


def random_network(bits: int, seed: int = 0, **changes: Any) -> FixedNetwork:
    """Spikes now and then, with numbers of the size that trained networks have."""
    rng = np.random.default_rng(100 * seed + bits)
    inputs, neurons, signed = int(rng.integers(40, 60)), int(rng.integers(5, 12)), bool(changes.get("signed"))
    weights = rng.integers(0, 1 << bits, (inputs, neurons)) * (rng.random((inputs, neurons)) < 0.8)
    threshold = max(2, int(weights.sum(axis=0).mean() * (0.25 if signed else 0.5)))
    if signed:
        weights = weights * rng.choice([-1, 1], weights.shape, p=[0.3, 0.7])
    inhibition, exponent = int(threshold * rng.uniform(0.3, 1.2)), 0
    while inhibition > 255:
        inhibition, exponent = inhibition // 2, exponent + 1
    decay, steps = int(rng.integers(60, 400)), int(rng.integers(30, 60))
    network = FixedNetwork(
        weights=weights.astype(np.int16),
        bias=np.zeros(neurons, np.int32),
        bits=bits,
        signed=signed,
        threshold=threshold,
        inhibition=inhibition,
        inhibition_exponent=exponent,
        decay=decay,
        steps=steps,
    )
    network = replace(network, **changes)
    return network if "bias" in changes else replace(network, bias=random_bias(rng, network))


def random_drive(network: FixedNetwork, seed: int, n: int) -> Arrays:
    """``n`` presentations under random gains and biases, and what their rates follow from.

    Every second seed has whole activity, as cells of a front end send it, else of all sizes. Gains of the first epoch
    are full, and those of the last mostly 0; an epoch may come again.

    Returns:
        Presentations as backends are given them, ``rates``, ``keys`` and ``biases``, and what `LavaBackend` is given
        besides: ``digits`` (n, digits, inputs), their ``exponents`` (n, inputs), ``gains`` (epochs, inputs), the
        ``epoch`` (n,) of each, ``plain`` rates (n, inputs) and the ``encoder``'s query_spikes and query_inputs.
    """
    rng = np.random.default_rng([seed, 7])
    shape = (n, network.inputs)
    activity = rng.integers(0, 40, shape) if seed % 2 else rng.random(shape) ** 6 * 4 * 2.0 ** rng.integers(-9, 9)
    activity = (activity * (rng.random(shape) < 0.9)).astype(np.float32)
    gains = np.stack([np.full(network.inputs, FULL), *rng.integers(0, FULL + 1, (2, network.inputs))])
    gains[2, rng.random(network.inputs) < 0.6] = 0
    epoch = rng.permutation(np.arange(n) % len(gains)).astype(np.int32)
    encoder = EncoderConfig(query_inputs=int(rng.integers(10, 40)), query_spikes=int(rng.integers(3, 9)))
    views = [EncodedTraverse(tuple(map(str, range(n))), np.arange(n), activity)]
    plain, bias = query_rates16(activity, encoder), np.stack([random_bias(rng, network) for _ in range(n)])
    gains = gains.astype(np.uint8)
    (shown,) = under_gains([Presentations(plain, seed)], views, gains[epoch], bias, encoder)
    whole = digits_of(activity)
    return {
        **{"rates": shown.rates, "keys": shown.keys, "biases": bias, "plain": plain, "gains": gains, "epoch": epoch},
        **{"digits": whole.digits, "exponents": whole.exponents},
        "encoder": np.array([encoder.query_spikes, encoder.query_inputs]),
    }


def hold_in_lava(cases: dict[str, tuple[FixedNetwork, Arrays, Runs]], **options: Any) -> Arrays:
    """Run networks in Lava, each in its runs, and hold every run against the host.

    Args:
        cases: By name a network, its ``rates``, ``keys`` and maybe ``biases``, and its runs; of a `random_drive` rates
            follow from products of activity and gains, which are made in Lava, too, but for the fused job.
        options: Those of `process_targets.networks`.
    Returns:
        What that returns.
    """
    arrays = {
        f"{name}_{key}": value
        for name, (network, shown, _) in cases.items()
        for key, value in ({"weights": network.weights, "bias": network.bias} | shown).items()
    }
    given = {"networks": {name: network.scalars | {"batch": 3} for name, (network, _, _) in cases.items()}}
    given |= {"runs": {name: runs for name, (_, _, runs) in cases.items()}, "limits": {}} | options
    done: list[int] = []
    got = run_isolated("support.lava.process_targets:networks", arrays, given, timeout=240, progress=done.append)
    boards = [options["board"]] if "board" in options else []
    expected = sum(
        len(shown["keys"]) * (len(runs) + ("digits" in shown) * sum(job != "fused" for job, _ in runs))
        for _, shown, runs in cases.values()
    )
    assert sum(done) == expected + sum(len(cases[name][1]["keys"]) for name in boards)
    for name, case in cases.items():
        _hold_runs(*case, part(got, name))
    return got


def part(arrays: Arrays, name: str) -> Arrays:
    """The arrays whose names begin with ``name``."""
    return {key.removeprefix(f"{name}_"): value for key, value in arrays.items() if key.startswith(f"{name}_")}


def _hold_runs(network: FixedNetwork, shown: Arrays, runs: Runs, got: Arrays) -> None:
    """Every run of one network against the host: spikes of exc, inh and inputs, and their numbers."""
    network = replace(network)  # without what was made with other limits
    rates, keys = shown["rates"], shown["keys"]
    counts, events, film = count_spikes(network, rates, keys, bias=shown.get("biases"), raster=True)
    inputs = draw_trains(rates, keys, network.steps, network.interval, regular=network.regular)
    for job, tag in runs:
        one = part(got, f"{job}_{tag}")
        assert one["counts"].dtype == np.int32
        if tag == "fixed_pt":
            assert np.array_equal(one["counts"], counts), job
            assert np.array_equal(one["exc"], film), job
        if job == "fused":
            assert dict(zip(EVENTS, one["events"].tolist(), strict=True)) == events
            assert "inh" not in one
            continue
        if "digits" in shown:
            products = shown["digits"].astype(np.int64) * shown["gains"][shown["epoch"]][:, None]
            assert np.array_equal(one["gained"], products), (job, tag)
            assert np.array_equal(one["rates"], rates), (job, tag)
        trains = {"inputs": inputs, "inh": inhibitory_spikes(network, one["exc"])}
        for key, numbers in (("inputs", "input_spikes"), ("inh", "inh_spikes")):
            assert np.array_equal(one[key], trains[key]), (job, tag, key)
            assert one[numbers].dtype == np.int64
            assert np.array_equal(one[numbers], trains[key].sum(axis=(0, 1)))
    if set(FLOAT) <= set(runs):
        # Without truncation ours is the library's float network; it differs from the integers where a decay was cut.
        ours, theirs = (got[f"{job}_{tag}_exc"] for job, tag in FLOAT)
        assert np.array_equal(ours, theirs)
        assert np.abs(ours.sum(axis=1, dtype=int) - counts).sum() <= 0.1 * counts.sum()
