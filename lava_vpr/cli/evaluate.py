"""``lava-vpr eval``."""

from __future__ import annotations

import shlex
from pathlib import Path

import click
import numpy as np

from lava_vpr.backends import registry as backends
from lava_vpr.backends.asking import Asking
from lava_vpr.backends.opening import calibration_of, open_model
from lava_vpr.backends.rivals import BASELINES, kept_for, missing
from lava_vpr.backends.rivals import chosen as rivals_of
from lava_vpr.cli.choose import TruthOptions, truth_options
from lava_vpr.cli.common import (
    PATH,
    Numbers,
    OneSource,
    Values,
    answer_options,
    asking_options,
    backend_progress,
    console,
    encode_queries,
    every_option,
    motion_option,
    places_option,
    print_whole,
    stage,
    stderr,
)
from lava_vpr.cli.outputs import Outputs, write_json
from lava_vpr.cli.published.options import asked_places, benchmark_options
from lava_vpr.cli.show.clusters import cluster_option, pool_at
from lava_vpr.datasets.selecting import Benchmark
from lava_vpr.encoding import EncodedTraverse, Keep
from lava_vpr.matching.figures import TITLES, values_of
from lava_vpr.model import Model
from lava_vpr.recognition import Comparison, Recognition, as_json, recognise
from lava_vpr.show.numbers import percent
from lava_vpr.show.table import Table
from lava_vpr.storage.text import shown
from lava_vpr.truth.alignment import PositionErrors


@click.command("eval", cls=OneSource)
@click.argument("model_path", metavar="MODEL", type=PATH)
@click.argument("query", type=str)
@places_option("Query images A..B-1 (default: the model's own range).")
@every_option
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
@click.option("--json", "json_path", type=PATH, default=None, metavar="FILE", help="Write the figures as JSON.")
@click.option("--report", "report_folder", type=PATH, default=None, metavar="DIR", help="Write DIR/report.html.")
@click.pass_context
def evaluate(
    ctx: click.Context,
    model_path: Path,
    query: str,
    places: tuple[int, int] | None,
    every: float,
    benchmark: Benchmark,
    truth: TruthOptions,
    sequence: int,
    rivals: tuple[str, ...],
    descriptors: tuple[Path, Path] | None,
    asking: Asking,
    motion: str,
    backend: str,
    seed: int | None,
    address: str | None,
    json_path: Path | None,
    report_folder: Path | None,
) -> None:
    """Recognise the images of QUERY and print recall, precision and baselines.

    Without --gt or positions, query i shows place i, and both must be equally many. Where the model has positions and
    those of the queries are told, by --query-positions or their names, places within --radius metres are correct. With
    --dataset, QUERY is the folder that holds a benchmark dataset (lava-vpr datasets), and MODEL was trained with it.
    """
    if address is not None and backend != "host":
        raise click.UsageError(f"--cluster runs the backend host, not {backend}; leave one of the two out")
    page = report_folder and report_folder / "report.html"
    read = (*truth.files, *(descriptors or ()))
    route = benchmark.recognised(query, every, places=places)
    outputs = Outputs((json_path,), made=(page,), read=read, model=model_path, images=route.sources)
    model = open_model(model_path)
    asking.check(model)
    backends.require(backend, model)
    truth = truth.for_route(route)
    traverse = truth.open(model, route.sources[0], asked_places(route, model, places), route.every, outputs)
    located = truth.located(model, traverse)
    correct = truth.of(model, traverse, located)
    names = rivals_of(model, rivals or None)
    kept = kept_for(names) | (Keep.THUMBNAILS if page is not None else Keep.NOTHING)
    with pool_at(address) as pool:
        comparison = Comparison(
            sequence,
            names,
            descriptors,
            keep_scores=page is not None,
            asking=asking,
            motion=motion,
            calibration=calibration_of(model, pool) if sequence == asking.views == 1 else None,
        )
        queries, *further = encode_queries(traverse, model, asking.of(model), kept)
        with backend_progress(backend, len(queries)) as advance:
            result = recognise(
                model,
                queries,
                correct,
                comparison,
                backend=backend,
                seed=seed,
                advance=advance,
                further=further,
                pool=pool,
            )
    errors = None if located is None else PositionErrors(located, located.errors(result.matches), truth.near)
    if json_path is not None:  # files first: whoever reads the table may go away
        write_json(json_path, as_json(model, result, errors))
    if page is not None:
        with stage("writing the report"):
            _write_report(page, model, queries, result, errors, ctx)
    print_table(model, result, sequence)
    if errors is not None:
        console.print(errors.in_words())
    print_trust(result)
    if result.contradiction is not None:
        stderr.print(f"warning: {result.contradiction}")
    for name, reason in missing(model).items() if not rivals else ():
        console.print(f"no {name}: {reason}")
    if page is not None:
        console.print(f"report: {shown(page)}")


