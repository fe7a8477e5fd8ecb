"""``lava-vpr bench``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lava_vpr.backends import registry as backends
from lava_vpr.backends.asking import Asking
from lava_vpr.backends.opening import calibration_of, open_model
from lava_vpr.backends.rivals import chosen as rivals
from lava_vpr.backends.rivals import kept_for
from lava_vpr.cli.choose import TruthOptions, truth_options
from lava_vpr.cli.common import (
    PATH,
    OneSource,
    RegisteredName,
    asking_options,
    encode_queries,
    every_option,
    places_option,
    progress_bar,
    seed_type,
)
from lava_vpr.cli.evaluate import command_line
from lava_vpr.cli.outputs import Outputs
from lava_vpr.cli.show.clusters import cluster_option, pool_at
from lava_vpr.cli.show.results import show_results
from lava_vpr.cluster.tasks import Pool
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.encoding import Keep
from lava_vpr.engine.threads import cores
from lava_vpr.errors import ConfigError
from lava_vpr.model import Model, integer_model

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
    asking: Asking,
    address: str | None,
    json_path: Path | None,
    report_folder: Path | None,
    **chosen: Any,
) -> None:
    """Say what it costs MODEL to recognise an image of QUERY: recall first, then time and memory measured here, then
    energy and time modelled for the boards.

    Which places are correct is told as to eval: without --gt or positions, query i shows place i. What this machine
    lacks (a board, energy counters) is said, and the rest is told.
    """
    if address is not None and not chosen["sweep"]:
        raise click.UsageError("--cluster shares the points of --sweep; all else measures this machine: add --sweep")
    page = report_folder and report_folder / "bench.html"
    outputs = Outputs((json_path,), made=(page,), read=truth.files, model=model_path, images=(query,))
    from lava_vpr.bench.run import Request, run  # takes a second: --help does not wait for it

    model = open_model(model_path)
    _refuse(model, model_path, asking, targets, names, chosen["sweep"])
    traverse = truth.open(model, query, places, every, outputs)
    located = truth.located(model, traverse)
    correct = truth.of(model, traverse, located)
    kept = kept_for(rivals(model, None)) if chosen["peers"] else Keep.NOTHING
    queries, *further = encode_queries(traverse, model, asking.of(model), kept)
    boards, backs = (tuple(dict.fromkeys(each)) for each in (targets or BOARDS, names or DEFAULT))
    request = Request(boards, backs, asking=asking, located=located, near=truth.near, **chosen)
    with pool_at(address) as pool, _bars() as begin:
        asked = replace(request, pool=pool, calibration=calibration_of(model, Pool(cores())))
        found = run(model, traverse, queries, correct, asked, further=further, command=command_line(ctx), begin=begin)
    _tell(found, json_path, page)


@contextmanager
def _bars() -> Iterator[Callable[[str, int], Callable[[int], None]]]:
    """A function that shows a bar for a stage in the place of the one before, and returns what moves it."""
    with ExitStack() as bars:

        def begin(text: str, parts: int) -> Callable[[int], None]:
            bars.close()
            advance = bars.enter_context(progress_bar(text, parts))
            return lambda done: advance(done, "")

        yield begin


def _refuse(
    model: Model, path: Path, asking: Asking, targets: tuple[str, ...], names: tuple[str, ...], sweep: bool
) -> None:
    """Refuse, before any work is done, what was asked for by name and cannot be."""
    asking.check(model)
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

    def drawn() -> str:
        from lava_vpr.bench.show.page import page as page_of  # matplotlib takes a second to be imported

        return page_of(results)

    show_results(tables(results), {json_path: as_json(results)}, page, drawn, absences(results))
