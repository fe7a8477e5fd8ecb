"""What SANA-FE is asked about a network from pixels on: the same spikes, synapses and cores, counted once more."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from support.boards.loihi2_bundles import hearing, pictures

from benchmarks.sanafe import pixels
from benchmarks.sanafe.compare import pixel_failures, pixel_rows
from benchmarks.sanafe.pixels import PixelsChecked, check_pixels, problem_of_pixels
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.cost.front_end import front_end_costs
from lava_vpr.deploy.mapping.front_end import placed
from lava_vpr.engine.presentations import PixelBlock

SMALL = replace(KAPOHO_BAY, compartments=48)
"""A board whose cores are so small that populations take several."""
SHOWN = PixelBlock(pictures(2, spec=hearing()))


def answer(problem: dict[str, object], more: int = 0) -> dict[str, object]:
    """What SANA-FE would count of a problem, spike by spike, and so many messages more."""
    reached: dict[tuple[str, int], Counter[str]] = {}
    for row in problem["synapses"]:  # type: ignore[attr-defined]
        for neuron in row["pre"]:
            reached.setdefault((row["from"], neuron), Counter())[row["to"]] += 1
    found = []
    for query in problem["queries"]:  # type: ignore[attr-defined]
        spikes = Counter({(name, neuron): sum(train) for name, neuron, train in query["trains"]})
        operations = sum(n * reached.get(of, Counter()).total() for of, n in spikes.items())
        messages = more + sum(n * len(reached.get(of, ())) for of, n in spikes.items())
        constants = KAPOHO_BAY.constants
        assert constants is not None
        synapse, message = (each.nominal * 1e-12 for each in (constants.synapse_sparse, constants.message))
        energies = {"synapse_energy": [operations * synapse], "network_energy": [messages * message]}
        found.append({"spikes": [operations], "packets": messages, "fired": [spikes.total()], **energies})
    return {"version": "2.2.9", "queries": found}


def test_the_problem_has_the_spikes_synapses_and_cores_of_the_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pixels, "KAPOHO_BAY", SMALL)
    plan = placed(hearing(), SMALL)
    problem = problem_of_pixels(hearing(), plan, SHOWN)
    playing = [one for one in problem["groups"] if one["plays"]]
    assert len(playing) == plan.cores > len(plan.populations)
    assert sum(one["size"] for one in playing) == sum(hearing().populations.values())
    assert len({one["core"] for one in problem["groups"]}) == len(problem["groups"]) == problem["tile_cores"]
    assert problem["steps"] + problem["silent_steps"] == hearing().steps
    costs, counted = front_end_costs(hearing(), plan, SHOWN).all, answer(problem)["queries"]
    for name, key in (("operations", "spikes"), ("messages", "packets"), ("spikes", "fired")):
        mean = np.mean([np.sum(query[key]) for query in counted])  # type: ignore[attr-defined]
        assert getattr(costs, name) == mean > 0, name


@pytest.mark.parametrize(("more", "said"), [(0, []), (1, ["apart by "])])
def test_answers_are_held_against_the_cost_model(monkeypatch: pytest.MonkeyPatch, more: int, said: list[str]) -> None:
    monkeypatch.setattr(pixels, "ask", lambda problem: answer(problem, more))
    checked = check_pixels(hearing(), SHOWN)
    lines = pixel_failures(checked)
    assert [line[: len("apart by ")] for line in lines] == said
    rows = list(pixel_rows("small", checked))
    assert [row[0].strip() for row in rows] == ["small", "synapse, uJ", "network, uJ", *checked.counts]
    assert (rows[4][3] == "0") == (more == 0)


def test_images_without_spikes_compare_little() -> None:
    nothing = np.zeros(1), np.zeros(1)
    assert pixel_failures(PixelsChecked("", {"messages": nothing}, {})) == ["no messages, so little was compared"]
