"""``lava-vpr bench``."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lava_vpr.backends import registry
from lava_vpr.backends.asking import calibration_of
from lava_vpr.backends.rivals import chosen, kept_for
from lava_vpr.bench.request import Request
from lava_vpr.cli.choose import TruthOptions, truth_options
from lava_vpr.cli.common import RegisteredName, encode_queries, noun, one_bar
from lava_vpr.cli.models.season import applied, applied_option
from lava_vpr.cli.nouns import (
    Learning,
    OneSource,
    Queries,
    WrittenFiles,
    asking_options,
    queries_options,
    replay_option,
    results_options,
    seed_option,
)
from lava_vpr.cli.outputs import command_line
from lava_vpr.cli.show.clusters import cluster_option, pool_at
from lava_vpr.cli.show.headings import MEASURED, under
from lava_vpr.cluster.tasks import Pool
from lava_vpr.datasets.selecting import Selection
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.encoding import Keep
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import ConfigError
from lava_vpr.model import Model, as_integer, lif_model

if TYPE_CHECKING:
    from lava_vpr.bench.results import Bench

DEFAULT = registry.timed_by_default()


@click.command("bench", cls=OneSource)
@queries_options
@truth_options
@under(
    MEASURED,
    click.option(
        "--target",
        "targets",
        type=RegisteredName(BOARDS),
        multiple=True,
        help="Board whose costs to model (default: all); a model that does not fit this board is an error.",
    ),
    click.option(
        "--backend",
        "backends",
        type=RegisteredName(registry.BACKENDS),
        multiple=True,
        help=f"Backend to time on this machine (default: {', '.join(DEFAULT[:-1])} and {DEFAULT[-1]}).",
    ),
    click.option("--sweep", is_flag=True, help="Also search settings for the best recall at the least modelled cost."),
    click.option("--peers", is_flag=True, help="Also run other matchers on the same images."),
    click.option(
        "--limit",
        type=click.IntRange(min=1),
        default=None,
        metavar="N",
        help="Queries on which each backend is timed, from the first (default: all; fewer for slow ones).",
    ),
)
@asking_options
@applied_option
@replay_option
@seed_option
@cluster_option
@results_options("bench.html")
@click.pass_context
@noun("request", Request)
def bench(
    ctx: click.Context,
    asked: Queries,
    truth: TruthOptions,
    request: Request,
    season: Path | None,
    replay: Path | None,
    address: str | None,
    results: WrittenFiles,
) -> None:
    """Measure what a query costs: recall of QUERY by MODEL, time and memory on this machine, then modelled time and
    energy on each board.

    The correct places are given as for eval: without --gt or positions, query i shows place i. The output
    names what this machine lacks, such as a board or energy counters, and has all other figures.
    """
    if address is not None and not request.sweep:
        raise click.UsageError("--cluster shares the points of --sweep; all else measures this machine: add --sweep")
    learning = Learning(learn=False, season=season, replay=replay)
    outputs, page = results.outputs(
        "bench.html", read=(*truth.files, *learning.files), model=asked.model_path, images=(asked.query,)
    )
    # The cost model and what it needs take a second to import: --help does not wait for them.
    from lava_vpr.bench.run import recall_and_costs

    request = replace(request, asking=learning.replayed(request.asking))
    model, gains = applied(asked.model(request.asking), season)
    request = replace(request, applied=gains)
    _refuse(model, asked.model_path, request)
    route = Selection((asked.query,), asked.every)
    traverse, located, correct = truth.open(model, route, asked.places, outputs)
    kept = Keep.GREY | (kept_for(chosen(model, None)) if request.peers else Keep.NOTHING)
    queries, *further = encode_queries(traverse, model, request.asking, kept)
    calibration = calibration_of(model, Pool(cores()))
    request = replace(request, calibration=calibration, located=located, near=truth.near)
    costs = partial(recall_and_costs, model, traverse, queries, correct, further=further, command=command_line(ctx))
    with pool_at(address) as pool, one_bar() as begin:
        found = costs(replace(request, pool=pool), begin=begin)
    _tell(found, results, page)


def _refuse(model: Model, path: Path, request: Request) -> None:
    """Refuse, before any work is done, what was asked for by name and cannot be."""
    from lava_vpr.bench.sweep import sweepable
    from lava_vpr.deploy.bundle.deployment import plan_of

    if as_integer(model) is not None:
        lif_model(model, "bench", path, direct=True)
    reason = sweepable(model) if request.sweep else None
    if reason is not None:
        raise ConfigError(f"{path}: --sweep: {reason}")
    for name in request.targets:
        found = lif_model(model, BOARDS[name].title, path, direct=True)
        if not found.network.direct:  # the table from pixels to places has the cost of all others
            plan_of(found, BOARDS[name])
    for name in request.backends:
        registry.require(name, model)


def _tell(found: Bench, results: WrittenFiles, page: Path | None) -> None:
    """Write the files, then print the tables: whoever reads these may go away."""
    from lava_vpr.bench.show.json_values import as_json
    from lava_vpr.bench.show.terminal import on_terminal

    def drawn() -> str:
        from lava_vpr.bench.show.page import page as page_of  # matplotlib takes a second to be imported

        return page_of(found)

    results.show(on_terminal(found), as_json(found), page, drawn)
