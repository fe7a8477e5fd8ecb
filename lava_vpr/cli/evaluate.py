"""``lava-vpr eval``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import click

from lava_vpr.backends import registry as backends
from lava_vpr.backends.asking import Asking
from lava_vpr.backends.opening import calibration_of
from lava_vpr.backends.rivals import BASELINES, kept_for, missing
from lava_vpr.backends.rivals import chosen as rivals_of
from lava_vpr.cli.choose import TruthOptions, truth_options
from lava_vpr.cli.common import (
    PATH,
    OneSource,
    backend_progress,
    console,
    encode_queries,
    motion_option,
    noun,
    stage,
    stderr,
)
from lava_vpr.cli.outputs import write_json
from lava_vpr.cli.published.options import asked_places, benchmark_options
from lava_vpr.cli.show.clusters import cluster_option, pool_at
from lava_vpr.cli.show.command import command_line
from lava_vpr.cli.show.nouns import (
    Queries,
    WrittenFiles,
    answer_options,
    asking_options,
    queries_options,
    results_options,
)
from lava_vpr.cli.show.recall import print_table, print_trust
from lava_vpr.datasets.selecting import Benchmark
from lava_vpr.encoding import EncodedTraverse, Keep
from lava_vpr.model import Model
from lava_vpr.recognition import Comparison, Recognition, as_json, recognise
from lava_vpr.show.page import write_page
from lava_vpr.storage.text import shown
from lava_vpr.truth.alignment import PositionErrors


@dataclass(frozen=True)
class Compared:
    """What is compared, as the user says.

    Attributes:
        sequence: Consecutive queries that are matched together.
        rivals: Baselines; empty: all that the model allows.
        descriptors: Files with another method's descriptors of references and queries.
        motion: How the robot may move between images.
    """

    sequence: int
    rivals: tuple[str, ...]
    descriptors: tuple[Path, Path] | None
    motion: str


@click.command("eval", cls=OneSource)
@queries_options
@benchmark_options
@truth_options
@click.option(
    "--sequence", type=click.IntRange(min=1), default=1, show_default=True, help="Consecutive queries matched together."
)
@click.option(
    "--baseline",
    "rivals",
    type=click.Choice(list(BASELINES)),
    multiple=True,
    help="Baseline to compute (default: all that MODEL allows).",
)
@click.option(
    "--descriptors",
    type=(PATH, PATH),
    default=None,
    metavar="REF.npy QUERY.npy",
    help="Descriptors of another method, one row an image.",
)
@asking_options
@answer_options
@motion_option("any")
@cluster_option
@results_options("report.html")
@click.pass_context
@noun("compared", Compared)
def evaluate(
    ctx: click.Context,
    asked: Queries,
    benchmark: Benchmark,
    truth: TruthOptions,
    compared: Compared,
    asking: Asking,
    backend: str,
    seed: int | None,
    address: str | None,
    results: WrittenFiles,
) -> None:
    """Recognise the images of QUERY and print recall, precision and baselines.

    Without --gt or positions, query i shows place i, and both must be equally many. Where the model has positions and
    those of the queries are told, by --query-positions or their names, places within --radius metres are correct. With
    --dataset, QUERY is the folder that holds a benchmark dataset (lava-vpr datasets), and MODEL was trained with it.
    """
    if address is not None and backend != "host":
        raise click.UsageError(f"--cluster runs the backend host, not {backend}; leave one of the two out")
    route = benchmark.recognised(asked.query, asked.every, places=asked.places)
    read = (*truth.files, *(compared.descriptors or ()))
    outputs, page = results.outputs("report.html", read=read, model=asked.model_path, images=route.sources)
    model = asked.model(asking)
    backends.require(backend, model)
    truth = truth.for_route(route)
    traverse = truth.open(model, route.sources[0], asked_places(route, model, asked.places), route.every, outputs)
    located, correct = truth.known(model, traverse)
    names = rivals_of(model, compared.rivals or None)
    kept = kept_for(names) | (Keep.THUMBNAILS if page is not None else Keep.NOTHING)
    with pool_at(address) as pool:
        calibration = calibration_of(model, pool) if compared.sequence == asking.views == 1 else None
        how = Comparison(
            compared.sequence, names, compared.descriptors, page is not None, asking, compared.motion, calibration
        )
        queries, *further = encode_queries(traverse, model, asking.of(model), kept)
        with backend_progress(backend, len(queries)) as advance:
            running = partial(recognise, pool=pool, advance=advance)
            result = running(model, queries, correct, how, backend=backend, seed=seed, further=further)
    errors = None if located is None else PositionErrors(located, located.errors(result.matches), truth.near)
    if results.json_path is not None:  # files first: whoever reads the tables may go away
        write_json(results.json_path, as_json(model, result, errors))
    if page is not None:
        with stage("writing the report"):
            write_page(_page(ctx, model, queries, result, errors), page)
    _print(model, result, errors, compared, page)


def _print(
    model: Model, result: Recognition, errors: PositionErrors | None, compared: Compared, page: Path | None
) -> None:
    """Print the tables, and what they do not say."""
    print_table(model, result, compared.sequence)
    if errors is not None:
        console.print(errors.in_words())
    print_trust(result)
    if result.contradiction is not None:
        stderr.print(f"warning: {result.contradiction}")
    for name, reason in missing(model).items() if not compared.rivals else ():
        console.print(f"no {name}: {reason}")
    if page is not None:
        console.print(f"report: {shown(page)}")


def _page(
    ctx: click.Context, model: Model, queries: EncodedTraverse, result: Recognition, errors: PositionErrors | None
) -> str:
    """The page of what the command of ``ctx`` found."""
    # matplotlib takes a second to import: only those who want a report wait for it.
    from lava_vpr.report.build import report_data
    from lava_vpr.report.html import page

    sequence, seed = ctx.params["sequence"], ctx.params["seed"]
    return page(report_data(model, queries, result, command_line(ctx), sequence, seed, errors))
