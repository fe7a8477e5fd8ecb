"""``lava-vpr bench``."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lava_vpr.backends import registry as backends
from lava_vpr.backends.asking import Asking
from lava_vpr.backends.opening import calibration_of, open_model
from lava_vpr.backends.rivals import chosen, kept_for
from lava_vpr.cli.choose import TruthOptions, truth_options
from lava_vpr.cli.common import (
    PATH,
    OneSource,
    RegisteredName,
    asking_options,
    console,
    encode_queries,
    every_option,
    places_option,
    print_whole,
    progress_bar,
    seed_type,
    stage,
)
from lava_vpr.cli.evaluate import command_line
from lava_vpr.cli.outputs import Outputs, write_json
from lava_vpr.cli.show.clusters import cluster_at, cluster_option
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.encoding import Keep
from lava_vpr.engine.threads import cores
from lava_vpr.errors import ConfigError
from lava_vpr.model import Model, integer_model
from lava_vpr.storage.text import shown

if TYPE_CHECKING:
    from lava_vpr.bench.results import Bench

DEFAULT = backends.timed_by_default()


@click.command("bench", cls=OneSource)
@click.argument("model_path", metavar="MODEL", type=PATH)
@click.argument("query", type=str)
@places_option("Query images A..B-1 (default: the model's own range).")
@every_option
@truth_options
@click.option(
    "--target",
    "targets",
    type=RegisteredName(BOARDS),
    multiple=True,
    help="Board whose costs to model (default: all); one that the model does not fit is an error then.",
)
@click.option(
    "--backend",
    "names",
    type=RegisteredName(backends.BACKENDS),
    multiple=True,
    help=f"Backend to time on this machine (default: {', '.join(DEFAULT[:-1])} and {DEFAULT[-1]}).",
)
@click.option("--sweep", is_flag=True, help="Also search settings for the best recall at the least modelled cost.")
@click.option("--peers", is_flag=True, help="Also run other matchers on the same images.")
@click.option(
    "--limit",
    type=click.IntRange(min=1),
    default=None,
    metavar="N",
    help="Queries that each backend is timed on, from the first (default: all; fewer of slow ones).",
)
@asking_options
@click.option("--seed", type=seed_type, default=None, help="Seed of the queries' spikes (default: the model's).")
@cluster_option
@click.option("--json", "json_path", type=PATH, default=None, metavar="FILE", help="Write the figures as JSON.")
@click.option("--report", "report_folder", type=PATH, default=None, metavar="DIR", help="Write DIR/bench.html.")
@click.pass_context
def bench(
    ctx: click.Context,
    model_path: Path,
    query: str,
    places: tuple[int, int] | None,
    every: float,
    truth: TruthOptions,
    targets: tuple[str, ...],
    names: tuple[str, ...],
    sweep: bool,
    peers: bool,
    limit: int | None,
    asking: Asking,
    seed: int | None,
    address: str | None,
    json_path: Path | None,
    report_folder: Path | None,
) -> None:
    """Say what it costs MODEL to recognise an image of QUERY: recall first, then time and memory measured here, then
    energy and time modelled for the boards.

    Which places are correct is told as to eval: without --gt or positions, query i shows place i. What this machine
    lacks (a board, energy counters) is said, and the rest is told.
    """
    if address is not None and not sweep:
        raise click.UsageError("--cluster shares the points of --sweep; all else measures this machine: add --sweep")
    page = report_folder and report_folder / "bench.html"
    outputs = Outputs((json_path,), made=(page,), read=truth.files, model=model_path, images=(query,))
    # The cost model and what it needs take a second to import: --help does not wait for them.
    from lava_vpr.bench.run import Request, run

    model = open_model(model_path)
    asking.check(model)
    _refuse(model, model_path, targets, names, sweep)
    traverse = truth.open(model, query, places, every, outputs)
    located = truth.located(model, traverse)
    correct = truth.of(model, traverse, located)
    kept = kept_for(chosen(model, None)) if peers else Keep.NOTHING
    queries, *further = encode_queries(traverse, model, asking.of(model), kept)
    request = Request(
        targets=tuple(dict.fromkeys(targets)) or tuple(BOARDS),
        backends=tuple(dict.fromkeys(names)) or backends.timed_by_default(),
        sweep=sweep,
        peers=peers,
        limit=limit,
        seed=seed,
        asking=asking,
        calibration=calibration_of(model, cores()),
        located=located,
        near=truth.near,
    )
    with cluster_at(address) as cluster, ExitStack() as bars:

        def begin(text: str, parts: int) -> Callable[[int], None]:
            bars.close()
            advance = bars.enter_context(progress_bar(text, parts))
            return lambda done: advance(done, "")

        words = command_line(ctx)
        asked = replace(request, cluster=cluster)
        results = run(model, traverse, queries, correct, asked, further=further, command=words, begin=begin)
    _tell(results, json_path, page)


def _refuse(model: Model, path: Path, targets: tuple[str, ...], names: tuple[str, ...], sweep: bool) -> None:
    """Refuse, before any work is done, what was asked for by name and cannot be."""
    from lava_vpr.bench.run import sweepable
    from lava_vpr.deploy.bundle.deployment import plan_of

    reason = sweepable(model) if sweep else None
    if reason is not None:
        raise ConfigError(f"{path}: --sweep: {reason}")
    for name in targets:
        plan_of(integer_model(model, BOARDS[name].title, path), BOARDS[name])
    for name in names:
        backends.require(name, model)


def _tell(results: Bench, json_path: Path | None, page: Path | None) -> None:
    """Write the files, then print the tables: whoever reads these may go away."""
    from lava_vpr.bench.show.json_values import as_json
    from lava_vpr.bench.show.terminal import absences, tables

    if json_path is not None:
        write_json(json_path, as_json(results))
    if page is not None:
        # matplotlib takes a second to import: only those who want a report wait for it.
        from lava_vpr.bench.show.page import page as page_of
        from lava_vpr.report import write_page

        with stage("writing the report"):
            write_page(page_of(results), page)
    for table in tables(results):
        print_whole(table)
    for line in absences(results):
        console.print(line)
    if page is not None:
        console.print(f"report: {shown(page)}")
