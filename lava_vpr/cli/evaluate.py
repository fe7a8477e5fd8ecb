"""``lava-vpr eval``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, repeat
from pathlib import Path

import click
import numpy as np
from click.core import ParameterSource
from numpy.typing import NDArray

from lava_vpr import __version__
from lava_vpr.backends import registry as backends
from lava_vpr.backends.asking import calibration_of
from lava_vpr.backends.rivals import BASELINES, chosen as rivals_of, kept_for, missing
from lava_vpr.cli.choose import TruthOptions, truth_options
from lava_vpr.cli.common import PATH, backend_progress, encode_queries, motion_option, noun, off_map_option, stderr
from lava_vpr.cli.nouns import (
    Learning,
    OneSource,
    Queries,
    WrittenFiles,
    answer_options,
    asking_options,
    benchmark_options,
    queries_options,
    results_options,
    season_option,
    skip_option,
)
from lava_vpr.cli.outputs import command_line
from lava_vpr.cli.show.clusters import cluster_option, pool_at
from lava_vpr.cli.show.headings import COMPARED, TOGETHER, under
from lava_vpr.cli.show.recall import MEANING, in_words, recall_table, trust_tables
from lava_vpr.datasets.selecting import Benchmark, Selection
from lava_vpr.encoding import EncodedTraverse, Keep
from lava_vpr.matching.evaluation import leaps
from lava_vpr.matching.forward_filter import FASTEST, NONE
from lava_vpr.model import Model
from lava_vpr.recognition import Comparison, Recognition, as_json, recognise, seeds_as_json
from lava_vpr.show.table import Table
from lava_vpr.traverse import Traverse
from lava_vpr.truth.alignment import PositionErrors


@click.command("eval", cls=OneSource)
@queries_options
@skip_option
@benchmark_options
@truth_options
@under(
    TOGETHER,
    click.option(
        "--sequence",
        type=click.IntRange(min=1),
        default=1,
        show_default=True,
        help="Consecutive queries matched together.",
    ),
)
@under(
    COMPARED,
    click.option(
        "--baseline",
        "rivals",
        type=click.Choice(list(BASELINES)),
        multiple=True,
        help="Baseline to compute (default: all that MODEL allows).",
    ),
    click.option(
        "--descriptors",
        type=(PATH, PATH),
        default=None,
        metavar="REF.npy QUERY.npy",
        help="Descriptors of another method, one row an image.",
    ),
)
@asking_options
@season_option
@answer_options
@click.option(
    "--seeds",
    type=click.IntRange(1, 1000),
    default=1,
    show_default=True,
    metavar="N",
    help="Repeat with N seeds of the spikes' noise, from --seed on, and also print mean, minimum and maximum; "
    "for several models: lava-vpr study seeds.",
)
@motion_option("any", "or none if the queries are no drive; the default of query is none")
@off_map_option
@cluster_option
@results_options("report.html")
@click.pass_context
@noun("compared", Comparison)
def evaluate(
    ctx: click.Context,
    asked: Queries,
    skip_unreadable: bool,
    benchmark: Benchmark,
    truth: TruthOptions,
    compared: Comparison,
    learning: Learning,
    backend: str,
    seed: int | None,
    seeds: int,
    address: str | None,
    results: WrittenFiles,
) -> None:
    """Recognise the images of QUERY and print recall, precision and baselines.

    Without --gt or positions, query i shows place i, and their numbers must be equal. If the model has positions and so
    have the queries, by --query-positions or their names, places within --radius metres are correct. With --dataset,
    QUERY is the folder that holds a benchmark dataset (lava-vpr datasets), and MODEL was trained with it.
    """
    if address is not None and backend != "host":
        raise click.UsageError(f"--cluster runs the backend host, not {backend}; leave one of the two out")
    route = benchmark.recognised(asked.query, asked.every, places=asked.places, skip_unreadable=skip_unreadable)
    read = (*truth.files, *(compared.descriptors or ()), *learning.files)
    inputs = {"read": read, "model": asked.model_path, "images": route.sources}
    outputs, page = results.outputs("report.html", learning.gains, **inputs)
    compared = replace(compared, asking=learning.of(compared.asking))
    model = asked.model(compared.asking)
    backends.require(backend, model)
    truth = truth.for_route(route)
    traverse, located, correct = truth.open(model, route, asked.places, outputs, skip_unreadable)
    compared = replace(compared, motion=_motion(ctx, compared, route, correct))
    asked_with = range(first := model.config.seed if seed is None else seed, first + seeds)
    queries, found = _recognised(model, traverse, correct, compared, results.drawn, address, backend, asked_with)
    learning.keep(model, (result := found[0]).used)
    errors = None if located is None else PositionErrors(located, located.errors(result.matches), truth.near)
    values = {**_named(asked, route), **as_json(model, result, errors)}
    values |= {"seeds": seeds_as_json(asked_with, found)} if seeds > 1 else {}
    said = _said(model, found, errors, compared)
    results.show(said, values, page, partial(_page, ctx, model, queries, result, errors))


def _recognised(
    model: Model,
    traverse: Traverse,
    correct: NDArray[np.bool_],
    compared: Comparison,
    drawn: bool,
    address: str | None,
    backend: str,
    seeds: Sequence[int],
) -> tuple[EncodedTraverse, list[Recognition]]:
    """The queries of ``traverse``, and what ``model`` makes of them with each seed; what is ``drawn`` is the first's.

    Of further seeds, baselines that depend on no noise are left out.
    """
    names = rivals_of(model, compared.rivals or None)
    kept = kept_for(names) | (Keep.THUMBNAILS | Keep.GREY if drawn else Keep.NOTHING)
    with pool_at(address) as pool:
        calibration = calibration_of(model, pool) if compared.sequence == compared.asking.views == 1 else None
        how = replace(compared, rivals=names, keep_scores=drawn, calibration=calibration)
        queries, *further = encode_queries(traverse, model, how.asking, kept)
        again = replace(how, rivals=[name for name in names if name == "template"], keep_scores=False, descriptors=None)
        with backend_progress(backend, len(seeds) * len(queries)) as advance:
            running = partial(recognise, pool=pool, advance=advance, backend=backend, further=further)
            ways = chain([how], repeat(again))
            return queries, [
                running(model, queries, correct, way, seed=seed) for way, seed in zip(ways, seeds, strict=False)
            ]


def _named(asked: Queries, route: Selection) -> dict[str, str]:
    """Who found the figures, and of what: names without folders."""
    return {"model": asked.model_path.name, "query": Path(route.sources[0]).name, "version": __version__}


def _motion(ctx: click.Context, compared: Comparison, route: Selection, correct: NDArray[np.bool_]) -> str:
    """How the robot may have moved: the user's choice, or none, which is reported, if the queries are no drive."""
    chosen = ctx.get_parameter_source("motion") is not ParameterSource.DEFAULT
    drive = (route.opened is None or route.opened.dataset.route) and not leaps(correct, FASTEST)
    if chosen or drive or compared.sequence > 1:
        return compared.motion
    stderr.print(
        "note: the queries do not follow the order of the map, so each is answered alone; --motion any filters them as "
        "a drive"
    )
    return NONE


def _said(
    model: Model, found: Sequence[Recognition], errors: PositionErrors | None, compared: Comparison
) -> Iterator[Table | str]:
    """The tables, and what they do not say."""
    result, *again = found
    yield from (in_words(result, compared.sequence, len(found)), MEANING)
    yield recall_table(model, result, compared.sequence, again)
    if errors is not None:
        yield errors.in_words()
    yield from trust_tables(result)
    if result.contradiction is not None:
        stderr.print(f"warning: {result.contradiction}")
    yield from (f"no {name}: {reason}" for name, reason in missing(model).items() if not compared.rivals)


def _page(
    ctx: click.Context, model: Model, queries: EncodedTraverse, result: Recognition, errors: PositionErrors | None
) -> str:
    """The page of what the command of ``ctx`` found."""
    # matplotlib takes a second to import: only those who want a report wait for it.
    from lava_vpr.report.build import report_data
    from lava_vpr.report.html import page

    sequence, seed = ctx.params["sequence"], ctx.params["seed"]
    return page(report_data(model, queries, result, command_line(ctx), sequence, seed, errors))
