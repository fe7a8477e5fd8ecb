"""The cross-check with SANA-FE: what it is asked, how its answer is compared, and what a broken one leads to."""

from __future__ import annotations

import copy
import functools
import json
import stat
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.learning.replayed import gained
from benchmarks.places import encoded, learn
from benchmarks.sanafe import cross_check as checking, worker
from benchmarks.sanafe.compare import LIMIT, SEEDS, SanafeCase, failures, presented, random_case, real
from benchmarks.sanafe.cross_check import CrossCheck, ask, compare, cross_check
from benchmarks.sanafe.problem import PORT, bias_and_membrane, problem_of, without_counters
from lava_vpr.config import preset
from lava_vpr.deploy.boards.board import LOIHI_2
from lava_vpr.deploy.boards.constants import LOIHI_1
from lava_vpr.deploy.cost.events import count_events, routes
from lava_vpr.deploy.mapping.partition import partition
from lava_vpr.engine.inference.biases import LEVEL, bias_input_spikes
from lava_vpr.engine.presentations import Trains
from lava_vpr.engine.random import presentation_keys
from lava_vpr.errors import BackendUnavailableError, InputError

STANDIN = Path(__file__).parents[1] / "support" / "standins" / "sanafe_python.py"
CHIP = """\
architecture:
  attributes:
    width: 8
    height: 4
  tile:
    - name: loihi_tile[0..31]
      core:
        - name: loihi_core[0..3]
          attributes: {max_neurons_supported: 1024}
          soma:
            - name: loihi_inputs[0..1023]
          axon_out:
            - name: out
              attributes:
                latency_message_out: 5.1e-9
"""


@functools.cache
def case(seed: int) -> SanafeCase:
    return random_case(seed)


def standin(folder: Path) -> Path:
    """An executable that gets what a Python with SANA-FE would: -I -B WORKER PROBLEM RESULT."""
    path = folder / "python"
    path.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{STANDIN}" "$@"\n')
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


@functools.cache
def answer(seed: int) -> dict[str, Any]:
    """Of the stand-in."""
    with tempfile.TemporaryDirectory() as folder:
        return ask(asked(case(seed)), standin(Path(folder)))


def asked(own: SanafeCase) -> dict[str, Any]:
    """The problem of a case."""
    return problem_of(own.plan, own.trains, input_core=own.input_core, bias=own.bias)


def again(seed: int, answered: dict[str, Any]) -> CrossCheck:
    """The comparison with ``answered``."""
    own = case(seed)
    tiles = len({group["tile"] for group in asked(own)["groups"]})
    return compare(own.plan, own.trains, answered, input_core=own.input_core, tiles=tiles, bias=own.bias)


@pytest.mark.quick(2)
@pytest.mark.parametrize("seed", [0, 3, 7, 8, 22, 28])
def test_the_closed_form_is_what_events_one_by_one_sum_to(seed: int, tmp_path: Path) -> None:
    own = case(seed)
    found = cross_check(own.plan, own.trains, python=standin(tmp_path), input_core=own.input_core, bias=own.bias)
    assert failures(own, found) == []
    assert found.version == "stand-in"
    assert found.queries == 2
    assert found.microjoules["total"][1] > 0
    assert found.counts["spikes"][0] > 0


def test_both_ways_of_injecting(tmp_path: Path) -> None:
    own = case(0)
    times = []
    for input_core in (True, False):
        found = cross_check(own.plan, own.trains, python=standin(tmp_path), input_core=input_core)
        assert failures(own, found) == []
        times.append(found.simple_milliseconds[0])
    assert times[0] > times[1]


def test_zeros_that_reach_a_membrane_of_zero_count_as_updates() -> None:
    own = case(28)
    events = checking.count_events(without_counters(own.plan), own.trains, entry=(0, 0))
    assert events.touched.sum() > events.updates.sum()
    assert again(28, answer(28)).counts["updates"][0] == events.touched.sum() / 2