def _write_report(
    page: Path,
    model: Model,
    queries: EncodedTraverse,
    result: Recognition,
    errors: PositionErrors | None,
    ctx: click.Context,
) -> None:
    """The page of what the command of ``ctx`` found."""
    # matplotlib takes a second to import: only those who want a report wait for it.
    from lava_vpr.report import write_report
    from lava_vpr.report.build import report_data

    sequence, seed = ctx.params["sequence"], ctx.params["seed"]
    write_report(report_data(model, queries, result, command_line(ctx), sequence, seed, errors), page.parent)


def print_table(model: Model, result: Recognition, sequence: int = 1) -> None:
    """The figures of every matcher in percent, the default decoder first and marked."""
    what = "queries" if sequence == 1 else f"sequences of {sequence} queries"
    title = f"{len(result.matches)} {what}, {model.places} places, {model.neurons} neurons"
    notes = ["percent; * the decoder that answers"]
    notes += [f"{name} sees {BASELINES[name]}" for name in result.metrics if name in BASELINES]
    if result.followed:
        notes.append("filtered: queries in driving order, each with those before it; forward-backward: with all")
    names = [result.default, *(name for name in result.metrics if name != result.default)]
    groups = (
        {name + (" *" if name == result.default else ""): result.metrics[name] for name in names},
        {f"{name}, adapted": metrics for name, metrics in result.adapted.items()},
        {name.replace("_", "-"): metrics for name, metrics in result.followed.items()},
    )
    rows = [(name, *map(percent, values_of(metrics))) for group in groups for name, metrics in group.items()]
    rules = frozenset({len(groups[0]), len(groups[0]) + len(groups[1])})
    print_whole(Table(("matcher", *TITLES.values()), rows, notes, title, rules=rules))


def print_trust(result: Recognition) -> None:
    """What each target precision keeps, and how far probabilities are from what they say."""
    if not result.trust:
        return
    off_map = next(iter(result.trust.values())).off_map
    note = f"{percent(off_map)} % of the queries are off the map; the calibration takes half for that"
    rows = []
    for name, found in result.trust.items():
        for number, row in enumerate(found.thresholds):
            least = f"{row.probability:.3f}" if np.isfinite(row.probability) else "none"
            figures = map(percent, (row.accepted, row.precision, row.kept, row.false_accepts))
            first = (name, percent(found.error)) if number == 0 else ("", "")
            rows.append((first[0], percent(row.target), least, *figures, first[1]))
    columns = ("", "target", "least probability", "accepted", "precision", "kept", "false accepts", "error")
    print_whole(Table(columns, rows, (note,), "accepted by --target-precision"))


SILENT = ("json_path", "csv_path", "report_folder", "jobs", "address", "keep")
"""Parameters that a report does not repeat: they change nothing of what it says."""


def command_line(ctx: click.Context) -> str:
    """How to repeat this command, file names without their folders (reports carry no paths)."""
    words = ["lava-vpr", ctx.info_name or ""]
    for param in ctx.command.params:
        value = ctx.params.get(param.name or "")
        if value is None or value == () or value == param.default or param.name in SILENT:
            continue
        values = value if isinstance(value, tuple) else (value,)
        if param.name == "places":
            values = (f"{values[0]}:{values[1]}",)
        if isinstance(param.type, (Numbers, Values)):
            values = (",".join(f"{number:g}" for number in values),)
        sources = ("query", "references", "stamps")
        shown = [Path(v).name if isinstance(v, Path) or param.name in sources else str(v) for v in values]
        if isinstance(param, click.Argument):
            words += shown
        elif isinstance(param, click.Option) and param.is_flag:
            words += [param.opts[-1]] if value else []
        elif param.multiple:
            words += [word for text in shown for word in (param.opts[-1], text)]
        else:
            words += [param.opts[-1], *shown]
    return shlex.join(words)
