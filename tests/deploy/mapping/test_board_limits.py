"""What does not fit a board is refused with resource, need, limit and a remedy that helps."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.boards.plans import LIMITS, check_images, check_plan, even, network, tiny

from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2, Board
from lava_vpr.deploy.boards.memory import PackedRows
from lava_vpr.deploy.mapping.partition import partition
from lava_vpr.deploy.mapping.sizing import host_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.rates import draw_trains
from lava_vpr.errors import NetworkLimitError


def refused(made: FixedNetwork, board: Board, spikes: float = 5.0) -> str:
    with pytest.raises(NetworkLimitError) as caught:
        partition(made, board, even(made, spikes))
    text = str(caught.value)
    assert "\n" not in text
    assert text.count("; ") == 1
    return text


def test_compartments() -> None:
    made = network(16, 5)
    text = refused(made, tiny(compartments=4))
    assert "neurons need 17 compartments, but the 4 cores of Kapoho Bay" in text
    assert text.endswith("have 16; use at most 15 neurons, so fewer places or network.neurons_per_place")
    check_plan(partition(network(15, 5), tiny(compartments=4), np.ones(5)))


def test_compartments_of_inputs() -> None:
    made = network(5, 23, bias_input=True)
    text = refused(made, tiny(compartments=7))
    assert "neurons and inputs need 29 compartments, but the 4 cores" in text
    assert "have 28; use --input-mode injected" in text
    check_plan(partition(replace(made, bias_input=False), tiny(compartments=7), np.ones(23)))


def test_input_axons() -> None:
    made = network(12, 30, share=1.0)
    text = refused(made, tiny(axons_in=30))
    assert "a core with 3 of 12 neurons needs 31 input axons, but a core of Kapoho Bay" in text
    assert "has 30; use --weight-bits 1 or --prune 0.5" in text
    made = replace(made, bits=1, weights=np.minimum(made.weights, 1))
    assert refused(made, tiny(axons_in=30)).endswith("has 30; use --prune 0.5")
    made = network(12, 3, bits=1, share=1.0)
    # Without its last weight a neuron would say nothing: that is no remedy.
    text = refused(made, tiny(axons_in=9))
    assert "an inhibitory neuron that listens to 12 others needs 12 input axons, but a core of Kapoho Bay" in text
    assert text.endswith("has 9; use at most 9 neurons, so fewer places or network.neurons_per_place")
    check_plan(partition(network(9, 3, bits=1, share=1.0), tiny(axons_in=9), np.ones(3)))


def test_output_axons() -> None:
    made = network(12, 5)
    text = refused(made, tiny(axons_out=5))
    assert "a core with 3 of 12 neurons needs 6 output axons, but a core of Kapoho Bay" in text
    assert "has 5; use at most" in text
    made = network(14, 40, bias_input=True, share=1.0)
    text = refused(made, tiny(axons_out=17))
    assert re.match(r"14 neurons need .* cores of 17 output axons, but Kapoho Bay \(two Loihi 1 chips\) has 4; ", text)
    made = network(18, 5)
    text = refused(made, tiny(axons_out=9))
    assert "a core with 5 of 18 neurons needs 10 output axons" in text
    most = int(re.search(r"use at most (\d+) neurons", text)[1])  # type: ignore[index]
    less = replace(made, weights=made.weights[:, :most], bias=made.bias[:most])
    check_plan(partition(less, tiny(axons_out=9), np.ones(5)))
    refused(replace(made, weights=made.weights[:, : most + 1], bias=made.bias[: most + 1]), tiny(axons_out=9))


def test_synapse_memory_and_every_remedy_that_is_named_helps() -> None:
    made, board = network(64, 40, share=0.8, bits=7, inhibition=3), tiny(synapse_words=132)
    text = refused(made, board)
    assert "a core with 16 of 64 neurons needs 134 words of synapse memory, but a core of Kapoho" in text
    assert "has 125; use" in text
    bits = int(re.search(r"--weight-bits (\d)", text)[1])  # type: ignore[index]
    share = float(re.search(r"--prune ([\d.]+)", text)[1])  # type: ignore[index]
    less = 7 - bits
    fewer = replace(made, bits=bits, weights=made.weights >> less, inhibition=made.inhibition >> less)
    check_plan(partition(fewer, board, even(made, 5.0)))
    weights = made.weights.copy()
    np.put_along_axis(weights, np.argsort(weights, axis=0, kind="stable")[: round(share * 40)], 0, axis=0)
    check_plan(partition(replace(made, weights=weights), board, even(made, 5.0)))
    assert text.endswith(" or --dense-rows (unproven)")
    check_plan(partition(made, board, even(made, 5.0), dense_rows=True))
    assert "--dense-rows" not in refused(made, tiny(synapse_words=100))


def test_signed_weights_lose_bits_towards_zero() -> None:
    made, board = network(60, 40, share=0.9, bits=7, signed=True), tiny(synapse_words=85)
    text = refused(made, board)
    bits = int(re.search(r"--weight-bits (\d)", text)[1])  # type: ignore[index]
    weights = np.sign(made.weights) * (np.abs(made.weights) >> 7 - bits)
    fewer = replace(made, bits=bits, weights=weights.astype(np.int16), inhibition=made.inhibition >> 7 - bits)
    check_plan(partition(fewer, board, even(made, 5.0)))


@pytest.mark.parametrize(
    ("limits", "bias_input", "text"),
    [
        ({"profiles": 1}, False, "needs 2 profiles, but Kapoho Bay (two Loihi 1 chips) has 1; use another --target"),
        ({"profiles": 2}, True, "needs 3 profiles, but Kapoho Bay (two Loihi 1 chips) has 2; use --input-mode inj"),
        ({"thresholds": 1}, False, "needs 2 thresholds, but Kapoho Bay (two Loihi 1 chips) has 1; use another --tar"),
        ({"thresholds": 2}, True, "needs 3 thresholds, but Kapoho Bay (two Loihi 1 chips) has 2; use --input-mode inj"),
        ({"formats": 2}, False, "needs 3 formats, but Kapoho Bay (two Loihi 1 chips) has 2; use another --target"),
        ({"weight_bits": (1, 2, 6)}, False, "at most 6 bits, but these need 8 with their sign; use --weight-bits 5"),
        ({"memory": PackedRows(16_384, index_bits=())}, False, "synapses to inhibitory neurons need index bits"),
        ({"input_limit": 250}, False, "the weights above 0 of one neuron sum to 283, but Kapoho Bay"),
    ],
)
def test_limits_that_no_choice_of_cores_helps(limits: dict[str, Any], bias_input: bool, text: str) -> None:
    made = network(12, 5, bits=7, bias_input=bias_input)
    assert text in refused(made, replace(tiny(), **limits))


def test_a_sign_takes_a_bit() -> None:
    made = network(12, 5, bits=6, signed=True)
    assert partition(made, KAPOHO_BAY, even(made, 5.0)).weight_bits == 8
    text = refused(made, tiny(weight_bits=(1, 2, 6)))
    assert "at most 6 bits, but these need 7 with their sign; use --weight-bits 5" in text
    unsigned = replace(made, weights=np.abs(made.weights), signed=False)
    assert partition(unsigned, KAPOHO_BAY, even(made, 5.0)).weight_bits == 8
    assert partition(unsigned, LOIHI_2, even(made, 5.0)).weight_bits == 6  # a Lava Process may have one sign for all


def test_relays_take_a_format_and_a_population() -> None:
    made = network(1100, 5)
    assert "needs 3 profiles" in refused(made, tiny(profiles=2))
    assert "needs 4 formats" in refused(made, tiny(formats=3))


def test_host_spikes_and_both_remedies() -> None:
    """An input that spikes in a step with probability p has variance p (1 - p) there, whatever its train."""
    made = network(12, 50)
    for own, p in ((made, 0.4), (replace(made, regular=True), 0.5)):
        want = 50 * p + 6 * (50 * p * (1 - p)) ** 0.5
        assert partition(own, KAPOHO_BAY, even(made, 20.0)).host_spikes == pytest.approx(want)
    text = refused(made, KAPOHO_BAY, 40.0)
    assert "the host would have to send up to 57.0 input spikes a step, but Kapoho Bay" in text
    most = float(re.search(r"lower encoder.query_spikes to ([\d.]+), or use --input-mode bias", text)[1])  # type: ignore[index]
    partition(made, KAPOHO_BAY, even(made, most))
    refused(made, KAPOHO_BAY, most + 0.2)
    assert partition(replace(made, regular=True, bias_input=True), KAPOHO_BAY, even(made, 40.0)).host_spikes == 0


def test_a_regular_train_spikes_in_a_step_as_often_as_a_draw_does() -> None:
    """Of 500 inputs and 20 spikes a step, the counts of one step spread as the bound says: by the phases."""
    rates = np.full(500, round(65536 * 0.04), np.uint16)
    keys = presentation_keys(0, "query", np.arange(300))
    counts = draw_trains(rates[None].repeat(300, 0), keys, 61, 61, regular=True).sum(axis=2, dtype=np.int64)
    assert counts.mean() == pytest.approx(20, rel=0.01)
    p = 0.04 / 0.98
    assert counts[:, 1:20].mean() == pytest.approx(500 * p, rel=0.01)
    assert counts[:, 1:20].std() == pytest.approx((500 * p * (1 - p)) ** 0.5, rel=0.05)
    assert counts.max() <= host_spikes(replace(network(12, 500), regular=True), np.full(500, 0.04))


def test_inhibition_that_no_synapse_holds() -> None:
    made = network(12, 5, inhibition=127)
    text = refused(made, tiny(weight_bits=(3, 4, 6)))
    assert "at most 6 bits, but inhibition 127 needs more; change network.inhibition" in text


def test_rates_of_other_inputs_are_a_mistake_of_the_caller() -> None:
    made = network(4, 5)
    for rates in (np.ones(4), np.full(5, -1.0), np.full(5, np.nan)):
        with pytest.raises(ValueError, match="rates"):
            partition(made, KAPOHO_BAY, rates)


def test_counters_take_a_compartment_an_axon_and_a_word_each() -> None:
    made = network(12, 30)
    without, beside = (partition(made, tiny(counters=counters), even(made)).cores[0] for counters in (False, True))
    more = {name: getattr(beside.needs, name) - getattr(without.needs, name) for name in LIMITS}
    assert more == {
        **{"compartments": 12, "axons_in": 12, "axons_out": 0, "synapse_words": 12},
        **{"profiles": 1, "thresholds": 1, "formats": 1},
    }
    for limits in ({"compartments": 8}, {"axons_in": 40}, {"axons_out": 9}):
        plan = partition(made, tiny(counters=True, **limits), even(made))
        assert len(plan.cores) > 1
        check_plan(plan)
        check_images(plan)
    said = refused(made, tiny(counters=True, compartments=6))
    assert "neurons and their counters need 25 compartments, but the 4 cores of Kapoho Bay" in said
