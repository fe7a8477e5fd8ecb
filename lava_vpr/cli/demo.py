"""``lava-vpr demo`` and ``lava-vpr synth``: the built-in synthetic world."""

from __future__ import annotations

from pathlib import Path

import click

from lava_vpr import model as model_file
from lava_vpr.backends.asking import calibration_of
from lava_vpr.cli.choose import open_queries
from lava_vpr.cli.common import (
    PATH,
    Number,
    backend_progress,
    console,
    encode_queries,
    print_whole,
    progress_bar,
    seed_type,
    stage,
)
from lava_vpr.cli.outputs import Outputs, write_json
from lava_vpr.cli.show.learning import TERMINAL
from lava_vpr.cli.show.recall import MEANING, in_words, recall_table, trust_tables
from lava_vpr.cluster.tasks import Pool
from lava_vpr.encoding import Keep
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import shown
from lava_vpr.events.camera import WRITTEN
from lava_vpr.learning.route import Training
from lava_vpr.recognition import Comparison, as_json, recognise
from lava_vpr.report.build import report_data
from lava_vpr.report.html import page
from lava_vpr.show.page import write_page
from lava_vpr.synthetic.drives import EventDrive, write_drives
from lava_vpr.synthetic.world import CONDITIONS, METRES_PER_S, World, write_traverses
from lava_vpr.truth.alignment import aligned_truth

SPACING_M = 5.0
"""Metres between two places of `demo`: so near that ways to match them differ."""


@click.command()
@click.argument("folder", metavar="DIR", type=PATH)
@click.option(
    "--places", type=click.IntRange(2, 10_000), default=100, show_default=True, help="Places along the route."
)
@click.option("--seed", type=seed_type, default=0, show_default=True, help="Seed of the world.")
@click.option(
    "--metres",
    type=click.FloatRange(1, 1000),
    default=20.0,
    show_default=True,
    metavar="M",
    help="Metres between two places.",
)
@click.option(
    "--events",
    "end",
    type=click.Choice([end.strip(".") for end in WRITTEN]),
    is_flag=False,
    flag_value="h5",
    default=None,
    help="Write the events of a camera on the route, not images: DIR/reference_events.h5 and DIR/query_events.h5.",
)
@click.option(
    "--query-speed",
    type=Number(min=1, max=100),
    default=14.0,
    show_default=True,
    metavar="M/S",
    help=f"Speed of the query drive of --events; that of the reference is {METRES_PER_S:g} m/s.",
)
@click.option(
    "--query-condition",
    type=click.Choice(list(CONDITIONS)),
    default="winter",
    show_default=True,
    help="Season, light and weather of the query.",
)
def synth(
    folder: Path, places: int, seed: int, metres: float, end: str | None, query_speed: float, query_condition: str
) -> None:
    """Draw a synthetic route: DIR/reference in summer, DIR/query in winter.

    It also writes where and when each image was taken (reference_positions.csv and query_positions.csv), and the
    positions that a satellite receiver would report every second (reference.gpx and query.gpx). With --events, it
    writes the positions of the vehicle ten times a second.
    """
    conditions = ("summer", query_condition)
    if end is not None:
        world = World(seed=seed, places=places, spacing_m=metres)
        drives = [EventDrive(world, conditions[0]), EventDrive(world, conditions[1], query_speed)]
        with progress_bar("driving", sum(len(drive.way()[0]) for drive in drives)) as advance:
            counts = write_drives(folder, drives, f".{end}", advance=advance)
        for kind, count in zip(("reference", "query"), counts, strict=True):
            console.print(f"{count:,} events: {shown(folder / f'{kind}_events.{end}')}")
        return
    with progress_bar("drawing", 2 * places) as advance:
        write_traverses(folder, places, seed, conditions, spacing_m=metres, drawn=lambda: advance(1))
    console.print(f"{places} places: {shown(folder / 'reference')}, {shown(folder / 'query')}")


@click.command()
@click.option(
    "--out", type=PATH, default=Path("demo"), show_default=True, metavar="DIR", help="Folder for the results."
)
def demo(out: Path) -> None:
    """Draw a synthetic route, learn it in summer, recognise it in winter, write a report."""
    results = out / "model.lvpr", out / "figures.json", out / "report" / "report.html"
    outputs = Outputs(made=results)
    # What only an earlier demo can have left is replaced; a single one of these files may be someone's own.
    earlier = all(path.is_file() for path in results)
    kept = ("model.lvpr", "figures.json", "report") if earlier else ()
    with progress_bar("drawing", 200) as advance:
        write_traverses(out, 100, 0, keep=kept, spacing_m=SPACING_M, drawn=lambda: advance(1))
    drawn = f"{shown(out / 'reference')}, {shown(out / 'query')}"
    console.print(f"drew 100 places, {SPACING_M:.0f} m apart, in summer and winter: {drawn}")
    learned = Training((out / "reference",)).learn(Pool(cores()), TERMINAL)
    model = learned.model
    console.print(
        f"learned them in {learned.took} with {model.neurons} neurons and "
        f"{model.weight_bits}-bit weights: {shown(out / 'model.lvpr')}",
    )
    traverse = open_queries(model, str(out / "query"), None, 1.0, outputs)
    queries, *_ = encode_queries(traverse, model, keep=Keep.ALL)
    comparison = Comparison(motion="any", calibration=calibration_of(model))
    with backend_progress("host", len(queries)):
        result = recognise(model, queries, aligned_truth(model, traverse), comparison, pool=Pool(cores()))
    table = recall_table(model, result, details="in the report")
    for said in (in_words(result), MEANING, table, *trust_tables(result)):
        print_whole(said)
    with stage("writing the report"):
        write_page(page(report_data(model, queries, result, "lava-vpr demo", 1, None)), results[-1])
    write_json(out / "figures.json", as_json(model, result))
    model_file.save(model, out / "model.lvpr")  # all three in a moment: see above
    console.print(f"report to open in a browser: {shown(results[-1])}")
