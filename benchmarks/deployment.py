"""How long a deployment takes, and how fast a bundle's simulation runs beside the host engine, in one run.

    LAVA_VPR_DATA=... python -m benchmarks.deployment [--queries N] [--rounds N]

For 100 and 500 places on Kapoho Bay: seconds to partition the network and to write the bundle (picture included), and
steps per second of the simulation and of the host engine, each on one thread, in turns; spikes are drawn in both.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import encoded, learn, part, required
from lava_vpr.config import preset
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.bundle.deployment import deploy, plan_of
from lava_vpr.deploy.bundle.targets import TARGETS
from lava_vpr.encoding import query_rates16
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.errors import InputError
from lava_vpr.model import integer_model

console = Console(highlight=False, width=110)


def row(places: int, queries: int, rounds: int) -> list[str]:
    """The cells of the table's row for a map of ``places``: times and speeds.

    Raises:
        InputError: the simulation does not give the host's counts.
    """
    model = integer_model(learn((0, places), preset("loihi")), "Kapoho Bay")
    network = model.network
    started = time.perf_counter()
    plan = plan_of(model, KAPOHO_BAY)
    planned = time.perf_counter() - started
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        bundle = deploy(model, KAPOHO_BAY, Path(folder) / "bundle").bundle
        written = time.perf_counter() - started
    images = part(encoded("winter", model.config.encoder), slice(0, queries))
    rates = query_rates16(images.activity, model.config.encoder)
    keys = presentation_keys(model.config.seed, "query", image_keys(rates))
    play, steps = TARGETS[bundle.target].player(bundle), len(rates) * network.interval
    exc, _, _ = play(rates, keys)
    counts, _, _ = fixed.count_spikes(network, rates, keys)
    if not np.array_equal(exc.sum(axis=1), counts):
        raise InputError(f"{places} places: the simulation of the bundle differs from the host")
    taken: list[tuple[float, float]] = []
    for _ in range(rounds):
        begin = time.perf_counter()
        play(rates, keys)
        middle = time.perf_counter()
        fixed.count_spikes(network, rates, keys)
        taken.append((middle - begin, time.perf_counter() - middle))
    simulated, host = (min(values) for values in zip(*taken, strict=True))
    size = sum(len(data) for data in bundle.files.values())
    figures = (f"{planned:.2f}", f"{written:.2f}", f"{size / 1e6:.1f}", f"{steps / simulated:,.0f}")
    return [f"{places}", f"{len(plan.cores)}", *figures, f"{steps / host:,.0f}", f"{host / simulated:.3f}"]


@click.command()
@click.option("--queries", default=50, show_default=True, help="Real queries a round.")
@click.option("--rounds", default=5, show_default=True, help="Rounds, of which the fastest counts.")
def main(queries: int, rounds: int) -> None:
    """Print how long deployments take and how fast their simulation runs."""
    required("nordland")
    table = Table(title="Kapoho Bay, default preset", title_justify="left")
    names = ("places", "cores", "partition s", "whole deploy s", "MB", "bundle steps/s", "host steps/s", "ratio")
    for name in names:
        table.add_column(name, justify="right")
    for places in (100, 500):
        table.add_row(*row(places, queries, rounds))
    console.print(table)


if __name__ == "__main__":
    main()
