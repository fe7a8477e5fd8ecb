"""The largest map, and what bounds a network on Loihi 2, of which little is public: against trying sizes, counted by
hand, refused beyond, promised never."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2, Board
from lava_vpr.deploy.boards.memory import ByteBudget, PackedRows
from lava_vpr.deploy.mapping.largest_map import MEAN_MAGNITUDE, Capacity, largest, sizing_of, table
from lava_vpr.deploy.mapping.partition import fewest_cores, partition
from lava_vpr.deploy.mapping.sizing import Sizing, check, exceeded, least_cores
from lava_vpr.encoding import Keep, encode_traverse
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.training.loop import train
from lava_vpr.traverse import open_traverse


def config(**changes: object) -> Config:
    """The default preset with 128 inputs."""
    encoder = {"image_size": 32, "cell": 4, "orientations": 2, "query_spikes": 5.0, "query_inputs": 0}
    return update(preset("loihi"), {"encoder": encoder, "stretch": 6, **changes})


def cores_of(chosen: Config, board: Board, places: int) -> int | None:
    """Cores of so many places, by planning them."""
    try:
        sizing = sizing_of(chosen, board, places, "sparse", "every")
        check(sizing)
    except NetworkLimitError:
        return None
    return fewest_cores(sizing)


@pytest.mark.parametrize(
    ("limits", "changes"),
    [
        ({"compartments": 20}, {}),
        ({"axons_in": 160}, {}),
        ({"axons_out": 90}, {}),
        ({"axons_out": 200}, {"network": {"input_mode": "bias"}}),
        ({"memory": PackedRows(500)}, {"network": {"weight_bits": 7}}),
        ({"compartments": 30}, {"network": {"neurons_per_place": 1.5}}),
        ({"compartments": 30}, {"stretch": 0}),
        ({"compartments": 30}, {"network": {"neurons": 9}}),
    ],
)
def test_it_is_the_largest(limits: dict[str, Any], changes: dict[str, object]) -> None:
    board = replace(KAPOHO_BAY, cores=2, chips=1, **limits)
    chosen = config(**changes)
    found = largest(chosen, board, "sparse", "every")
    tried = {places: cores_of(chosen, board, places) for places in range(2, found.places + 12)}
    assert max((places for places, cores in tried.items() if cores), default=0) == found.places
    assert found.places > 2
    assert tried[found.places] == found.cores
    assert found.neurons == sizing_of(chosen, board, found.places, "sparse", "every").network.neurons
    assert found.limit
    assert ";" not in found.limit


@pytest.mark.slow
def test_what_fits_nowhere_says_why() -> None:
    chosen = update(config(), {"encoder": {"query_spikes": 40.0}})
    found = largest(chosen, KAPOHO_BAY)
    assert (found.places, found.neurons, found.cores) == (0, 0, 0)
    assert found.limit.startswith("the host would have to send up to 80.2 input spikes a step, but Kapoho Bay")
    fewer = replace(KAPOHO_BAY, cores=16)
    assert largest(update(chosen, {"network": {"input_mode": "bias"}}), fewer).places > 100


def test_neurons_without_stretches_say_nothing_of_places() -> None:
    board = replace(KAPOHO_BAY, compartments=30, cores=1, chips=1)
    one = largest(config(stretch=0), board)
    assert largest(config(stretch=0, network={"neurons": 7}), board) == one


def test_only_integer_networks_fit() -> None:
    for function in (largest, table):
        with pytest.raises(
            ConfigError,
            match=r"^Kapoho Bay \(two Loihi 1 chips\) needs an integer network, .* train with --preset loihi",
        ):
            function(preset("paper"), KAPOHO_BAY)


def test_rows_for_every_width_that_a_board_stores() -> None:
    rows = table(config(), replace(KAPOHO_BAY, cores=2, compartments=30))
    two = ("typical", "every")
    # With a sign, 6 and 7 bits are stored in 8, the one width that a public program writes to a board.
    proven = [(bits, "sparse", weights) for bits in (6, 7) for weights in two]
    others = [(bits, kind, weights) for bits in range(1, 8) for kind in ("sparse", "dense") for weights in two]
    assert [(row.weight_bits, row.rows, row.weights) for row in rows if row.proven] == proven
    assert [(row.weight_bits, row.rows, row.weights) for row in rows] == [
        *proven,
        *(row for row in others if row not in proven),
    ]
    assert [row.narrow for row in rows if row.rows == "dense"] == [bits < 6 for bits in range(1, 8) for _ in two]
    assert all(isinstance(row, Capacity) and row.limit and row.places > 2 for row in rows)
    other = table(config(), replace(LOIHI_2, cores=2, compartments=30))
    assert [(row.weight_bits, row.rows) for row in other] == [(bits, "unknown") for bits in range(1, 8) for _ in (0, 1)]


def test_what_takes_less_leaves_room_for_more() -> None:
    board = replace(KAPOHO_BAY, cores=4, memory=PackedRows(3000))
    found = {(row.rows, row.weights): row for row in table(config(), board, config().network.weight_bits)}
    for weights in ("typical", "every"):
        assert found["dense", weights].places > found["sparse", weights].places
    for rows in ("sparse", "dense"):
        assert found[rows, "typical"].places > found[rows, "every"].places
    pruned = largest(config(network={"prune": 0.7}), board)
    assert pruned.share == pytest.approx(0.3, abs=0.001)
    assert pruned.places > found["sparse", "typical"].places


@pytest.mark.slow
def test_the_default_preset_on_the_real_board() -> None:
    """Eight thousand places with the index of every weight, even if there were no zero; synapse memory binds."""
    found = {
        (row.rows, row.weights): row for row in table(preset("loihi"), KAPOHO_BAY, preset("loihi").network.weight_bits)
    }
    assert found["sparse", "every"].places > 8_000
    assert found["sparse", "typical"].places > 15_000
    assert found["dense", "every"].places > 20_000
    for row in found.values():
        assert row.cores == 256
        assert "words of synapse memory" in row.limit


@pytest.mark.data
def test_a_trained_network_is_as_was_assumed(data_root: Path) -> None:
    """Shares of weights within 0.03, magnitudes within 10 %, threshold and inhibition within a fifth."""
    images = open_traverse(data_root / "data" / "nordland" / "summer").take(range(100))
    chosen = update(preset("loihi"), {"stretch": 50})
    encoded = encode_traverse(images, chosen.encoder, Keep.ALL)
    real = train([encoded], chosen, pool=Pool(2)).network
    sizing = sizing_of(chosen, KAPOHO_BAY, 100, "sparse", "typical")
    assumed = sizing.network
    mask = sizing.pattern.mask[sizing.pattern.kind]
    assert mask.mean() == pytest.approx((real.weights != 0).mean(), abs=0.03)
    assert np.abs(real.weights).mean() == pytest.approx(MEAN_MAGNITUDE * 7, rel=0.1)
    assert assumed.threshold == pytest.approx(real.threshold, rel=0.2)
    assert assumed.lateral == pytest.approx(real.lateral, rel=0.2)
    real_sizing = replace(sizing, network=real, given=None)
    assert abs((fewest_cores(real_sizing) or 0) - (fewest_cores(sizing) or 0)) <= 1


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
