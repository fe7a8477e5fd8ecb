"""Queries per second on this machine's processor, beside SAD and cosine on the same places, in turns within one run.

    LAVA_VPR_DATA=... python -m benchmarks.host_speed [--preset fast] [--rounds 15] [--presentations 5000]

Nordland, 100 summer places, winter queries; all cores. Ours is timed from input rates to match: spikes drawn, network
run, counts decoded; queries are repeated. SAD and cosine are timed in two forms each: what
`lava-vpr eval` computes (exact sums in float64), and the fastest plain way we know: absolute differences of bytes in a
compiled loop, and one product of float32 matrices, as ``bench --peers`` times them. Both are timed from patches, or
input rates, to match.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import encoded, learn, required
from benchmarks.speed import cpu_flags
from lava_vpr.bench.measure.child import batch, host_answer
from lava_vpr.bench.peers import cosine_answer, sad_answer
from lava_vpr.config import preset
from lava_vpr.encoding import query_rates
from lava_vpr.engine.threads import cores, share
from lava_vpr.inputs.encoded import Keep
from lava_vpr.matching import baselines
from lava_vpr.model import Model

Matches = NDArray[np.int64]
PLACES = (0, 100)
OURS = "lava-vpr, host engine"


def matchers(model: Model, presentations: int) -> tuple[dict[str, Callable[[], Matches]], int]:
    """Each matcher as a function that matches all queries, and how many these are."""
    winter, threads = encoded("winter", model.config.encoder), cores()
    times = -(-presentations // len(winter))
    rates = np.tile(query_rates(winter.activity, model.config), (times, 1))
    patches = np.tile(winter.kept(Keep.PATCHES, "SAD"), (times, 1, 1))
    known, answer = query_rates(model.activity, model.config), host_answer(model, model.config.seed)
    (sad, _), (cosine, _) = sad_answer(model, patches), cosine_answer(model, rates)

    def sad_of_bytes() -> Matches:
        return np.concatenate(share(sad, len(rates), threads))

    return {
        OURS: lambda: batch(answer, rates, threads),
        "SAD, exact (lava-vpr eval)": lambda: baselines.sad_distances(model.patches, patches).argmin(axis=1),
        "SAD, compiled, bytes": sad_of_bytes,
        "cosine, exact (lava-vpr eval)": lambda: baselines.cosine_similarities(known, rates).argmax(axis=1),
        "cosine, float32 matrix product": lambda: cosine(slice(None)),
    }, len(rates)


@click.command()
@click.option("--preset", "name", default="fast", show_default=True)
@click.option("--rounds", default=15, show_default=True)
@click.option("--presentations", default=5000, show_default=True, help="Queries of a round, at least.")
def main(name: str, rounds: int, presentations: int) -> None:
    """Print the queries per second of every matcher."""
    required("nordland")
    model = learn(PLACES, preset(name))
    every, n = matchers(model, presentations)
    matches = {key: run() for key, run in every.items()}  # compiled now
    if not np.array_equal(matches["SAD, exact (lava-vpr eval)"], matches["SAD, compiled, bytes"]):
        raise SystemExit("the two SADs match differently")
    seconds: dict[str, list[float]] = {key: [] for key in every}
    for _ in range(rounds):
        for key, run in every.items():
            began = time.perf_counter()
            run()
            seconds[key].append(time.perf_counter() - began)
    table = Table(
        title=f"preset {name}, {model.neurons} neurons, {model.config.network.steps} steps, {model.weight_bits} bits; "
        f"{n} queries a round, {rounds} rounds, {cores()} cores, vector instructions: {cpu_flags()}",
        title_justify="left",
    )
    table.add_column("queries per second")
    for column in ("fastest round", "median", "ours over it (median of turns)", "right places of 0:100"):
        table.add_column(column, justify="right")
    for key, taken in seconds.items():
        ratio = np.median(np.array(taken) / np.array(seconds[OURS]))
        right = np.mean(matches[key][: PLACES[1]] == np.arange(*PLACES))
        table.add_row(key, f"{n / min(taken):,.0f}", f"{n / np.median(taken):,.0f}", f"{ratio:.2f}", f"{right:.2f}")
    Console(highlight=False, width=120).print(table)


if __name__ == "__main__":
    main()
