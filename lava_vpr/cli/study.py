"""``lava-vpr study``."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from lava_vpr.cli.common import (
    PATH,
    Numbers,
    RegisteredName,
    Values,
    console,
    encode_in_views,
    every_option,
    places_option,
    print_whole,
    progress_bar,
    stage,
)
from lava_vpr.cli.evaluate import command_line
from lava_vpr.cli.outputs import Outputs, write_json
from lava_vpr.cli.show.clusters import cluster_at, cluster_option
from lava_vpr.cli.show.learning import TERMINAL
from lava_vpr.config import PRESETS, Config
from lava_vpr.encoding import Keep
from lava_vpr.engine.threads import cores
from lava_vpr.errors import InputError
from lava_vpr.experiments.task import Route
from lava_vpr.inputs.views import STRAIGHT
from lava_vpr.learning.references import encode_route
from lava_vpr.learning.route import settings_of
from lava_vpr.matching.evaluation import truth_from_indices
from lava_vpr.storage.text import shown
from lava_vpr.studies.registry import STUDIES
from lava_vpr.studies.run import Studied, planned, run
from lava_vpr.studies.show.values import as_json, table
from lava_vpr.studies.study import Asked
from lava_vpr.training.door import check_references
from lava_vpr.traverse import Traverse, open_traverse, open_traverses


@click.command()
@click.argument("name", metavar="STUDY", type=RegisteredName(STUDIES))
@click.argument("references", nargs=-1, required=True, type=str, metavar="REFERENCE...")
@click.option("--query", required=True, type=str, help="The query images; image i shows place i.")
@places_option("Images A..B-1 of each REFERENCE and of the query (default: all).")
@every_option
@click.option("--preset", "preset_name", type=click.Choice(list(PRESETS)), default=None, help="Settings to start from.")
@click.option("--config", "config_file", type=PATH, default=None, metavar="FILE", help="Settings in TOML.")
@click.option(
    "--tolerance",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Places off that still count.",
)
@click.option(
    "--seeds",
    type=Numbers(least=0),
    default=(0, 1, 2),
    metavar="N,N,...",
    help="Seeds; each measures every point anew.  [default: 0,1,2]",
)
@click.option(
    "--values",
    type=Values(),
    default=(),
    metavar="X,X,...",
    help="Points to measure in place of the study's own: numbers of places, of neurons a place, bits, steps, places of "
    "a module, members.",
)
@click.option("--jobs", type=click.IntRange(1, 1024), default=None, help="Threads (default: all processors).")
@cluster_option
@click.option("--json", "json_path", type=PATH, default=None, metavar="FILE", help="Write the figures as JSON.")
@click.option("--report", "report_folder", type=PATH, default=None, metavar="DIR", help="Write DIR/study.html.")
@click.pass_context
def study(
    ctx: click.Context,
    name: str,
    references: tuple[str, ...],
    query: str,
    places: tuple[int, int] | None,
    every: float,
    preset_name: str | None,
    config_file: Path | None,
    tolerance: int,
    seeds: tuple[int, ...],
    values: tuple[float, ...],
    jobs: int | None,
    address: str | None,
    json_path: Path | None,
    report_folder: Path | None,
) -> None:
    """Say what one thing does to recall and cost: learn and ask the same images again and again, with several seeds.

    STUDY is one of: places, neurons, weighting (the steps of the paper's weighted decoder), bits, steps, seeds (noise),
    hyperactive (modules without hyperactive neurons), ensemble. Everything is learned from REFERENCE, one traverse or
    several, and asked the images of --query; no setting is chosen. docs/studies.md shows all of them on real images.
    """
    if len(set(seeds)) < len(seeds):
        raise click.UsageError("--seeds names a seed twice; give each once")
    page = report_folder and report_folder / "study.html"
    outputs = Outputs((json_path,), made=(page,), read=(config_file,), images=(*references, query))
    config = settings_of(preset_name, config_file, {})
    whole = [*open_traverses(references, every=every, events=config.events)]
    whole.append(open_traverse(query, every=every, events=config.events))
    outputs.spare(path for traverse in whole for path in traverse.paths)
    *learned, asked = [traverse.between(*places) if places else traverse for traverse in whole]
    check_references([len(traverse) for traverse in learned], references)
    if len(asked) != len(learned[0]):
        raise InputError(
            f"{shown(query)}: has {len(asked)} images for {len(learned[0])} places; image i of the query must show "
            "place i: choose with --places A:B, or give lists of matching images"
        )
    config, route = _route(learned, asked, config, tolerance)
    row, said = STUDIES[name], Asked(route, config, seeds, values)
    with cluster_at(address) as cluster, progress_bar(f"study {name}", len(planned(row, said))) as advance:
        found = run(row, said, jobs=jobs or cores(), cluster=cluster, command=command_line(ctx), advance=advance)
    _tell(found, json_path, page)


def _route(learned: list[Traverse], asked: Traverse, config: Config, tolerance: int) -> tuple[Config, Route]:
    """The images, read and encoded, and the settings that fit them."""
    kept = Keep.PATCHES | Keep.VECTORS
    config, standard, references = encode_route(learned, config, TERMINAL, keep=kept | Keep.THUMBNAILS)
    (queries,) = encode_in_views(asked, config.encoder, (STRAIGHT,), kept, standard)
    order = np.arange(len(queries))
    return config, Route(tuple(references), queries, truth_from_indices(order, order, tolerance), standard)


def _tell(found: Studied, json_path: Path | None, page: Path | None) -> None:
    """Write the files, then print the table: whoever reads it may go away."""
    if json_path is not None:
        write_json(json_path, as_json(found))
    if page is not None:
        # matplotlib takes a second to import: only those who want a report wait for it.
        from lava_vpr.report import write_page
        from lava_vpr.studies.show.page import page as page_of

        with stage("writing the report"):
            write_page(page_of(found), page)
    print_whole(table(found))
    if page is not None:
        console.print(f"report: {shown(page)}")