@pytest.mark.parametrize("name", ["synapse_energy", "soma_energy", "network_energy", "total_energy", "sim_time"])
def test_a_part_in_a_hundred_thousand_in_one_step_is_seen(name: str) -> None:
    answered = copy.deepcopy(answer(0))
    step = answered["queries"][1][name]
    step[7] *= 1 + 1e-5 if name in ("total_energy", "sim_time") else 1.001
    found = again(0, answered)
    assert found.difference > LIMIT


@pytest.mark.parametrize("name", ["updated", "spikes", "hops"])
def test_one_event_more_is_seen(name: str) -> None:
    answered = copy.deepcopy(answer(0))
    answered["queries"][0][name][3] += 1
    assert len(failures(case(0), again(0, answered))) == 1


def test_another_spike_is_seen() -> None:
    answered = copy.deepcopy(answer(0))
    fired = next(step for step in answered["queries"][0]["fired_neurons"] if step)
    fired[0][1] += 1 if fired[0][1] == 0 else -1
    assert again(0, answered).spikes_differ in (1, 2)


@pytest.mark.parametrize("seed", [7, 22])
def test_biases_of_each_query_take_the_place_of_the_networks(seed: int, tmp_path: Path) -> None:
    own = case(seed)
    assert own.bias is not None
    biased = own.bias != 0
    assert (biased[0] != biased[1]).any()  # SANA-FE is told that a neuron has no bias any more
    assert failures(own, again(seed, answer(seed))) == []
    found = again(seed, ask(problem_of(own.plan, own.trains, input_core=own.input_core), standin(tmp_path)))
    assert found.spikes_differ


def test_what_is_no_number_is_no_agreement() -> None:
    answered = copy.deepcopy(answer(0))
    answered["queries"][0]["sim_time"][3] = float("nan")
    assert failures(case(0), again(0, answered)) == ["apart by nan"]


def test_a_wrong_constant_is_seen() -> None:
    wrong = replace(LOIHI_1, hop_north_south=replace(LOIHI_1.hop_north_south, nominal=4.201))
    own = case(0)
    plan = replace(own.plan, board=replace(own.plan.board, constants=wrong))
    tiles = len({group["tile"] for group in problem_of(own.plan, own.trains)["groups"]})
    found = compare(plan, own.trains, answer(0), input_core=own.input_core, tiles=tiles)
    assert failures(own, found)[0].startswith("apart by")


@pytest.mark.parametrize("seed", SEEDS)
def test_rows_are_those_of_the_plan(seed: int) -> None:
    own = case(seed)
    problem, way = problem_of(own.plan, own.trains), routes(own.plan)
    stored = {"dense": 0, "sparse": 0}
    for row in problem["synapses"]:
        assert len(row["pre"]) == len(row["post"]) == len(row["weights"]) > 0
        stored[row["kind"]] += len(row["pre"])
    network = own.plan.network
    single = network.neurons + network.leaves + (network.inputs if network.relayed else 0)
    expected = way.input_rows.sum(axis=(0, 1)) + way.root_rows.sum(axis=0) + [0, single]
    assert [stored["dense"], stored["sparse"]] == expected.tolist()
    sizes = sum(group["size"] for group in problem["groups"] if not group["plays"])
    assert sizes == network.neurons + network.inhibitory + network.input_compartments
    assert any(group["name"] == PORT for group in problem["groups"]) != network.bias_input
    assert sum(len(group["own_biases"]) for group in problem["groups"]) == np.count_nonzero(network.bias)


def test_the_random_networks_have_everything() -> None:
    networks = [case(seed).plan.network for seed in SEEDS]
    for name in ("signed", "relayed", "leaves", "bias_input", "regular", "inhibition"):
        values = [bool(getattr(network, name)) for network in networks]
        assert any(values), name
        assert not all(values), name
    assert any(network.bias.any() for network in networks)
    tiles = {count_events(own.plan, own.trains, bias=own.bias).tiles or 0 for own in map(case, SEEDS)}
    assert {1, 2} < tiles  # the barrier's table has 1, 2, 4 and 29
    assert max(tiles) >= 29


