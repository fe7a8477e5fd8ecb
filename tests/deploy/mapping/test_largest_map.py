"""The largest map: against trying every size, and what it assumes against a network that was trained."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2, Board
from lava_vpr.deploy.mapping import largest_map
from lava_vpr.deploy.mapping.largest_map import Capacity, largest, table, typical
from lava_vpr.deploy.mapping.partition import partition
from lava_vpr.encoding import Keep, encode_traverse
from lava_vpr.engine.inference import quantise
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.training.loop import train
from lava_vpr.traverse import open_traverse


def config(**changes: object) -> Config:
    """The default preset with 32 inputs."""
    encoder = {"image_size": 16, "cell": 4, "orientations": 2, "query_spikes": 5.0}
    return update(preset("loihi"), {"encoder": encoder, "stretch": 6, **changes})


def fits(chosen: Config, board: Board, places: int) -> int | None:
    """Cores of so many places, by planning them."""
    try:
        network = typical(chosen, board, places)
        rates = np.full(network.inputs, chosen.encoder.query_spikes / network.inputs)
        return len(partition(network, board, rates).cores)
    except NetworkLimitError:
        return None


@pytest.mark.parametrize(
    ("limits", "changes"),
    [
        ({"compartments": 20}, {}),
        ({"axons_in": 60}, {}),
        ({"axons_out": 25}, {"network": {"input_mode": "bias"}}),
        ({"synapse_words": 60}, {"network": {"weight_bits": 8, "joined_inhibition": 1.0}}),
        ({"compartments": 30}, {"network": {"neurons_per_place": 1.5}}),
        ({"compartments": 30}, {"stretch": 0}),
        ({"compartments": 30}, {"network": {"neurons": 9}}),
        ({"input_limit": 2000}, {}),
    ],
)
def test_it_is_the_largest(limits: dict[str, int], changes: dict[str, object]) -> None:
    board = replace(KAPOHO_BAY, cores=2, chips=1, **limits)  # type: ignore[arg-type]
    chosen = config(**changes)
    found = largest(chosen, board)
    tried = {places: fits(chosen, board, places) for places in range(2, found.places + 8)}
    assert max((places for places, cores in tried.items() if cores), default=0) == found.places
    assert found.places > 2
    assert tried[found.places] == found.cores
    assert found.neurons == typical(chosen, board, found.places).neurons
    assert found.limit
    assert ";" not in found.limit


def test_several_stretches_can_hold_more_than_one() -> None:
    """Joined stretches inhibit less: 30 places in one stretch would be too many, 31 in two are not."""
    chosen = config(stretch=30)
    board = replace(KAPOHO_BAY, input_limit=1_200)
    assert fits(chosen, board, 30) is None
    assert fits(chosen, board, 31) is not None
    found = largest(chosen, board)
    assert found.places > 31
    assert found.limit.startswith(f"lateral inhibition of {found.places + 1} neurons can reach")
    few = largest(chosen, replace(KAPOHO_BAY, input_limit=700))
    assert 2 < few.places < 30


def test_what_fits_nowhere_says_why() -> None:
    chosen = update(config(), {"encoder": {"query_spikes": 40.0}})
    found = largest(chosen, KAPOHO_BAY)
    assert (found.places, found.neurons, found.cores) == (0, 0, 0)
    assert found.limit.startswith("the host would have to send up to 77.9 input spikes a step, but Kapoho Bay")
    assert largest(update(chosen, {"network": {"input_mode": "bias"}}), KAPOHO_BAY).places > 100


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


@pytest.mark.parametrize("board", [KAPOHO_BAY, LOIHI_2])
def test_a_row_for_every_width(board: Board) -> None:
    rows = table(config(), replace(board, cores=2, compartments=30))
    assert tuple(row.weight_bits for row in rows) == board.weight_bits
    assert all(row.places > 2 for row in rows[:3])
    assert all(isinstance(row, Capacity) and row.limit for row in rows)


def test_the_default_preset_on_the_real_board() -> None:
    """Three bits: inhibition fills the accumulator before cores run out."""
    found = largest(preset("loihi"), KAPOHO_BAY)
    assert 400 < found.places < 800
    assert found.cores < 10
    assert "lateral inhibition" in found.limit


@pytest.mark.data
def test_a_trained_network_is_as_was_assumed(data_root: Path) -> None:
    """Threshold and inhibition within 5 %, sums of weights within 25 %; and it takes no more cores."""
    images = open_traverse(data_root / "data" / "nordland" / "summer")
    chosen = update(preset("loihi"), {"stretch": 50})
    encoded = encode_traverse(images, chosen.encoder, Keep.ALL)
    first = np.arange(100)
    encoded = replace(
        encoded,
        names=encoded.names[:100],
        indices=encoded.indices[first],
        patches=encoded.patches_for("the part")[first],
        activity=encoded.activity[first],
        thumbnails=encoded.thumbnails_for("the part")[first],
    )
    model = train([encoded], chosen, jobs=2)
    weights = quantise.equalise(model.learned)
    assert float(np.percentile(weights, 99.9)) == pytest.approx(largest_map.TOP, rel=0.05)
    for bits in (1, 2, 3, 4):
        own = replace(chosen, network=replace(chosen.network, weight_bits=bits))  # type: ignore[arg-type]
        wanted = typical(own, KAPOHO_BAY, 100)
        real = quantise.quantise(weights, own.network, own.encoder.query_spikes, joined=True, shift=0)  # type: ignore[arg-type]
        assert wanted.threshold == pytest.approx(real.threshold, rel=0.05)
        assert wanted.lateral == pytest.approx(real.lateral, rel=0.05, abs=1)
        if bits > 2:
            sums = real.weights.sum(axis=0, dtype=np.int64).max()
            assert int(wanted.weights[:, 0].sum(dtype=np.int64)) == pytest.approx(sums, rel=0.25)
        rates = np.full(1568, 20 / 1568)
        assert len(partition(real, KAPOHO_BAY, rates).cores) <= len(partition(wanted, KAPOHO_BAY, rates).cores)
