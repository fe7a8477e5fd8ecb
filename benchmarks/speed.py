"""How fast a section trains and a query is answered on this machine, on real images.

    LAVA_VPR_DATA=... python -m benchmarks.speed [--other CHECKOUT [--rounds 15]]

Kernels are compiled first. One thread; processor time, which other programs on the machine do not inflate much, and the
median of several runs. Drawing the input spikes is part of both; reading and encoding an image is printed apart.
What ``--other`` names is a checkout of another version, whose host engine takes turns with this one's instead.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from benchmarks.nordland import encoded, folder, learn, part, required
from benchmarks.versions.beside import beside
from lava_vpr.config import preset
from lava_vpr.encoding import activity_of, query_rates
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.errors import LavaVprError
from lava_vpr.inputs.patches import patch_normalised
from lava_vpr.model import decode, integer_model
from lava_vpr.training.loop import train
from lava_vpr.traverse import open_traverse

console = Console(highlight=False, width=118)


def seconds(run: Callable[[], object], repeats: int = 7) -> float:
    """Median processor time of ``run``, after one run that compiles."""
    run()
    times = []
    for _ in range(repeats):
        started = time.process_time()
        run()
        times.append(time.process_time() - started)
    return statistics.median(times)


def cpu_flags() -> str:
    """The widest vector instructions of this processor, which decide most of the speed."""
    try:
        with open("/proc/cpuinfo") as file:
            flags = next((line for line in file if line.startswith("flags")), "").split()
    except OSError:
        return "unknown"
    return next((name for name in ("avx512f", "avx2", "avx") if name in flags), "none")


@click.command()
@click.option("--other", type=click.Path(exists=True, file_okay=False, resolve_path=True, path_type=Path))
@click.option("--rounds", default=15, show_default=True, help="Turns with the other checkout.")
def main(other: Path | None, rounds: int) -> None:
    """Print how fast a section trains and a query is answered; or the host engine beside another checkout's."""
    required("nordland")
    if other is not None:
        try:
            console.print(f"vector instructions: {cpu_flags()}", beside(other, rounds), sep="\n")
        except LavaVprError as error:
            raise click.ClickException(str(error)) from None
        return
    config = preset("loihi")
    summer, winter = encoded("summer", config.encoder), encoded("winter", config.encoder)
    section = part(summer, slice(0, 100))
    table = Table(title=f"one thread, vector instructions: {cpu_flags()}", title_justify="left")
    table.add_column("")
    table.add_column("", justify="right")
    table.add_row("train a section of 100 places", f"{seconds(lambda: train([section], config)):.2f} s")
    for places in (100, 500):
        model = learn((0, places), config)
        network = integer_model(model, "the host engine").network
        rates = query_rates(winter.activity, config)
        keys = presentation_keys(0, "query", image_keys(rates))
        counts, events, _ = fixed.count_spikes(network, rates, keys)
        each = seconds(lambda n=network, r=rates, k=keys: fixed.count_spikes(n, r, k)) / len(winter)
        table.add_row(
            f"queries, {places} neurons, {network.steps} steps, {network.bits} bits", f"{1 / each:,.0f} per second"
        )
        decoding = seconds(lambda m=model, c=counts: decode(m, c, "contrast")) / len(winter)
        table.add_row(f"  decoding, {places} places", f"{1e6 * decoding:.1f} us per query")
        table.add_row("  synaptic operations", f"{events['synaptic_operations'] / len(winter):,.0f} per query")
    images = list(part_images())
    patch = seconds(lambda: [patch_normalised(image) for image in images], 3) / len(images)
    table.add_row("patch normalisation (SAD only)", f"{1e3 * patch:.2f} ms per image")
    patches = [patch_normalised(image) for image in images]
    channels = seconds(lambda: [activity_of(i, config.encoder, p) for i, p in zip(images, patches, strict=True)], 3)
    table.add_row("orientation channels", f"{1e3 * channels / len(images):.2f} ms per image")
    console.print(table)


def part_images() -> list:
    """The first 100 summer images."""
    return list(open_traverse(folder("summer"), places=(0, 100)).images())


if __name__ == "__main__":
    main()
