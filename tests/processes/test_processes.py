"""Our Processes against Lava's own models, against literal versions, and whole networks against the host engine."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.lava.model_harness import build, drive
from support.lava.small_networks import (
    FIXED,
    FLOAT,
    SMALL_LIMITS,
    Arrays,
    hold_in_lava,
    limits,
    random_bias,
    random_network,
)

from lava_vpr.backends.interface import events_of
from lava_vpr.engine.general.lif import stored_weights
from lava_vpr.engine.inference.biases import bias_registers
from lava_vpr.engine.inference.counting import count_spikes, inhibitory_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.rates import draw_spikes, draw_trains
from lava_vpr.isolated.runner import run_isolated
from lava_vpr.processes.lif.process import ExcitatoryLIF, PyExcitatoryLIFFixed
from lava_vpr.processes.networks.process import EVENTS, FusedPlaceNetwork, PyFusedPlaceNetworkFixed

pytestmark = pytest.mark.lava

TIMEOUT = 200.0


def some_input(network: FixedNetwork, n: int) -> Arrays:
    """Rates and keys of ``n`` presentations."""
    rates = np.random.default_rng(n).integers(0, 13_000, (n, network.inputs)).astype(np.uint16)
    return {"rates": rates, "keys": presentation_keys(2, "query", np.arange(n))}


NETWORKS: dict[str, dict[str, Any]] = {
    "b1": {"bits": 1},
    "b3_signed": {"bits": 3, "signed": True},
    "b3_regular": {"bits": 3, "regular": True},
    "b7_signed_regular": {"bits": 7, "signed": True, "regular": True},
    "b8": {"bits": 8},
}
EVERY = ("b3_signed", "b3_regular")
"""Networks that are run by every job."""


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("names", "small"),
    [
        pytest.param(["b3_signed", "b8"], {}, id="two"),
        pytest.param(NETWORKS, {}, id="direct"),
        pytest.param(NETWORKS, SMALL_LIMITS, id="leaves and relays"),
    ],
)
def test_networks_in_lava_equal_the_host(names: Collection[str], small: dict[str, int]) -> None:
    # All widths: test_many_random_place_networks_equal_lavas_library.
    with limits(**small):
        networks = {name: random_network(**NETWORKS[name]) for name in names}
        assert {(own.depth, own.input_delay) for own in networks.values()} == {(2, 2) if small else (1, 1)}
        cases = {
            name: (network, some_input(network, 4), FIXED + FLOAT if name in EVERY else FIXED[1:])
            for name, network in networks.items()
        }
        got = hold_in_lava(cases, limits=small)
        for name in networks:
            assert (got[f"{name}_composed_fixed_pt_counts"].sum(axis=1) > 3).all(), name


@pytest.mark.parametrize(
    "case",
    ["injected", *(pytest.param(case, marks=pytest.mark.slow) for case in ("leaves and relays", "input compartments"))],
)
def test_every_job_takes_the_biases_of_each_presentation(case: str) -> None:
    small = SMALL_LIMITS if case == "leaves and relays" else {}
    with limits(**small):
        network = random_network(3, seed=1, signed=True, regular=case != "injected")
        network = replace(network, bias_input=case == "input compartments")
        shown = some_input(network, 4)
        rng = np.random.default_rng(3)
        biases = np.stack([random_bias(rng, network) >> shift << shift for shift in (0, 1, 0, 2)])
        biases[1] = np.minimum(biases[1], 0) << 5  # an exponent of its own
        assert len(set(bias_registers(biases)[1].tolist())) > 1
        got = hold_in_lava({"one": (network, shown | {"biases": biases}, FIXED + FLOAT)}, limits=small)
        plain, _, _ = count_spikes(network, **shown)
        assert got["one_composed_fixed_pt_counts"].sum() > 30
        assert (got["one_composed_fixed_pt_counts"] != plain).any(axis=1).all()


def test_the_backend_counts_the_hosts_events() -> None:
    for small in ({}, SMALL_LIMITS):
        with limits(**small):
            network = random_network(4, signed=True)
            rates, keys = some_input(network, 3).values()
            counts, events, film = count_spikes(network, rates, keys, raster=True)
            inputs = draw_trains(rates, keys, network.steps, network.interval).sum(axis=(0, 1))
            inh = inhibitory_spikes(network, film).sum(axis=(0, 1))
            assert events_of(network, counts, inputs, inh) == events


def test_the_fused_process_without_shared_arrays() -> None:
    network = random_network(4)
    rates, keys = some_input(network, 7).values()
    counts, events, film = count_spikes(network, rates, keys, raster=True)
    process = FusedPlaceNetwork(network=network, rates=rates, keys=keys, batch=3)
    model = build(process, PyFusedPlaceNetworkFixed)
    drive(model, process.batches + 1)
    assert process.batches == 3
    assert np.array_equal(model.counts, counts)
    assert dict(zip(EVENTS, model.events.tolist(), strict=True)) == events
    raster = np.zeros_like(film)
    process = FusedPlaceNetwork(network=network, rates=rates, keys=keys, batch=64, raster=raster)
    drive(build(process, PyFusedPlaceNetworkFixed), 1)
    assert np.array_equal(raster, film)


@pytest.mark.parametrize(("bits", "signed"), [*((b, False) for b in range(1, 9)), *((b, True) for b in range(1, 8))])
def test_stored_weights_give_the_same_sums(bits: int, signed: bool) -> None:
    network = random_network(bits, signed=signed)
    weights, stored_bits, exponent = network.stored
    assert (stored_bits, exponent) == (bits + signed, bits - 8)
    kept = stored_weights(weights, stored_bits, "mixed" if signed else "excitatory")
    assert np.array_equal(kept, weights)
    assert np.array_equal(kept.sum(axis=1) >> -exponent, network.weights.sum(axis=0, dtype=int))


def test_vars_between_runs_and_refusals_before_them() -> None:
    rng = np.random.default_rng(0)
    rates, keys = rng.integers(0, 30_000, (1, 20)).astype(np.uint16), presentation_keys(0, "query", np.arange(1))
    given = {"weights": rng.integers(0, 256, (6, 20)), "vth": rng.integers(500, 4000, 6), "rates": rates, "keys": keys}
    network = random_network(5, signed=True)
    own = some_input(network, 1) | {"weights": network.weights, "bias": network.bias}
    got = run_isolated(
        "support.lava.process_targets:small_runs",
        {f"vars_{name}": value for name, value in given.items()} | {f"whole_{name}": own[name] for name in own},
        {"steps": 60, "network": network.scalars},
        timeout=TIMEOUT,
    )
    check_vars(given, {name.removeprefix("vars_"): value for name, value in got.items()})
    for name in ("weights", "u", "v", "v_inh", "vth", "lateral_weights", "bias_mant", "bias_exp"):
        assert np.array_equal(got[f"place_{name}"], got[f"library_{name}"]), name
    assert np.array_equal(got["place_weights"], network.stored[0])
    assert got["place_lateral_weights"].tolist() == [[-network.inhibition]] * network.neurons
    assert got["place_v"].any()
    assert (got["place_vth"] == network.threshold).all()
    assert str(got["place_refusal"]) == ""
    assert str(got["library_refusal"]).startswith(
        "ExcitatoryLIF: vth cannot be set with Lava's library; run it without"
    )
    for text, part in zip(got["refusals"], ("", "vth is 10.5, but", "excitatory weight is 0.5"), strict=True):
        assert part in text
        assert bool(part) == bool(text)


def check_vars(given: dict[str, NDArray[Any]], got: dict[str, NDArray[Any]]) -> None:
    """What `process_targets.read_and_set` found, against a model run without Lava's runtime."""
    spikes = draw_spikes(given["rates"][0], int(given["keys"][0]), 60)
    sums = np.zeros((60, 6), int)
    sums[1:] = spikes[:-1].astype(int) @ given["weights"].T
    process = ExcitatoryLIF(shape=(6,), dv=137, vth=given["vth"], theta_plus=3, hold_steps=2, floor=-50)
    model = build(process, PyExcitatoryLIFFixed)
    counts = drive(model, sums, "a_in", "s_out").sum(axis=0)
    assert counts.min() > 0
    assert len(set(counts)) > 2
    assert np.array_equal(got["counts"][0], counts)
    for name in ("u", "v", "vth", "held", "du", "dv", "floor", "hold_steps", "theta_plus", "bias_mant", "bias_exp"):
        assert np.array_equal(got[name], getattr(model, name)), name
    assert np.array_equal(got["vth"], given["vth"] + 3 * counts)
    assert np.array_equal(got["emitted"], spikes.sum(axis=0))
    assert np.array_equal(got["weights"], given["weights"][:, ::-1])
    assert not got["counts_after"][1].any()
    assert (got["vth_after"] == 131_071).all()
    for text, name in zip(got["texts"], ("threshold is 131072", "v is 8388608", "weight is 256"), strict=True):
        assert name in text
