"""What does not fit a board is refused with resource, need, limit and a remedy that helps."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from support.boards.small_boards import check_plan, even, network, tiny

from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.mapping.partition import partition
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError


def refused(made: FixedNetwork, board: Board, spikes: float = 5.0) -> str:
    with pytest.raises(NetworkLimitError) as caught:
        partition(made, board, even(made, spikes))
    text = str(caught.value)
    assert "\n" not in text
    assert text.count("; ") == 1
    return text


def test_compartments() -> None:
    made = network(9, 5)
    text = refused(made, tiny(compartments=4))
    assert "neurons and relays need 18 compartments, but the 4 cores of Kapoho Bay" in text
    assert text.endswith("have 16; use at most 8 neurons, so fewer places or network.neurons_per_place")
    check_plan(partition(network(8, 5), tiny(compartments=4), np.ones(5)))


def test_compartments_of_inputs() -> None:
    made = network(5, 20, bias_input=True)
    text = refused(made, tiny(compartments=7))
    assert "neurons, relays and inputs need 30 compartments, but the 4 cores" in text
    assert "have 28; use --input-mode injected" in text
    check_plan(partition(replace(made, bias_input=False), tiny(compartments=7), np.ones(20)))


def test_input_axons() -> None:
    made = network(12, 30, share=1.0)
    text = refused(made, tiny(axons_in=40))
    assert "a core with 3 of 12 neurons needs 42 input axons, but a core of Kapoho Bay" in text
    assert "has 40; use --weight-bits 1 or --prune 0.5" in text
    made = replace(made, bits=1, weights=np.minimum(made.weights, 1))
    text = refused(made, tiny(axons_in=36))
    assert text.endswith("has 36; use --prune 0.5")
    made = network(12, 3, bits=1, share=1.0)
    # Without its last weight a neuron would say nothing: that is no remedy.
    assert refused(made, tiny(axons_in=12)).endswith("at most 9 neurons, so fewer places or network.neurons_per_place")


def test_output_axons() -> None:
    made = network(12, 5)
    text = refused(made, tiny(axons_out=5))
    assert "a core with 3 of 12 neurons needs 6 output axons, but a core of Kapoho Bay" in text
    assert "has 5; use at most" in text
    text = refused(made, tiny(axons_out=11))
    assert text.startswith("12 neurons need 6 cores of 11 output axons, but Kapoho Bay (two Loihi 1 chips) has 4; ")
    most = int(re.search(r"use at most (\d+) neurons", text)[1])  # type: ignore[index]
    check_plan(partition(replace(made, weights=made.weights[:, :most]), tiny(axons_out=11), np.ones(5)))
    refused(replace(made, weights=made.weights[:, : most + 1]), tiny(axons_out=11))


def test_synapse_memory_and_every_remedy_that_is_named_helps() -> None:
    made, board = network(60, 40, share=0.8, bits=8, inhibition=3), tiny(synapse_words=100)
    text = refused(made, board)
    assert "a core with 15 of 60 neurons needs 132 words of synapse memory, but a core of Kapoho" in text
    bits = int(re.search(r"--weight-bits (\d)", text)[1])  # type: ignore[index]
    share = float(re.search(r"--prune ([\d.]+)", text)[1])  # type: ignore[index]
    less = 8 - bits
    fewer = replace(made, bits=bits, weights=made.weights >> less, inhibition=made.inhibition >> less)
    check_plan(partition(fewer, board, even(made, 5.0)))
    weights = made.weights.copy()
    np.put_along_axis(weights, np.argsort(weights, axis=0, kind="stable")[: round(share * 40)], 0, axis=0)
    check_plan(partition(replace(made, weights=weights), board, even(made, 5.0)))


def test_cores_alone() -> None:
    """Too few cores for several limits at once: no single one is to blame."""
    text = refused(network(12, 5, bits=1), tiny(axons_out=10, synapse_words=9))
    assert text.startswith("12 neurons need 9 cores, but Kapoho Bay (two Loihi 1 chips) has 4; use at most 7 neurons")


@pytest.mark.parametrize(
    ("limits", "bias_input", "text"),
    [
        ({"profiles": 1}, False, "needs 2 profiles, but Kapoho Bay (two Loihi 1 chips) has 1; use another --target"),
        ({"profiles": 2}, True, "needs 3 profiles, but Kapoho Bay (two Loihi 1 chips) has 2; use --input-mode inj"),
        ({"thresholds": 1}, False, "needs 2 thresholds, but Kapoho Bay (two Loihi 1 chips) has 1; use another --tar"),
        ({"thresholds": 2}, True, "needs 3 thresholds, but Kapoho Bay (two Loihi 1 chips) has 2; use --input-mode inj"),
        ({"formats": 2}, False, "needs 3 formats, but Kapoho Bay (two Loihi 1 chips) has 2; use another --target"),
        ({"weight_bits": (1, 2, 6)}, False, "at most 6 bits, but these need 8; use --weight-bits 6"),
        ({"index_bits": ()}, False, "synapses to relays need index bits"),
        ({"input_limit": 300}, False, "lateral inhibition of 12 neurons can reach 484, but Kapoho Bay"),
    ],
)
def test_limits_that_no_choice_of_cores_helps(limits: dict[str, int], bias_input: bool, text: str) -> None:
    made = network(12, 5, bits=8, bias_input=bias_input)
    assert text in refused(made, tiny(**limits))


def test_host_spikes_and_both_remedies() -> None:
    made = network(12, 50)
    assert partition(made, KAPOHO_BAY, even(made, 21.8)).host_spikes == pytest.approx(21.8 + 6 * 21.8**0.5)
    text = refused(made, KAPOHO_BAY, 30.0)
    assert "the host would have to send up to 62.9 input spikes a step, but Kapoho Bay" in text
    assert "takes 50 a chip; lower encoder.query_spikes to 21.9, or use --input-mode bias" in text
    partition(made, KAPOHO_BAY, even(made, 21.9))
    assert partition(replace(made, bias_input=True), KAPOHO_BAY, even(made, 30.0)).host_spikes == 0


def test_a_shift_of_the_sum() -> None:
    made = replace(network(12, 5), shift=2)
    assert "shifted right by 2, but Kapoho Bay" in (text := refused(made, KAPOHO_BAY))
    anew = "each weight; quantise the model anew with `lava-vpr deploy`"
    assert text.endswith(anew + " or use --weight-bits 1")
    assert refused(replace(made, shift=3), KAPOHO_BAY).endswith(anew)


def test_a_lateral_weight_that_no_synapse_holds() -> None:
    made = network(12, 5, inhibition=127)
    text = refused(made, tiny(weight_bits=(3, 4, 6)))
    assert "at most 6 bits, but lateral inhibition 127 needs more; change network.inhibition" in text


def test_rates_of_other_inputs_are_a_mistake_of_the_caller() -> None:
    made = network(4, 5)
    for rates in (np.ones(4), np.full(5, -1.0), np.full(5, np.nan)):
        with pytest.raises(ValueError, match="rates"):
            partition(made, KAPOHO_BAY, rates)
