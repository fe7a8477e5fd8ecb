"""Made-up results of `lava-vpr bench`.

Used by bench, project.
"""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import numpy as np

from lava_vpr.bench.results import (
    AnsweringWay,
    Bench,
    BoardFigures,
    Measured,
    Modelled,
    OnMap,
    Peer,
    StepTimes,
    SweepPoint,
    Workload,
    on_board,
)
from lava_vpr.bench.show.terminal import on_terminal
from lava_vpr.cli.common import PlainConsole
from lava_vpr.deploy.boards.constants import Estimate
from lava_vpr.matching.answers import Answers, Together
from lava_vpr.matching.evaluation import Metrics, evaluate
from lava_vpr.matching.trust import Trust, trust
from lava_vpr.positions.frames import Positions
from lava_vpr.truth.alignment import Located, PositionErrors


def metrics(wrong: int = 2) -> Metrics:
    """Of ten queries, so many of them wrong."""
    scores = np.eye(10) + 0.01
    scores[:wrong] = np.roll(scores[:wrong], 1, axis=1)
    return evaluate(scores, np.linspace(0, 1, 10), np.eye(10, dtype=np.bool_))


def probabilities() -> Trust:
    """Of ten queries, two of them wrong and unsure."""
    sure = np.linspace(0.1, 1, 10)
    return trust(Answers(np.arange(10), sure, sure), np.eye(10, dtype=np.bool_), Together(motion="any"))


def on_map() -> OnMap:
    """Ten queries five metres beside their places, two of them matched elsewhere."""
    places = np.stack([20.0 * np.arange(10), np.zeros(10)], axis=1)
    located = Located(Positions(places, "xy"), Positions(places + np.array([0.0, 5.0]), "xy"))
    matches = np.array([4, 3, *range(2, 10)])
    errors = PositionErrors(located, located.errors(matches), 25.0)
    return OnMap(errors, matches, matches == np.arange(10))


FIGURES = BoardFigures(
    dynamic_by_component={
        "synapses": Estimate(0.71, 1.07, 1.07),
        "neurons": Estimate(1.5, 1.6, 2.4),
        "spikes": Estimate(0.002, 0.002, 0.002),
        "messages": Estimate(0.005, 0.34, 0.34),
        "hops": Estimate(0.0045, 0.0054, 0.0054),
        "clearing": Estimate(0.01, 0.02, 0.2),
    },
    milliseconds=Estimate(0.15, 0.23, 0.41),
    step_microseconds=Estimate(1.8, 2.2, 5.8),
    static_millijoules=Estimate(0.013, 0.078, 0.11),
    wall_static_millijoules=Estimate(0.013, 1.078, 7.11),
    io_milliseconds_by_way={"injected": Estimate(1.0, 13.9, 20.0), "bias": Estimate(0.1, 2.0, 4.0)},
    io_microjoules_by_way={"injected": Estimate(0.1, 0.1, 0.2), "bias": Estimate(5.0, 6.1, 8.0)},
    wall_milliseconds=Estimate(1.0, 13.9, 20.0),
    busiest={"receive": 0.25, "neurons": 0.75},
    embedded={},
)
"""Kapoho Bay's energies and times."""


def modelled(**changes: Any) -> Modelled:
    """Kapoho Bay's costs of a query."""
    values: dict[str, Any] = {
        "target": "kapoho-bay",
        "chips": 2,
        "cores": 3,
        "tiles": 1,
        "steps": 53,
        "input_mode": "injected",
        "counts": {"synaptic_operations": 30211.25, "neuron_updates": 20600.5, "input_spikes": 1000.0, "steps": 53.0}
        | {"exc_spikes": 14.2, "inh_spikes": 14.2, "messages": 3042.4, "hops": 1812.0, "accesses": 42400.0},
        "figures": FIGURES,
        "clearing": {"mechanism": "embedded writes", "writes": 100, "microjoules": Estimate(0.01, 0.02, 0.2)},
        "assumptions": ("Every message pays for its own <packet>.",),
    }
    return Modelled(**values | changes)


