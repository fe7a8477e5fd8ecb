"""Models in fewer bits and synapses: nothing is lost that was not asked for, and boards get what they can run."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays
from support.common.small_models import encoded, small_config, small_model

from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2
from lava_vpr.deploy.bundle import compression
from lava_vpr.encoding import EncodedTraverse, Keep, encode_traverse
from lava_vpr.engine.conductance.model import initial_state
from lava_vpr.engine.inference import quantise
from lava_vpr.errors import ConfigError, NetworkLimitError
from lava_vpr.experiments import calibration
from lava_vpr.loihi import LOIHI_1_INPUT_LIMIT
from lava_vpr.model import Model
from lava_vpr.training.loop import train
from lava_vpr.training.measuring import expected_rates
from lava_vpr.traverse import open_traverse
from lava_vpr.truth.alignment import aligned_truth

INJECTED = compression.Changes(input_mode="injected")


def assert_equal(first: Any, second: Any, name: str = "model") -> None:
    """Every field equal, arrays in type and bit for bit."""
    if isinstance(first, np.ndarray):
        assert first.dtype == second.dtype, name
        assert np.array_equal(first, second), name
    elif hasattr(first, "__dataclass_fields__"):
        assert type(first) is type(second)
        for field in fields(first):
            assert_equal(getattr(first, field.name), getattr(second, field.name), f"{name}.{field.name}")
    else:
        assert first == second, name


def changed(**network: object) -> Any:
    return small_config(network=network, learning={"steps": 160, "epochs": 8})


@lru_cache(maxsize=8)
def trained(bits: int = 3, stretch: int = 4, traverses: int = 1, places: int = 8, **more: object) -> Model:
    shown = [encoded(places, noise=0.4 * k, seed=0) for k in range(traverses)]
    return train(shown, update(changed(weight_bits=bits, **more), {"stretch": stretch}))


def queries(places: int = 8, noise: float = 0.5) -> tuple[EncodedTraverse, np.ndarray]:
    seen = encoded(places, noise=noise)
    return seen, np.eye(places, dtype=bool)


# --- quantised again -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "model",
    [
        lambda: trained(),
        lambda: trained(stretch=0),
        lambda: trained(traverses=2),
        lambda: trained(bits=6),
        lambda: trained(input_mode="bias"),
        lambda: train([encoded(4)], update(changed(), {"learning": {"arithmetic": "integer"}})),
        lambda: train(
            [encoded(8, 3072)], update(preset("fast"), {"stretch": 4, "learning": {"steps": 80, "epochs": 5}})
        ),
    ],
    ids=["joined", "one stretch", "two traverses", "6 bits", "bias", "integer learning", "preset fast"],
)
def test_with_nothing_changed_the_model_is_the_same_bit_for_bit(model: Any) -> None:
    given_model = model()
    assert_equal(compression.requantised(given_model), given_model)
    assert_equal(compression.requantised(given_model, compression.Changes(prune=0.0), threads=2), given_model)


@pytest.mark.parametrize("change", [{"weight_bits": 2}, {"weight_bits": 5}, {"prune": 0.4}, {"input_mode": "bias"}])
def test_it_is_the_model_that_training_with_those_settings_gives(change: dict[str, Any]) -> None:
    """Learning does not know bits or the input mode, so both ways must meet."""
    made = compression.requantised(trained(traverses=2), compression.Changes(**change))
    short = {"bits": change["weight_bits"]} if "weight_bits" in change else change
    assert_equal(made, trained(traverses=2, **short))
    # Where regular trains are made makes no difference to them.
    same = "input_mode" in change
    assert np.array_equal(made.responses, trained(traverses=2).responses) == same


def test_pruning_twice_is_pruning_once() -> None:
    once = compression.requantised(small_model(), compression.Changes(prune=0.9))
    assert_equal(compression.requantised(once), once)
    assert_equal(compression.requantised(once, compression.Changes(prune=0.9)), once)
    kept = np.count_nonzero(once.network.weights, axis=0)
    assert kept.max() <= 1568 - round(0.9 * 1568)
    assert np.count_nonzero(once.network.weights) < 0.12 * once.network.weights.size
    assert once.training["spikes_per_image"] == once.responses.sum() / once.places


@settings(deadline=None, max_examples=40, derandomize=True)
@given(
    arrays(np.float32, st.tuples(st.integers(1, 40), st.integers(1, 3)), elements=st.integers(-4, 4).map(float)),
    st.floats(0, 1, exclude_max=True),
)
def test_the_smallest_weights_of_each_neuron_go(learned: np.ndarray, share: float) -> None:
    result = quantise.pruned(learned, share)
    for before, after in zip(learned.T, result.T, strict=True):
        literal = before.copy()
        for _ in range(round(share * len(before))):
            # Of what is left, the smallest; of equal ones the first.
            left = [i for i in range(len(before)) if not np.isnan(literal[i])]
            literal[min(left, key=lambda i: (abs(before[i]), i))] = np.nan
        assert np.array_equal(after, np.nan_to_num(literal))


def test_what_cannot_be_quantised_anew_is_refused() -> None:
    bare = replace(trained(bits=1), learned=np.zeros((0, 0), np.float32))
    with pytest.raises(ConfigError, match=r"to quantise again .* use the model file that was deployed"):
        compression.requantised(bare)
    assert compression.for_board(bare, KAPOHO_BAY).model is bare  # nothing has to be done
    float_network = initial_state(preset("paper"), 784)
    paper = replace(bare, config=preset("paper"), network=float_network)
    for function in (compression.requantised, lambda model: compression.for_board(model, KAPOHO_BAY)):
        with pytest.raises(
            ConfigError,
            match=r"^a board needs an integer network, .* train with --preset loihi, or run this one with --backend",
        ):
            function(paper)
    for share in (1.0, -0.1, float("nan")):
        with pytest.raises(ConfigError, match=r"network.prune is .* must be (a number )?in \[0, 1\)"):
            compression.requantised(small_model(), compression.Changes(prune=share))
    with pytest.raises(ConfigError, match="weight_bits is 9"):
        compression.requantised(small_model(), compression.Changes(weight_bits=9))


def test_expected_rates_are_the_references_mean() -> None:
    rates = expected_rates(trained(traverses=2))
    assert rates.shape == (1568,)
    assert rates.sum() == pytest.approx(trained().config.encoder.query_spikes, rel=1e-3)
    activity = trained(traverses=2).activity.astype(np.float64)
    activity[activity < np.sort(activity, axis=1)[:, [-520]]] = 0  # the preset's query_inputs
    expected = (activity / activity.sum(axis=1, keepdims=True)).mean(axis=0) * 20
    assert np.allclose(rates, expected, atol=2**-16)


# --- for a board -----------------------------------------------------------------------------------------------------


def test_what_a_board_can_run_is_left_alone() -> None:
    model = trained(bits=1)
    for board in (KAPOHO_BAY, LOIHI_2):
        result = compression.for_board(model, board, INJECTED)
        assert result.model is model
        assert (result.notes, result.as_json()) == ((), None)
    for bits, board in ((5, KAPOHO_BAY), (7, LOIHI_2)):
        assert compression.for_board(trained(bits=bits), board, INJECTED).model is trained(bits=bits)


def test_where_inputs_come_from_is_the_models_but_on_loihi_2() -> None:
    model = trained(bits=1)
    assert compression.for_board(model, KAPOHO_BAY).model is model
    result = compression.for_board(model, LOIHI_2)
    network = result.model.network
    assert (network.bias_input, network.interval) == (True, model.config.network.steps)
    (note,) = result.notes
    assert note.startswith("inputs integrate a bias, as Loihi 2 is given them unless --input-mode injected asks")
    asked = compression.for_board(model, LOIHI_2, compression.Changes(input_mode="bias"))
    assert asked.notes == ()
    assert np.array_equal(asked.model.network.weights, network.weights)
    poisson = replace(model, config=update(model.config, {"network": {"trains": "poisson"}}))
    assert compression.for_inputs(poisson, LOIHI_2, compression.UNCHANGED) == compression.UNCHANGED
    bundled = replace(model, learned=np.zeros((0, 0), np.float32))
    assert compression.for_inputs(bundled, LOIHI_2, compression.UNCHANGED) == compression.UNCHANGED


@pytest.mark.parametrize(
    ("bits", "places", "signed"), [(6, 48, True), (7, 8, True), (7, 24, True), (8, 8, False), (8, 24, False)]
)
def test_kapoho_bay_gets_the_most_bits_that_its_accumulator_takes(bits: int, places: int, signed: bool) -> None:
    model = trained(bits=bits, places=places, signed=signed)
    result = compression.for_board(model, KAPOHO_BAY)
    chosen = result.model.network
    assert chosen.signed == signed
    assert chosen.bits == result.model.weight_bits == result.model.config.network.weight_bits
    chosen.check(LOIHI_1_INPUT_LIMIT)
    for more in range(chosen.bits + 1, bits + 1):
        finer = compression.requantised(model, compression.Changes(weight_bits=more)).network
        with pytest.raises(NetworkLimitError):
            finer.check(LOIHI_1_INPUT_LIMIT)
    if chosen.bits == bits:
        assert result.model is model
    else:
        (note,) = result.notes
        assert note.startswith(f"{chosen.bits} bits a weight instead of {bits}, the most that Kapoho Bay")
        assert compression.for_board(model, KAPOHO_BAY, compression.Changes(weight_bits=chosen.bits)).notes == ()
    # With fewer bits it still answers as the model does.
    assert calibration.figures(result.model, queries(places)).recall_at_1 >= 0.9


def test_bits_that_cannot_be_had_are_refused_with_the_most_that_can() -> None:
    model, unsigned = trained(), trained(signed=False)
    with pytest.raises(NetworkLimitError) as eight:
        compression.for_board(unsigned, KAPOHO_BAY, compression.Changes(weight_bits=8))
    most = int(str(eight.value).rpartition(" ")[2])
    assert str(eight.value) == (
        "Kapoho Bay (two Loihi 1 chips) cannot take 8 bits a weight of this model: it stores weights of at most 8 "
        f"bits; use at most --weight-bits {most}"
    )
    wide = replace(KAPOHO_BAY, weight_bits=(*KAPOHO_BAY.weight_bits, 9))
    with pytest.raises(NetworkLimitError) as summed:
        compression.for_board(unsigned, wide, compression.Changes(weight_bits=8))
    finer = compression.requantised(unsigned, compression.Changes(weight_bits=8)).network
    assert str(summed.value) == (
        "Kapoho Bay (two Loihi 1 chips) cannot take 8 bits a weight of this model: the weights above 0 of one neuron "
        f"sum to {finer.extremes[0]:,}, but its accumulator of one step holds less than 32,768; use at most "
        f"--weight-bits {most}"
    )
    assert compression.for_board(unsigned, KAPOHO_BAY, compression.Changes(weight_bits=most)).model.weight_bits == most
    assert compression.for_board(unsigned, LOIHI_2, compression.Changes(weight_bits=8)).model.weight_bits == 8
    with pytest.raises(ConfigError, match=r"weight_bits is 8, but must be in \[1, 7\]"):
        compression.for_board(model, KAPOHO_BAY, compression.Changes(weight_bits=8))
    assert compression.for_board(model, LOIHI_2, compression.Changes(weight_bits=7)).model.weight_bits == 7
    narrow = replace(LOIHI_2, weight_bits=(1, 2, 3))
    with pytest.raises(NetworkLimitError, match=r"it stores weights of at most 3 bits; use at most --weight-bits 2$"):
        compression.for_board(model, narrow, compression.Changes(weight_bits=3))
    strong = replace(model, config=update(model.config, {"network": {"inhibition": 10000.0}}))
    with pytest.raises(
        NetworkLimitError,
        match=r"not even weights of 1 bit fit: inhibition_exponent 10 does not fit.*network\.inhibition$",
    ):
        compression.for_board(strong, KAPOHO_BAY, compression.Changes(weight_bits=2))


def test_pruned_and_with_another_way_of_input() -> None:
    result = compression.for_board(trained(), KAPOHO_BAY, compression.Changes(prune=0.8, input_mode="bias"))
    assert result.model.network.bias_input
    assert result.model.config.network.input_mode == "bias"
    values = result.as_json()
    assert values["weight_bits"] == {"before": 3, "after": 3}
    assert values["prune"] == 0.8
    assert values["zero_weights"]["after"] > 0.79 > values["zero_weights"]["before"]
    assert json.loads(json.dumps(values)) == values


# --- calibration -----------------------------------------------------------------------------------------------------


def every_point(model: Model, board: Any, images: Any) -> list[tuple[float, int, Any, float]]:
    """All that a search could find: operations, memory, point, R@1."""
    found = []
    for point in calibration.candidates(model, board):
        made = compression.for_board(
            model, board, compression.Changes(weight_bits=point.weight_bits, prune=point.prune)
        )
        after = calibration.figures(made.model, images)
        found.append((after.operations, point.memory_bits, point, after.recall_at_1))
    return found


@pytest.mark.quick(2)
@pytest.mark.parametrize("max_loss", [0.0, 0.13, 0.4, 1.0])
def test_the_search_finds_the_cheapest_of_all_that_are_good_enough(max_loss: float) -> None:
    model, images = trained(), queries(noise=1.2)
    result = calibration.search(model, KAPOHO_BAY, images, max_loss)
    least = result.before.recall_at_1 - max_loss
    good = [one for one in every_point(model, KAPOHO_BAY, images) if one[3] >= least - 1e-9]
    best = min(good, key=lambda one: one[:2])[2]
    assert (result.model.weight_bits, result.prune) == (best.weight_bits, best.prune)
    assert result.after == calibration.figures(result.model, images)
    assert result.before == calibration.figures(model, images)
    values = result.as_json()
    assert values["search"]["max_loss"] == max_loss
    assert len(values["search"]["tried"]) == len(result.tried) >= 1
    costs = [point.input_operations for point, _ in result.tried]
    assert costs == sorted(costs)


def test_the_search_goes_by_what_was_measured_and_stops_where_nothing_cheaper_can_follow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    points = calibration.candidates(trained(), LOIHI_2)
    last = points[2].input_operations
    # In order: the model as it is, then points whose relays make them dearer or cheaper than their inputs say.
    measured = iter([(0.9, 9 * last), (0.9, 8 * last), (0.9, last + 10), (0.9, last + 20), (0.9, 0.0)])

    def figures(*_: object, **__: object) -> compression.CompressionFigures:
        recall, operations = next(measured)
        return compression.CompressionFigures(recall, recall, recall, operations)

    monkeypatch.setattr(calibration, "figures", figures)
    result = calibration.search(trained(), LOIHI_2, queries(), 0.0)
    assert (result.model.weight_bits, result.prune) == (points[1].weight_bits, points[1].prune)
    reached = sum(point.input_operations < last + 10 for point in points)
    assert len(result.tried) == reached == 3


def test_a_search_keeps_what_was_fixed_and_tells_of_each_point() -> None:
    told: list[str] = []
    totals: list[int] = []

    def begin(total: int) -> Any:
        totals.append(total)
        return told.append

    result = calibration.search(
        trained(), LOIHI_2, queries(), 0.5, compression.Changes(weight_bits=2, input_mode="bias"), begin=begin
    )
    assert {point.weight_bits for point, _ in result.tried} == {2}
    assert result.model.network.bias_input
    assert len(told) == len(result.tried) <= totals[0]
    assert told[0].startswith("2 bits, 0.97 pruned: R@1 ")
    fixed = calibration.search(trained(), LOIHI_2, queries(), 1.0, compression.Changes(weight_bits=1, prune=0.5))
    assert [(point.weight_bits, point.prune) for point, _ in fixed.tried] == [(1, 0.5)]


def test_a_search_that_finds_nothing_says_what_would_do() -> None:
    images = queries(noise=3.0)
    with pytest.raises(NetworkLimitError) as failed:
        calibration.search(trained(), KAPOHO_BAY, images, 0.0, compression.Changes(weight_bits=1, prune=0.998))
    text = str(failed.value)
    assert text.startswith("nothing that Kapoho Bay (two Loihi 1 chips) can run keeps R@1 within 0 of ")
    assert "1 bits, 0.998 pruned" in text
    enough = float(text.rpartition(" ")[2])
    calibration.search(trained(), KAPOHO_BAY, images, enough, compression.Changes(weight_bits=1, prune=0.998))
    with pytest.raises(NetworkLimitError, match="cannot take 8 bits"):
        calibration.search(
            trained(signed=False), KAPOHO_BAY, images, 1.0, compression.Changes(weight_bits=8, prune=0.0)
        )


def test_figures_before_and_after() -> None:
    model, images = trained(), queries()
    same = calibration.calibrated(compression.for_board(model, LOIHI_2), images)
    assert same.before == same.after
    assert same.before.recall_at_1 >= 0.9
    values = same.as_json()
    assert "search" not in values
    less = calibration.calibrated(compression.for_board(model, LOIHI_2, compression.Changes(prune=0.9)), images)
    assert less.before == same.before
    assert less.after.operations < 0.5 * same.before.operations


@pytest.mark.slow
@pytest.mark.data
def test_a_hundred_real_places_lose_two_points_for_half_of_the_operations(data_root: Path) -> None:
    summer, winter = (open_traverse(data_root / "data" / "nordland" / name) for name in ("summer", "winter"))
    config = update(preset("loihi"), {"learning": {"steps": 350, "epochs": 8}})
    model = train([encode_traverse(summer.between(0, 100), config.encoder, Keep.ALL)], config, pool=Pool(2))
    seen = winter.between(0, 100)
    images = encode_traverse(seen, config.encoder), aligned_truth(model, seen)
    result = calibration.search(model, KAPOHO_BAY, images, 0.02, threads=2)
    assert result.before.recall_at_1 >= 0.85
    assert result.after.recall_at_1 >= result.before.recall_at_1 - 0.021
    assert result.after.operations <= 0.7 * result.before.operations
