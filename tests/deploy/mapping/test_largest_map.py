"""The largest map: against trying sizes, what it assumes against what was measured, and what the real board holds."""

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
from lava_vpr.deploy.boards.memory import PackedRows
from lava_vpr.deploy.mapping.largest_map import MEAN_MAGNITUDE, Capacity, largest, sizing_of, table
from lava_vpr.deploy.mapping.partition import fewest_cores
from lava_vpr.deploy.mapping.sizing import check
from lava_vpr.encoding import Keep, encode_traverse
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
