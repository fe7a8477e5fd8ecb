"""Runs a network in SANA-FE: python -I worker.py PROBLEM RESULT (an environment of its own, see `make sanafe`).

SANA-FE is licensed under GPL-3.0: only this script imports it, and it imports nothing of the project. It reads the JSON
that `benchmarks.sanafe.problem` describes and writes JSON. ``-I`` keeps the project's folders
off the path: one of them is called ``sanafe``, too.

The chip is the ``loihi.yaml`` that SANA-FE brings, its figures untouched. Changed are: the mesh, wide enough for the
board's chips, with tiles up to the last one used; the cores of a tile; as many input units on each core as play there
(1024 of them take 13 MB); and, if spikes are injected, one more core on tile 0, the port: a copy of the others with an
input unit for each input. Input units play a spike train; their accesses, updates and spikes take neither energy nor
time, their messages do as all others. On request the port's messages take no time.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

STEP_FIELDS = ("synapse_energy", "dendrite_energy", "soma_energy", "network_energy", "total_energy", "sim_time")
COUNT_FIELDS = ("updated", "fired", "spikes", "hops")


def replaced(text: str, pattern: str, by: str) -> str:
    """``text`` with the one place that matches ``pattern`` replaced."""
    changed, times = re.subn(f"(?m){pattern}", by, text)
    if times != 1:
        raise SystemExit(f"loihi.yaml of this SANA-FE holds {pattern!r} {times} times, not once")
    return changed


def architecture(problem: dict[str, Any], shipped: str) -> str:
    """The text of the architecture; see the module."""
    text = replaced(shipped, r"^    width: \d+$", f"    width: {problem['columns']}")
    text = replaced(text, r"^    height: \d+$", f"    height: {problem['rows']}")
    head, tile, core = re.split(
        r"^(?=    - name: loihi_tile|        - name: loihi_core)", text.rstrip() + "\n", flags=re.M
    )
    port, units = "", problem["port_units"]
    if units:
        port = replaced(core, r"loihi_core\[0\.\.\d+\]", "port")
        port = replaced(port, r"max_neurons_supported: \d+", f"max_neurons_supported: {units}")
        port = replaced(port, r"loihi_inputs\[0\.\.\d+\]", f"loihi_inputs[0..{units - 1}]")
        if not problem["port_takes_time"]:
            port = replaced(port, r"latency_message_out: .*$", "latency_message_out: 0.0")
    core = replaced(core, r"loihi_core\[0\.\.\d+\]", f"loihi_core[0..{problem['tile_cores'] - 1}]")
    core = replaced(core, r"loihi_inputs\[0\.\.\d+\]", f"loihi_inputs[0..{problem.get('core_units', 1) - 1}]")
    tiles = [replaced(tile, r"loihi_tile\[0\.\.\d+\]", f"tile_{number}") + core for number in range(problem["tiles"])]
    return head + tiles[0] + port + "".join(tiles[1:])


def build(sanafe: Any, problem: dict[str, Any], arch: Any) -> Any:
    """The chip with the network of ``problem`` loaded."""
    net = sanafe.Network()
    made = {}
    for group in problem["groups"]:
        made[group["name"]] = group_made = net.create_neuron_group(
            group["name"],
            group["size"],
            model_attributes=group["attributes"],
            default_dendrite_hw_name="loihi_dendrites",
            soma_hw_name="loihi_inputs[0]" if group["plays"] else "loihi_lif",
            log_spikes=not group["plays"],
        )
        for i in range(group["size"] if group["plays"] else 0):
            group_made[i].set_attributes(soma_hw_name=f"loihi_inputs[{i}]")
        for i, bias in group["own_biases"]:
            group_made[i].set_attributes(model_attributes={"bias": bias})
        group_made.map_to_core(arch.tiles[group["tile"]].cores[group["core"]])
    # A connection takes the synapse unit that its target names at that time.
    for kind in ("dense", "sparse"):
        for group_made in made.values():
            for neuron in group_made:
                neuron.set_attributes(default_synapse_hw_name=f"loihi_{kind}_synapse")
        for row in problem["synapses"]:
            if row["kind"] == kind:
                pairs = list(zip(row["pre"], row["post"]))  # noqa: B905 - of equal length
                made[row["from"]].connect_neurons_sparse(made[row["to"]], {"w": row["weights"]}, pairs)
    chip = sanafe.SpikingChip(arch)
    chip.load(net)
    return chip


def play(chip: Any, groups: Any, problem: dict[str, Any], query: dict[str, Any], timing: str) -> dict[str, Any]:
    """One query from rest. Membranes and currents are reset after it; a train that is set starts from its beginning."""
    for name, index, train in query["trains"]:
        groups[name][index].set_attributes(model_attributes={"spikes": train})
    for name, index, bias in query["own_biases"]:
        groups[name][index].set_attributes(model_attributes={"bias": bias})
    for name, index, bias, potential in query["biases"]:
        groups[name][index].set_attributes(model_attributes={"bias": bias, "potential": potential})
    parts = [chip.sim(problem["steps"], timing, 1, 0, perf_trace=True, spike_trace=True)]
    for name, index, _, _ in query["biases"]:
        groups[name][index].set_attributes(model_attributes={"bias": 0})
    parts.append(chip.sim(problem["silent_steps"], timing, 1, 0, perf_trace=True, spike_trace=True))
    chip.reset()
    answer: dict[str, Any] = {key: [] for key in (*STEP_FIELDS, *COUNT_FIELDS, "fired_neurons")}
    for part in parts:
        for key in (*STEP_FIELDS, *COUNT_FIELDS):
            answer[key] += list(part["perf_trace"][key])
        answer["fired_neurons"] += [[[a.group_name, a.neuron_offset] for a in step] for step in part["spike_trace"]]
    answer["packets"] = sum(part["packets_sent"] for part in parts)
    return answer


def main(problem_path: str, result_path: str) -> None:
    """Answer every query of the problem, with simple and with detailed timing."""
    os.environ["OMP_NUM_THREADS"] = "1"
    sanafe = importlib.import_module("sanafe")
    version = importlib.import_module("importlib.metadata").version("sanafe")
    problem = json.loads(Path(problem_path).read_text())
    shipped = Path(str(sanafe.__file__)).parent / "examples" / "loihi.yaml"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chip.yaml"
        path.write_text(architecture(problem, shipped.read_text()))
        arch = sanafe.load_arch(str(path))
    chip = build(sanafe, problem, arch)
    groups = chip.mapped_neuron_groups
    answers = []
    for query in problem["queries"]:
        answer = play(chip, groups, problem, query, "simple")
        again = play(chip, groups, problem, query, "detailed")
        answer["detailed_time"] = sum(again["sim_time"])
        answer["repeats"] = all(answer[key] == again[key] for key in (*COUNT_FIELDS, "fired_neurons", "total_energy"))
        answers.append(answer)
    Path(result_path).write_text(json.dumps({"version": version, "queries": answers}))


if __name__ == "__main__":
    main(*sys.argv[1:])
