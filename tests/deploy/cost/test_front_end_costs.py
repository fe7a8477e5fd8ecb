"""What a presentation of the spiking front end costs, counted again synapse by synapse and core by core."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from support.boards.loihi2_bundles import hearing, pictures

from lava_vpr.bench.show.front_end import HEADS, tables
from lava_vpr.deploy.boards.board import KAPOHO_BAY, LOIHI_2
from lava_vpr.deploy.cost.front_end import FrontEndCosts, front_end_costs
from lava_vpr.deploy.mapping.front_end import placed
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_network import populations
from lava_vpr.inputs.front_end_settings import FRONT_END

SPEC = FrontEnd(width=8)
SMALL = replace(KAPOHO_BAY, compartments=48)
"""A board whose cores are so small that populations take several."""


def two_edges() -> NDArray[np.uint8]:
    """An image with an edge, and its mirror image."""
    grey = np.tile(np.array([20, 20, 20, 30, 200, 200, 220, 220], np.uint8), (2, SPEC.height, 1))
    grey[1] = grey[1, :, ::-1]
    return grey


def counted() -> FrontEndCosts:
    return front_end_costs(SPEC, placed(SPEC, SMALL), PixelBlock(two_edges()))


EVENTS_SPEC = FrontEnd(width=8, levels=16, white=12, pixel_octaves=3.0, window=8)


@pytest.mark.parametrize("spec", [SPEC, EVENTS_SPEC], ids=["images", "events"])
def test_events_of_each_layer_are_those_that_its_spikes_make(spec: FrontEnd) -> None:
    """One after the other: a spike reaches every target of its neuron in the step after, once a core as a message."""
    shown = two_edges() if spec is SPEC else np.minimum(two_edges().repeat(2, 1).repeat(2, 2) // 30, 8).astype(np.uint8)
    films, plan = spec.trains(shown), placed(spec, SMALL)
    found = front_end_costs(spec, plan, PixelBlock(shown))
    if spec.window:
        films["events"] = spec.events(shown).astype(np.uint8)
        assert found.registers["events"] == round(films["events"].sum() / 2) > 0
    words = " ".join(cell for table in tables(replace(found, board="kapoho-bay")) for row in table.rows for cell in row)
    assert ("registers: pixels" in words, "registers: events" in words) == (not spec.window, False)
    assert plan.populations["filters"].cores > 2
    arrived = {name: np.zeros((2, spec.steps + 1, n), bool) for name, n in spec.populations.items()}
    operations, messages = dict.fromkeys(films, 0), dict.fromkeys(films, 0)
    for (source, to, _), stored in plan.rows.items():
        core_of = np.searchsorted(plan.populations[to].starts, np.arange(spec.populations[to]), side="right")
        reached: dict[int, set[int]] = {}
        for target, neuron in zip(*stored.nonzero(), strict=True):
            spikes = films[source][:, :, neuron].astype(bool)
            operations[to] += int(spikes[:, :-1].sum())
            arrived[to][:, 1:, target] |= spikes
            reached.setdefault(neuron, set()).add(core_of[target])
        for neuron, cores in reached.items():
            messages[source] += int(films[source][:, :, neuron].sum()) * len(cores)
    arrived["pixels"][:, 0] |= not spec.window  # which integrate their grey level
    arrived["clock"][:, 0, 0] = True
    for name, one in found.layers.items():
        assert one.neurons == populations(spec)[name].size
        assert one.spikes == films[name].sum() / 2
        assert one.active == films[name].any(axis=2).sum() / 2
        assert one.operations == operations[name] / 2
        assert one.messages == messages[name] / 2
        updated = np.maximum.accumulate(arrived[name][:, : spec.steps], axis=1)
        assert one.updates == updated.sum() / 2
    assert found.all.accesses == spec.accesses
    assert found.layers["cells"].spikes > 0


def test_energies_and_times_are_events_times_constants() -> None:
    found, constants = counted(), KAPOHO_BAY.constants
    assert constants is not None
    assert found.dynamic_microjoules is not None
    pairs = found.layers["pairs"]
    expected = constants.access.high * pairs.accesses + constants.update.high * pairs.updates
    expected += constants.spike.high * pairs.spikes + constants.synapse_sparse.high * pairs.operations
    expected += constants.message.high * pairs.messages
    assert found.dynamic_microjoules["pairs"].high == pytest.approx(expected / 1e6)
    assert found.milliseconds is not None
    assert found.step_microseconds is not None
    assert found.milliseconds.low == pytest.approx(found.step_microseconds.low * SPEC.steps / 1e3)
    least = constants.barrier(found.cores // 4).nominal + 48 * constants.access_time.nominal / 1e3
    assert least < found.step_microseconds.nominal < 2 * least
    kept = {
        "clock": 1,
        "pixels": 1,
        "filters": 2,
        "pairs": 1,
        "onsets": 1,
        "cells": 1,
        "pools": 1,
    }  # membranes, currents
    cleared = sum(SPEC.populations[name] * states for name, states in kept.items())
    assert found.registers == {"pixels": 64 + 1, "clearing of states": cleared, "counts of cells": 32}
    assert found.between_milliseconds is not None
    assert found.between_milliseconds["clearing of states"].low == pytest.approx(
        cleared * constants.register_time.low / 1e6
    )
    assert found.packets == 2


def test_a_board_without_public_constants_is_counted_and_resets_by_itself() -> None:
    found = front_end_costs(SPEC, placed(SPEC, LOIHI_2), PixelBlock(two_edges()))
    assert found.registers["clearing of states"] == 0
    assert found.milliseconds is None
    layers, besides = tables(found)
    assert {row[-1] for row in layers.rows} == {"-"}
    assert layers.columns[1:] == HEADS
    assert layers.rows[-1][0] == "all"
    assert len(besides.rows) == 4


def test_biases_of_an_adapted_query_are_written_before_it() -> None:
    whole = hearing()
    shown, bias = pictures(2, spec=whole), np.full((2, 7), -(1 << 12), np.int32)
    each = (PixelBlock(shown), PixelBlock(shown, bias))
    plain, adapted = (front_end_costs(whole, placed(whole, KAPOHO_BAY), one) for one in each)
    assert adapted.registers == {**plain.registers, "counts of cells": 32, "biases of exc": 2 * 7 + 1}
    spikes = [one.layers["exc"].spikes for one in (plain, adapted)]
    assert spikes == [whole.trains(*one)["exc"].sum() / 2 for one in each]
    assert spikes[0] != spikes[1]
    assert adapted.packets == plain.packets + 2
    assert adapted.between_milliseconds is not None
    assert adapted.between_milliseconds["biases of exc"].low > 0


def test_accesses_are_most_of_what_the_default_front_end_takes() -> None:
    """Of the 148 uJ of docs/network.md, which says two thirds."""
    constants = KAPOHO_BAY.constants
    assert constants is not None
    assert 90 < FRONT_END.accesses * constants.access.nominal / 1e6 < 100
