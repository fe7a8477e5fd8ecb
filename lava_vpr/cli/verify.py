"""``lava-vpr verify``."""

from __future__ import annotations

from pathlib import Path

import click

from lava_vpr.backends import registry as backends
from lava_vpr.backends.asking import Asking
from lava_vpr.backends.verification import Verdict, verify as verify_spikes
from lava_vpr.cli.choose import open_queries
from lava_vpr.cli.common import PATH, RegisteredName, encode_queries, one_bar, print_reasons
from lava_vpr.cli.nouns import (
    Learning,
    OneSource,
    Queries,
    asking_options,
    json_option,
    queries_options,
    replay_option,
    seed_option,
)
from lava_vpr.cli.outputs import Outputs, show_results
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import BackendUnavailableError, InputError
from lava_vpr.inputs.encoder import Keep
from lava_vpr.show.numbers import percent
from lava_vpr.show.table import Table
from lava_vpr.truth.alignment import aligned_truth


@click.command("verify", cls=OneSource)
@queries_options
@click.option(
    "--limit", type=click.IntRange(min=1), default=20, show_default=True, metavar="N", help="Queries, from the first."
)
@click.option(
    "--backend",
    "names",
    type=RegisteredName(backends.BACKENDS),
    multiple=True,
    help="Backend to compare with the host (default: all).",
)
@asking_options
@click.option("--season", type=PATH, default=None, metavar="FILE", help="File with the season to apply.")
@replay_option
@seed_option
@json_option("the verdicts")
def verify(
    asked: Queries,
    limit: int,
    names: tuple[str, ...],
    asking: Asking,
    season: Path | None,
    replay: Path | None,
    seed: int | None,
    json_path: Path | None,
) -> None:
    """Run the first images of QUERY through MODEL on every backend and compare every spike with the host's.

    Exits with 1 if a single spike differs, or if a named backend cannot run. The spikes of a float backend may differ;
    its recall is printed. Spikes that the network decides (exc, inh) are counted separately from those of inputs.
    """
    learning = Learning(learn=False, season=season, replay=replay)
    outputs = Outputs((json_path,), read=learning.files, model=asked.model_path, images=(asked.query,))
    asking = learning.of(asking)
    model = asked.model(asking)
    for name in names:  # asked for by name: not to run it is an error
        backends.require(name, model)
    traverse = open_queries(model, asked.query, asked.places, asked.every, outputs)
    truth = aligned_truth(model, traverse)[:limit]  # of all, then the first: fewer than places would be not aligned
    queries, *further = encode_queries(traverse.take(range(min(limit, len(traverse)))), model, asking, Keep.GREY)
    chosen = ("host", *(name for name in names if name != "host")) if names else None
    with one_bar() as show:
        verdicts = verify_spikes(
            model,
            queries,
            truth,
            names=chosen,
            asking=asking,
            further=further,
            seed=seed,
            threads=cores(),
            begin=lambda name: show(f"running {name}", len(queries) * asking.views),
        )
    values = {"backends": {verdict.name: verdict.as_json() for verdict in verdicts}}
    show_results([*_in_words(verdicts), _table(verdicts, len(traverse))], {json_path: values})
    _judge(verdicts, named=bool(names))


def _judge(verdicts: list[Verdict], named: bool) -> None:
    """Print why backends cannot run, and fail where spikes differ, or where backends were ``named`` and cannot run.

    Raises:
        InputError: spikes differ.
        BackendUnavailableError: a backend that was named cannot run.
    """
    unable = [verdict for verdict in verdicts if verdict.reason is not None]
    print_reasons({verdict.name: verdict.reason for verdict in unable})
    different = [verdict for verdict in verdicts if verdict.equal is False]
    if different:
        first = different[0]
        raise InputError(
            f"{first.name} differs from the host in {first.differing:,} places, first at {first.mismatch}; report it "
            "with the model and the query"
        )
    if named and unable:  # it began, and could not
        raise BackendUnavailableError(f"{unable[0].name}: was not compared; see above, or choose another --backend")


def _in_words(verdicts: list[Verdict]) -> list[str]:
    """Which backends have every spike of the host, in a sentence, but for those that call the host's own kernel."""
    alike = [row.name for row in verdicts if row.equal and not row.hosts_kernel and row.name != "host"]
    return [f"Every spike that was compared equals the host's on {', '.join(alike)}."] if alike else []


_FURTHER = {"before": "front end", "gained": "gains"}
"""Properties of a verdict that have a column where there is something to count."""


def _table(verdicts: list[Verdict], images: int) -> Table:
    """The table of the verdicts, with a row for each backend; there are ``images`` that could be compared."""
    rows, further = [], [name for name in _FURTHER if any(getattr(verdict, name) for verdict in verdicts)]
    for verdict in verdicts:
        if verdict.reason is not None:
            rows.append([verdict.name, "not available"])
            continue
        equal = "equal, host's kernel" if verdict.hosts_kernel else "every spike equal"
        result = {None: "floating point", True: equal, False: f"{verdict.differing:,} differ"}
        numbers = (*(getattr(verdict, name) for name in further), verdict.decided, verdict.compared.get("inputs", 0))
        compared = (f"{number:,}" if verdict.equal is not None else "" for number in numbers)
        recall = "" if verdict.recall is None else percent(verdict.recall)
        shown = "compared with" if verdict.name == "host" else result[verdict.equal]
        rows.append([verdict.name, shown, f"{verdict.queries}", *compared, recall])
    of = "all populations of the front end, of " if "before" in further else ""
    notes = [f"Spikes compared: of {of}exc and inh, which the network decides, and of inputs, which rates and key do."]
    if "gained" in further:
        notes.append("Gains: products of an input's activity and its gain, compared bit for bit.")
    if verdicts[0].queries < images:
        notes.append(f"Queries: the first {verdicts[0].queries} of {images:,} images; --limit N takes more.")
    columns = ("backend", "result", "queries", *(_FURTHER[name] for name in further), "exc, inh", "inputs", "R@1")
    return Table(columns, rows, tuple(notes), words=2)