def ways() -> tuple[AnsweringWay | None, ...]:
    """Kapoho Bay, a board without energies, the host engine, and cosine."""
    second = Modelled("loihi2", 1, 1, None, 53, "injected", unavailable="no energy is public")
    boards = (on_board(modelled(), 0.8, 0.03, 0.7), on_board(second, 0.8, 0.03, 0.7))
    return (*boards, AnsweringWay("host", 0.8, 0.1, 0.7), AnsweringWay("cosine", 0.9, 0.015, 0.7))


def bench(**changes: Any) -> Bench:
    """A complete run, all made up."""
    rng = np.random.default_rng(3)
    times = {"host": 0.11, "lava-fused": 1.3, "lava-fixed": 180.0, "bundle": 26.0}
    measured = tuple(
        Measured(
            name,
            "from rates to spike counts",
            queries=200,
            threads=2,
            queries_per_second=900 / centre,
            milliseconds=tuple(np.sort(centre * np.exp(0.2 * rng.standard_normal(200)) + 0.01 * centre)),
            peak_bytes=210_000_000,
            no_energy="this processor has no RAPL counters",
        )
        for name, centre in times.items()
    )
    candidates = []
    for k in range(40):
        steps, spikes = int(rng.choice([30, 50, 100, 200])), float(rng.choice([6, 10, 20]))
        energy = 0.02 * steps + 0.03 * spikes + 0.3 * rng.random()
        wrong = int(np.clip(7 - 1.5 * np.log(energy) - rng.random() * 3, 0, 9))
        settings = {"steps": steps, "weight_bits": 2, "query_spikes": spikes, **({"stop_margin": 1.0} if k % 5 else {})}
        candidates.append(
            SweepPoint(settings, metrics(wrong), energy, steps / 400, steps + 3.0, 9 * energy, front=k % 9 == 0)
        )
    candidates[9] = replace(candidates[9], chosen="fast")
    candidates[18] = replace(candidates[18], chosen="this model")
    second = Modelled("loihi2", 1, 1, None, 53, "injected", counts=modelled().counts)
    values: dict[str, Any] = {
        "model": {"places": 10, "neurons": 10, "weight_bits": 2, "steps": 50, "preset": "loihi", "decoder": "contrast"},
        "machine": {"processor": "Some & Sons <CPU>", "cores": 2, "python": "3.10.20"},
        "images": 10,
        "recall": metrics(),
        "measured": (*measured, Measured("kapoho-bay", "", absent="NxSDK is not installed")),
        "targets": {
            "kapoho-bay": modelled(),
            "loihi2": replace(second, unavailable="no energy per operation of Loihi 2 is public"),
        },
        "workload": Workload(98_000, 78_400, 0.58, 0.981, 1e5, 0.0, 3e4, 2.06e4),
        "peers": (
            Peer("sad", "sum of absolute differences (the paper's baseline)", metrics(5), 81_000.0, 2, 78_400, 10),
        ),
        "sweep": tuple(candidates),
        "events": {"synaptic_operations": 30211.25, "input_spikes": 1000.0},
        "step_times": {"kapoho-bay": StepTimes(*(tuple(x + 0.3 * rng.random(53)) for x in (1, 0.7, 1.1, 2)), 0.6)},
        "command": "lava-vpr bench m.lvpr query --sweep",
        "energy": tuple(way for way in ways() if way is not None),
        "trust": {"single": probabilities()},
        "on_map": on_map(),
    }
    return Bench(**values | changes)


def printed(found: Bench) -> str:
    """What the terminal shows of a result."""
    console = PlainConsole(width=220, record=True, file=io.StringIO())
    for item in on_terminal(found):
        console.print(item if isinstance(item, str) else item.terminal())
    return console.export_text()
