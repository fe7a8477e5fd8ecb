"""What bounds a network on Loihi 2, of which little is public: counted by hand, refused beyond, promised never."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2, Board
from lava_vpr.deploy.boards.memory import ByteBudget
from lava_vpr.deploy.mapping.largest_map import largest
from lava_vpr.deploy.mapping.partition import partition
from lava_vpr.deploy.mapping.sizing import Sizing, exceeded, least_cores
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError

INPUTS, NEURONS, BITS = 40, 60, 3
WEIGHTS = INPUTS // 2 * NEURONS  # every other weight is 0
STORED = WEIGHTS * BITS + NEURONS * 4  # bits of the weights, and of the root's synapses


def network(steps: int = 29) -> FixedNetwork:
    weights = np.zeros((INPUTS, NEURONS), np.int16)
    weights[::2] = 5
    numbers = {"threshold": 20, "inhibition": 9, "inhibition_exponent": 0, "decay": 137, "regular": True}
    return FixedNetwork(
        weights, np.zeros(NEURONS, np.int32), bits=BITS, signed=False, bias_input=False, steps=steps, **numbers
    )


def smaller(*, core_bytes: int = 196_608, synapses: int = 120_000_000, **changes: Any) -> Board:
    return replace(LOIHI_2, memory=ByteBudget(core_bytes, synapses), **changes)


def on(**changes: Any) -> Sizing:
    return Sizing(network(), smaller(**changes), np.full(INPUTS, 0.01))


def test_what_is_public_of_loihi_2() -> None:
    assert (LOIHI_2.cores, LOIHI_2.compartments) == (128, 8192)
    assert LOIHI_2.memory == ByteBudget(core_bytes=196_608, chip_synapses=120_000_000)
    assert LOIHI_2.known.startswith("Public: 128 cores, 8,192 neurons and 196,608 bytes a core, 120,000,000 synapses")
    assert KAPOHO_BAY.known == ""


def test_bounds_are_counted_as_by_hand() -> None:
    sizing = on()
    assert int(sizing.taken(np.array([NEURONS]), sizing.counts(0, NEURONS)[:, None])[1][0]) == STORED
    assert (sizing.board.memory.capacity, least_cores(sizing), exceeded(sizing)) == (8 * 196_608, 1, "")
    assert least_cores(on(core_bytes=STORED // 8 - 1)) == 2


@pytest.mark.parametrize(
    ("within", "beyond", "said"),
    [
        ({"synapses": 1320}, {"synapses": 1319}, "60 neurons have 1,320 synapses, but Loihi 2 has at most 1,319"),
        (
            {"cores": 5, "core_bytes": 96},
            {"cores": 5, "core_bytes": 95},
            "the weights of 60 neurons take 480 bytes, but the 5 cores of Loihi 2 have 475 for all that they hold",
        ),
        (
            {"core_bytes": 8},
            {"core_bytes": 7},
            "the weights of a neuron take 8 bytes, but a core of Loihi 2 has 7 for all that it holds",
        ),
        (
            {"cores": 2, "compartments": 31},
            {"cores": 2, "compartments": 30},
            "60 neurons need 3 cores, but Loihi 2 has 2",
        ),
    ],
)
def test_what_is_beyond_a_public_number_is_refused(within: dict[str, int], beyond: dict[str, int], said: str) -> None:
    assert exceeded(on(**within)) == ""
    assert exceeded(on(**beyond)) == said
    with pytest.raises(NetworkLimitError, match=said):
        partition(network(), smaller(**beyond), np.full(INPUTS, 0.01))


def test_no_core_gets_more_weights_than_it_has_bytes() -> None:
    plan = partition(network(), smaller(core_bytes=100), np.full(INPUTS, 0.01))
    of_neuron = (network().weights != 0).sum(axis=0) * BITS + 4
    for core in plan.cores:
        part = core.part("exc")
        assert of_neuron[part.first : part.first + part.size].sum() <= 800
        assert core.needs.synapse_words is None
    assert len(plan.cores) >= 5


def test_a_presentation_that_cannot_be_reset_is_refused_on_loihi_2_alone() -> None:
    long = network(steps=350)
    assert long.interval == 353
    partition(long, KAPOHO_BAY, np.full(INPUTS, 0.01))
    with pytest.raises(
        NetworkLimitError, match=r"takes 353 steps, but Loihi 2 resets .*; train with network.steps such "
    ):
        partition(long, LOIHI_2, np.full(INPUTS, 0.01))


def larger(board: Board, weights: str) -> tuple[int, str]:
    found = largest(update(preset("loihi"), {"network": {"input_mode": "bias"}}), board, "unknown", weights)  # type: ignore[arg-type]
    return found.places, found.limit


@pytest.mark.slow
def test_the_largest_map_that_public_numbers_allow() -> None:
    """Of every weight stored: 4 bits of 2,048 inputs and those of the root, in the bytes of 128 cores."""
    places, limit = larger(LOIHI_2, "every")
    bits = 128 * 196_608 * 8
    assert bits // (2048 * 4 + 8) <= places <= bits // (2048 * 4 + 1)
    assert "cores of Loihi 2 have 25,165,824 for all that they hold" in limit
    places, limit = larger(smaller(synapses=10_000_000), "every")
    assert places == (10_000_000 - 2) // 2050 or places == 10_000_000 // 2050
    assert "but Loihi 2 has at most 10,000,000" in limit
