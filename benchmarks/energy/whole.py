"""All the energy of a query: every preset on Kapoho Bay with its host, on a processor alone, and cosine, HOG and SAD.

    LAVA_VPR_DATA=... python -m benchmarks.energy.whole [--rounds 5]

Nordland, summer learned, winter recognised, exact matches, seed 0. Recall is the mean of five sections of 100 places,
energy that of the first. What the board takes is modelled; what the processor does is timed here, single queries on one
thread, and multiplied by an assumed power. All take turns, and the quickest round counts: other programs only delay.
"""

from __future__ import annotations

from collections.abc import Callable

import click
import numpy as np
from rich.console import Console

from benchmarks.nordland import SECTIONS, answer, encoded, folder, learn, part, required
from lava_vpr.backends.host import HostBackend
from lava_vpr.bench.energy import Way, on_board
from lava_vpr.bench.measure import alone
from lava_vpr.bench.measure.timing import each_image, measure_encoding
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.bench.show.energy import table
from lava_vpr.config import PRESETS, preset
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.cost.costs import Modelled, modelled
from lava_vpr.deploy.cost.events import count_events
from lava_vpr.inputs.hog import hog
from lava_vpr.inputs.patches import patch_normalised
from lava_vpr.traverse import open_traverse

RIVALS = ("cosine", "hog", "sad")
INTEGER = tuple(name for name in PRESETS if name != "paper")


def recalls(name: str) -> dict[str, float]:
    """R@1 of preset ``name`` (under its own name) and of the baselines, mean over the sections."""
    found: dict[str, list[float]] = {}
    for section in SECTIONS:
        result = answer(learn(section, preset(name)), section, rivals=RIVALS, keep_scores=False)
        for matcher in (result.default, *RIVALS):
            own = name if matcher == result.default else matcher
            found.setdefault(own, []).append(result.metrics[matcher].recall_at_1)
    return {matcher: float(np.mean(values)) for matcher, values in found.items()}


def asked(name: str) -> tuple[QuerySet, Modelled]:
    """The queries of the first section to preset ``name``, and what they cost on Kapoho Bay."""
    model = learn(SECTIONS[0], preset(name))
    queries = QuerySet.of(model, part(encoded("winter", model.config.encoder), slice(*SECTIONS[0])))
    trains = HostBackend(1).trains(model, queries.shown)
    plan = plan_of(model, KAPOHO_BAY)
    return queries, modelled(plan, count_events(plan, trains))


def quickest(timed: dict[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """The least of the medians of each, in ms; they take turns."""
    best = dict.fromkeys(timed, np.inf)
    for _ in range(rounds):
        for key, run in timed.items():
            best[key] = min(best[key], run())
    return best


@click.command()
@click.option("--rounds", default=5, show_default=True)
def main(rounds: int) -> None:
    """Print the table: what a query costs in all, by preset and matcher."""
    required("nordland")
    first, images = INTEGER[0], open_traverse(folder("winter"), places=SECTIONS[0])
    found = {name: recalls(name) for name in INTEGER}
    every = {name: asked(name) for name in INTEGER}
    timed: dict[str, Callable[[], float]] = {
        "encoding": lambda: float(np.median(measure_encoding(images, preset(first)).milliseconds)),
        "descriptors": lambda: float(np.median(each_image(images, hog))),
        "patches": lambda: float(np.median(each_image(images, patch_normalised))),
        "cosine": lambda: alone.cosine(every[first][0]),
        "hog": lambda: alone.hog(every[first][0]),
        "sad": lambda: alone.sad(every[first][0]),
    }
    for name, (queries, _) in every.items():
        timed[f"{name}, part"] = lambda queries=queries: alone.beside_board(queries)  # type: ignore[misc]
        timed[f"{name}, host"] = lambda queries=queries: alone.host(queries)  # type: ignore[misc]
    ms = quickest(timed, rounds)
    boards, alone_titles = [], [f"{name}, no board" for name in every]
    for name, (_, costs) in every.items():
        way = on_board(costs, found[name][name], ms[f"{name}, part"], ms["encoding"])
        if way is None:
            raise SystemExit(f"{name}: {costs.unavailable}")
        boards.append(way)
    ways = [Way("host", found[name][name], ms[f"{name}, host"], ms["encoding"]) for name in every]
    before = {"cosine": "encoding", "hog": "descriptors", "sad": "patches"}
    ways += [Way(name, found[first][name], ms[name], ms[before[name]]) for name in RIVALS]
    console = Console(highlight=False, width=220)
    console.print(table(boards, [f"{name}, Kapoho Bay" for name in every]).terminal())
    console.print(table(ways, [*alone_titles, "cosine", "HOG", "SAD"]).terminal())


if __name__ == "__main__":
    main()