def test_a_bias_for_every_regular_train() -> None:
    rng = np.random.default_rng(3)
    for key in presentation_keys(1, "query", np.arange(6)):
        rates = (rng.random(200) ** 3 * 65_535).astype(np.uint16)
        trains = bias_input_spikes(rates, int(key), 90)
        for train in trains.T:
            bias, v = bias_and_membrane(train)
            assert bias or v
            assert v <= LEVEL
            for expected in train:
                v += bias
                assert (v > LEVEL) == expected
                v = 0 if expected else v


def test_no_bias_for_other_trains() -> None:
    for spikes in ([0, 1, 5], [5, 7]):
        train = np.zeros(20, np.uint8)
        train[spikes] = 1
        with pytest.raises(BackendUnavailableError, match="not regular"):
            bias_and_membrane(train)


def test_what_cannot_be_asked() -> None:
    own = case(0)
    network = own.plan.network
    resettable = replace(network, steps=64 - network.silent_steps)
    other = partition(resettable, LOIHI_2, np.full(network.inputs, 0.01))
    for plan, trains, why in (
        (other, own.trains, "Loihi 1, not Loihi 2"),
        (own.plan, Trains(own.trains.exc), "inputs and inhibitory neurons"),
    ):
        with pytest.raises(BackendUnavailableError, match=why):
            cross_check(plan, trains)


def test_other_events_with_detailed_timing_are_an_error() -> None:
    answered = copy.deepcopy(answer(0))
    answered["queries"][1]["repeats"] = False
    with pytest.raises(InputError, match="other events with detailed timing than with simple"):
        again(0, answered)


def test_the_chip_that_the_worker_makes() -> None:
    problem = {"columns": 16, "rows": 4, "tile_cores": 4, "tiles": 2, "port_units": 7, "port_takes_time": False}
    text = worker.architecture(problem, CHIP)
    assert "    width: 16\n" in text
    tile_0, tile_1 = text.split("- name: tile_0")[1].split("- name: tile_1")
    for tile in (tile_0, tile_1):
        assert tile.count("loihi_core[0..3]") == 1
        assert tile.count("loihi_inputs[0..0]") == 1
    assert "loihi_inputs[0..6]" in tile_0
    assert "max_neurons_supported: 7" in tile_0
    assert "latency_message_out: 5.1e-9" in tile_0
    assert "latency_message_out: 0.0" in tile_0
    assert "name: port" not in tile_1
    assert "latency_message_out: 0.0" not in worker.architecture(problem | {"port_takes_time": True}, CHIP)
    assert "name: port" not in worker.architecture(problem | {"port_units": 0}, CHIP)
    with pytest.raises(SystemExit, match="width"):
        worker.architecture(problem, CHIP.replace("width", "breadth"))


def test_only_the_worker_imports_sanafe() -> None:
    assert "sanafe" not in sys.modules
    source = Path(worker.__file__).read_text()
    assert "lava_vpr." not in source.replace("`benchmarks.sanafe.problem`", "")
    assert json.dumps(problem_of(case(0).plan, case(0).trains))


needs_sanafe = pytest.mark.skipif(not checking.PYTHON.exists(), reason="SANA-FE is not installed; run make sanafe")


@needs_sanafe
@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_sanafe_itself_agrees(seed: int) -> None:
    own = case(seed)
    found = cross_check(own.plan, own.trains, input_core=own.input_core, bias=own.bias)
    assert failures(own, found) == []
    assert found.version == "2.2.9"
    assert found.detailed_milliseconds >= found.simple_milliseconds[1] * (1 - LIMIT)


@needs_sanafe
@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize(("name", "places"), [("loihi", 100), ("loihi", 500), ("fast", 100)])
def test_sanafe_agrees_on_real_images(name: str, places: int, data_root: Path) -> None:
    own = real(name, learn((0, places), preset(name)), 2)
    assert failures(own, cross_check(own.plan, own.trains)) == []


@needs_sanafe
@pytest.mark.data
@pytest.mark.slow
def test_sanafe_agrees_under_gains(data_root: Path) -> None:
    model = learn((0, 100), preset("loihi"))
    drive = encoded("winter", model.config.encoder).take(slice(0, 100))
    own = presented("loihi", model, gained(model, drive, 2))
    assert failures(own, cross_check(own.plan, own.trains, bias=own.bias)) == []
