"""Stands in for a Python with SANA-FE: python sanafe_python.py -I -B WORKER PROBLEM RESULT.

Event by event, as SANA-FE 2.2.9 does it with its ``loihi.yaml`` and `simple` timing; written from its description in
`benchmarks.sanafe.cross_check`, without the project's cost model and constants.

Used by benchmarks.
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

PJ, NS = 1e-12, 1e-9
SYNAPSE = {"dense": (35.5 * PJ, 3.8 * NS), "sparse": (33.6 * PJ, 4.7 * NS)}
BARRIER = {1: 0.6e-6, 2: 1.0e-6, 4: 1.4e-6, 29: 1.8e-6}


class Chip:
    """A problem's network."""

    def __init__(self, problem: dict[str, Any]) -> None:
        self.problem = problem
        self.groups = {group["name"]: group for group in problem["groups"]}
        self.neurons = [(name, i) for name, group in self.groups.items() for i in range(group["size"])]
        self.core = {name: (group["tile"], group["core"]) for name, group in self.groups.items()}
        self.own = {(name, i): bias for name, group in self.groups.items() for i, bias in group["own_biases"]}
        self.rows: dict[Any, dict[Any, list[Any]]] = defaultdict(lambda: defaultdict(list))
        for row in problem["synapses"]:
            for pre, post, weight in zip(row["pre"], row["post"], row["weights"], strict=True):
                self.rows[row["from"], pre][self.core[row["to"]]].append((row["kind"], (row["to"], post), weight))
        used = len({group["tile"] for group in problem["groups"]})
        self.barrier = BARRIER[max(n for n in BARRIER if n <= used)]

    def play(self, query: dict[str, Any]) -> dict[str, Any]:
        """One query."""
        steps = self.problem["steps"]
        self.trains = {(group, i): train for group, i, train in query["trains"]}
        own = self.own | {(group, i): bias for group, i, bias in query["own_biases"]}
        self.bias = own | {(group, i): bias for group, i, bias, _ in query["biases"]}
        self.v = dict.fromkeys(self.neurons, 0.0) | {(group, i): v for group, i, _, v in query["biases"]}
        self.sums: dict[Any, float] = {}
        found: dict[str, Any] = defaultdict(list)
        for step in range(steps + self.problem["silent_steps"]):
            if step == steps:
                self.bias = own
            for name, value in self.step(step).items():
                found[name].append(value)
        found["packets"] = sum(found["packets"])
        found["detailed_time"], found["repeats"] = sum(found["sim_time"]), True
        return dict(found)

    def step(self, step: int) -> dict[str, Any]:
        """All neurons, then all messages."""
        told: dict[str, Any] = defaultdict(float, fired_neurons=[], packets=0, updated=0, fired=0, spikes=0, hops=0)
        told["dendrite_energy"] = 0.0
        sender: dict[Any, float] = defaultdict(float)
        receiver: dict[Any, float] = defaultdict(float)
        sums, self.sums = self.sums, {}
        for neuron in self.neurons:
            group, home = self.groups[neuron[0]], self.core[neuron[0]]
            if group["plays"]:
                train = self.trains.get(neuron, [])
                updated = fires = step < len(train) and bool(train[step])
            else:
                updated, fires = self.soma(neuron, group["attributes"], sums)
                told["soma_energy"] += (51.2 + 21.6 * updated + 69.3 * fires) * PJ
                sender[home] += (6.0 + 3.7 * updated + 30.0 * fires) * NS
                if fires:
                    told["fired_neurons"].append(list(neuron))
            told["updated"] += int(updated)
            told["fired"] += int(fires)
            for target, row in self.rows[neuron].items() if fires else ():
                self.send(told, home, target, row)
                sender[home] += 5.1 * NS * (not group["plays"] or self.problem["port_takes_time"])
                receiver[target] += 16 * NS + sum(SYNAPSE[kind][1] for kind, _, _ in row)
        told["total_energy"] = told["synapse_energy"] + told["soma_energy"] + told["network_energy"]
        told["sim_time"] = max(0.0, *sender.values(), *receiver.values()) + self.barrier
        return {name: told[name] for name in ("synapse_energy", "soma_energy", "network_energy", *told)}

    def soma(self, neuron: Any, attributes: dict[str, float], sums: dict[Any, float]) -> tuple[bool, bool]:
        """Whether it is updated, and whether it fires."""
        before, bias = self.v[neuron], self.bias.get(neuron, 0.0)
        v = int(before * attributes["leak_decay"] * 64) / 64 + bias + sums.get(neuron, 0.0)
        fires = v > attributes["threshold"]
        self.v[neuron] = 0.0 if fires else v
        return before != 0 or bias != 0 or neuron in sums or fires, fires

    def send(self, told: dict[str, Any], home: Any, target: Any, row: list[Any]) -> None:
        """A message and its synapses."""
        height = self.problem["rows"]
        across = abs(home[0] // height - target[0] // height), abs(home[0] % height - target[0] % height)
        told["packets"] += 1
        told["hops"] += sum(across)
        told["network_energy"] += (111.0 + 3.0 * across[0] + 4.2 * across[1]) * PJ
        told["spikes"] += len(row)
        for kind, neuron, weight in row:
            told["synapse_energy"] += SYNAPSE[kind][0]
            self.sums[neuron] = self.sums.get(neuron, 0.0) + weight


def main(problem: str, result: str) -> None:
    """As the worker."""
    chip = Chip(json.loads(Path(problem).read_text()))
    answers = [chip.play(query) for query in chip.problem["queries"]]
    Path(result).write_text(json.dumps({"version": "stand-in", "queries": answers}))


if __name__ == "__main__":
    main(*sys.argv[-2:])
