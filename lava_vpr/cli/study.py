"""``lava-vpr study``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

from lava_vpr.cli.common import PATH, VALUES, RegisteredName, encode_in_views, progress_bar, whole_numbers
from lava_vpr.cli.nouns import WrittenFiles, every_option, jobs_option, places_option, results_options, tolerance_option
from lava_vpr.cli.outputs import Outputs, command_line
from lava_vpr.cli.show.clusters import cluster_option, pool_at
from lava_vpr.cli.show.headings import IMAGES, LEARNED, MEASURED, Headed, under
from lava_vpr.cli.show.learning import TERMINAL
from lava_vpr.config import PRESETS, Config
from lava_vpr.encoding import Keep
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import InputError, shown
from lava_vpr.experiments.task import Route
from lava_vpr.inputs.views import STRAIGHT
from lava_vpr.learning.references import encode_route
from lava_vpr.learning.route import settings_of
from lava_vpr.matching.evaluation import truth_from_indices
from lava_vpr.show.table import Table
from lava_vpr.studies.registry import STUDIES
from lava_vpr.studies.show.values import as_json, table
from lava_vpr.studies.study import StudyRequest, planned, study_rows
from lava_vpr.training.preparing import check_references
from lava_vpr.traverse import open_traverse, open_traverses


@click.command(cls=Headed)
@click.argument("name", metavar="STUDY", type=RegisteredName(STUDIES))
@click.argument("references", nargs=-1, required=True, type=str, metavar="REFERENCE...")
@under(
    IMAGES,
    click.option("--query", required=True, type=str, help="The query images; image i shows place i."),
)
@places_option("Images A..B-1 of each REFERENCE and of the query (default: all).")
@every_option
@under(
    LEARNED,
    click.option(
        "--preset", "preset_name", type=click.Choice(list(PRESETS)), default=None, help="Settings to start from."
    ),
    click.option("--config", "config_file", type=PATH, default=None, metavar="FILE", help="Settings in TOML."),
)
@under(
    MEASURED,
    tolerance_option,
    click.option(
        "--seeds",
        type=whole_numbers(0),
        default=(0, 1, 2),
        metavar="N,N,...",
        help="Seeds; every point is measured with each.  [default: 0,1,2]",
    ),
    click.option(
        "--values",
        type=VALUES,
        default=(),
        metavar="X,X,...",
        help="Points to measure instead of the study's own: numbers of places, of neurons a place, bits, steps, places "
        "of a module, members.",
    ),
)
@jobs_option
@cluster_option
@results_options("study.html")
@click.pass_context
def study(
    ctx: click.Context,
    name: str,
    references: tuple[str, ...],
    query: str,
    config_file: Path | None,
    seeds: tuple[int, ...],
    values: tuple[float, ...],
    jobs: int | None,
    address: str | None,
    results: WrittenFiles,
    **images: Any,
) -> list[Table]:
    """Measure what one setting does to recall and cost: learn and query the same images repeatedly, with several seeds.

    STUDY is one of: places, neurons, weighting (the steps of the paper's weighted decoder), bits, steps, seeds (noise),
    hyperactive (modules without hyperactive neurons), ensemble. Every model is learned from REFERENCE, one traverse or
    several, and tested on the images of --query; no setting is chosen. docs/studies.md shows all of them on real
    images.
    """
    if len(set(seeds)) < len(seeds):
        raise click.UsageError("--seeds names a seed twice; give each once")
    outputs, page = results.outputs("study.html", read=(config_file,), images=(*references, query))
    config = settings_of(images.pop("preset_name"), config_file, {})
    route, config = _route(references, query, config, outputs, **images)
    asked = StudyRequest(STUDIES[name], route, config, seeds, values, images["tolerance"])
    with pool_at(address, jobs) as pool, progress_bar(f"study {name}", len(planned(asked))) as advance:
        rows = study_rows(asked, pool=pool, advance=advance)

    def drawn() -> str:
        from lava_vpr.studies.show.page import page  # matplotlib takes a second to import

        return page(asked, rows, command_line(ctx))

    return results.show([table(asked, rows)], as_json(asked, rows), page, drawn)


def _route(
    references: tuple[str, ...],
    query: str,
    config: Config,
    outputs: Outputs,
    *,
    places: tuple[int, int] | None,
    every: float,
    tolerance: int,
) -> tuple[Route, Config]:
    """The images, read and encoded, and the settings that fit them; no output is one of them."""
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
    kept = Keep.PATCHES | Keep.VECTORS
    config, standard, seen = encode_route(learned, config, TERMINAL, keep=kept | Keep.THUMBNAILS, threads=cores())
    (queries,) = encode_in_views(asked, config.encoder, (STRAIGHT,), kept, standard)
    order = np.arange(len(queries))
    return Route(tuple(seen), queries, truth_from_indices(order, order, tolerance), standard), config
