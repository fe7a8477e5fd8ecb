"""The network files of a Loihi 2 bundle: whole, refused if they contradict, simulated as the engine does."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from support.boards.loihi2_bundles import AGAIN, INTERVAL, network, queries
from support.lava.small_networks import SMALL_LIMITS, limits

from lava_vpr.config import LifNetwork
from lava_vpr.deploy.bundle import loihi2
from lava_vpr.deploy.bundle.folder import array_bytes, json_bytes
from lava_vpr.engine.inference.counting import count_spikes, inhibitory_spikes
from lava_vpr.engine.rates import draw_trains
from lava_vpr.errors import BundleError, NetworkLimitError

QUICK = settings(deadline=None, max_examples=25, derandomize=True)


FORMS = st.tuples(st.integers(1, 8), st.booleans()).filter(lambda form: form[0] + form[1] <= 8)
"""Bits and whether signed."""
TRAINS = st.sampled_from([(False, False), (True, False), (True, True)])
"""Whether regular, and made by input compartments."""
SMALL = st.sampled_from([{}, SMALL_LIMITS])


@QUICK
@given(
    form=FORMS,
    trains=TRAINS,
    small=SMALL,
    decay=st.integers(0, 4095),
    exponent=st.integers(0, 3),
    seed=st.integers(0, 99),
)
def test_files_hold_the_whole_network(
    form: tuple[int, bool],
    trains: tuple[bool, bool],
    small: dict[str, int],
    decay: int,
    exponent: int,
    seed: int,
) -> None:
    names = ("bits", "signed", "regular", "bias_input")
    changes = dict(zip(names, (*form, *trains), strict=True))
    with limits(**small):
        net = network(seed, **changes, decay=decay, inhibition_exponent=exponent)
        files = loihi2.network_files(net)
        assert files == loihi2.network_files(net)
        read = loihi2.network_of(files)
    assert np.array_equal(read.weights, net.weights)
    assert np.array_equal(read.bias, net.bias)
    assert read.scalars == net.scalars


def test_parameters_have_the_names_of_lavas_arguments() -> None:
    files = loihi2.network_files(network(bits=3, signed=True, inhibition_exponent=1, bias_input=True))
    reset = {"reset_interval": 32, "reset_offset": 1}
    told = json.loads(files[loihi2.PARAMETERS])
    assert told.pop("network")["signed"] == 1
    assert told == {
        "steps": 29,
        "silent_steps": 3,
        "level": 8000 << 6,
        "inputs": {"du": 4095, "dv": 0, "vth": 8000},
        "relayed": 0,
        "leaves": 0,
        "fan_in": 4096,
        "excite": {"num_weight_bits": 4, "weight_exp": -5, "sign_mode": "MIXED"},
        "exc": {"du": 4095, "dv": 137, "vth": 20, "bias_exp": 0, **reset},
        "relay": {"weight": 2, "num_weight_bits": 8, "weight_exp": 0, "sign_mode": "EXCITATORY"},
        "inh": {"du": 4095, "dv": 4095, "vth": 1, **reset},
        "inhibit": {"weight": -10, "num_weight_bits": 8, "weight_exp": 1, "sign_mode": "INHIBITORY"},
    }


@QUICK
@given(form=FORMS, trains=TRAINS, small=SMALL, seed=st.integers(0, 99))
def test_simulation_equals_the_engine(
    form: tuple[int, bool], trains: tuple[bool, bool], small: dict[str, int], seed: int
) -> None:
    """Two implementations: every spike, also over more presentations than are simulated in one go."""
    (bits, signed), (regular, bias_input) = form, trains
    with limits(**small):
        net = network(
            seed, bits=bits, signed=signed, regular=regular, bias_input=bias_input, threshold=max(2, 1 << bits)
        )
        rates, keys = queries(n=loihi2.CHUNK + 2, seed=seed)
        exc, inh, inputs = loihi2.simulate(net, rates, keys)
        _, _, film = count_spikes(net, rates, keys, raster=True)
        assert film.any()
        assert np.array_equal(exc, film)
        assert np.array_equal(inh, inhibitory_spikes(net, film))
        assert np.array_equal(inputs, draw_trains(rates, keys, net.steps, INTERVAL, regular=regular))


def altered(change: Callable[[dict[str, Any]], object]) -> dict[str, bytes]:
    """Files of a network, with other parameters."""
    files = loihi2.network_files(network())
    parameters = json.loads(files[loihi2.PARAMETERS])
    change(parameters)
    return files | {loihi2.PARAMETERS: json_bytes(parameters)}


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({}, "network/weights.npy: the bundle lacks this file"),
        (
            altered(lambda p: p["exc"].update(vth=21)),
            "network/parameters.json: contradicts the rest of the bundle",
        ),
        (altered(lambda p: p.update(more=1)), "network/parameters.json: contradicts the rest of the bundle"),
        (altered(lambda p: p.pop("relay")), "network/parameters.json: contradicts the rest of the bundle"),
        (altered(lambda p: p.pop("inputs")), "network/parameters.json: contradicts the rest of the bundle"),
        (altered(lambda p: p["network"].update(neurons=9)), "network/parameters.json: contradicts the rest"),
        (altered(lambda p: p.pop("network")), "network/parameters.json: describes no network that Loihi 2 can run;"),
        (altered(lambda p: p["network"].update(steps=1.5)), "network/parameters.json: describes no network"),
        (
            altered(lambda p: p["network"].update(threshold=0)),
            "network/parameters.json: describes no network that Loihi 2 can run (threshold 0 does not fit 1..131071",
        ),
        (
            loihi2.network_files(network()) | {loihi2.WEIGHTS: array_bytes(np.full((10, 24), 33, np.int16))},
            "network/weights.npy: contradicts the rest of the bundle",
        ),
        (
            loihi2.network_files(network()) | {loihi2.WEIGHTS: array_bytes(np.zeros(3, np.int8))},
            "network/weights.npy: is int8 (3,), but must be int16 (neurons, inputs)",
        ),
        (
            loihi2.network_files(network()) | {loihi2.BIAS: array_bytes(np.zeros(9, np.int32))},
            "network/bias.npy: is int32 (9,), but must be int32 (10,)",
        ),
        (
            loihi2.network_files(network()) | {loihi2.BIAS: array_bytes(np.full(10, 4096, np.int32))},
            "network/parameters.json: describes no network that Loihi 2 can run (a bias of 4096 makes its neuron",
        ),
        (
            loihi2.network_files(network()) | {loihi2.BIAS: array_bytes(np.full(10, 4000, np.int32))},
            "network/parameters.json: describes no network that Loihi 2 can run (a bias of 4000 makes its neuron",
        ),
        (
            altered(lambda p: p["exc"].update(bias_exp=8)),
            "network/parameters.json: describes no network that Loihi 2 can run (a bias of 9984 makes its",
        ),
        (loihi2.network_files(network()) | {loihi2.WEIGHTS: b"no"}, "network/weights.npy: is no array of numbers ("),
        (loihi2.network_files(network()) | {loihi2.PARAMETERS: b"no"}, "network/parameters.json: is no JSON ("),
    ],
)
def test_contradictory_files_are_refused(files: dict[str, bytes], said: str) -> None:
    with pytest.raises(BundleError) as caught:
        loihi2.network_of(files)
    assert str(caught.value).startswith(said)
    assert str(caught.value).endswith(AGAIN)


def test_what_loihi_cannot_hold_is_refused() -> None:
    with pytest.raises(NetworkLimitError, match=r"^decay 4096 does not fit Loihi 2's 0\.\.4095; train with ") as caught:
        loihi2.network_files(network(decay=4096))
    assert set(re.findall(r"network\.(\w+)", str(caught.value))) <= {field.name for field in fields(LifNetwork)}
    with pytest.raises(NetworkLimitError, match=r"^rates are \(5, 3\), but the bundle's network has 24 inputs"):
        loihi2.simulate(network(), queries(3)[0], queries(3)[1])
