"""``lava-vpr protocol``."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import click

from lava_vpr.cli.common import PATH, RegisteredName, print_whole
from lava_vpr.cli.evaluate import evaluate
from lava_vpr.cli.nouns import jobs_option
from lava_vpr.cli.outputs import show_results, write_text
from lava_vpr.cli.train import train
from lava_vpr.config import PRESETS
from lava_vpr.datasets.protocol_rows import PROTOCOLS
from lava_vpr.datasets.protocols import ANY, FoundImages, Names, Protocol, find_images
from lava_vpr.errors import InputError, shown
from lava_vpr.matching.forward_filter import NONE as UNFILTERED
from lava_vpr.model import Model, load
from lava_vpr.show.numbers import NONE, percent
from lava_vpr.show.table import Table

RANKS = ("R@1", "R@5", "R@10")


@click.command()
@click.argument("name", type=RegisteredName(PROTOCOLS), required=False)
@click.argument("folder", type=PATH, required=False)
@click.option(
    "-o",
    "--output",
    type=PATH,
    default=None,
    metavar="DIR",
    help="New folder for the lists, the model and the figures.",
)
@click.option("--part", is_flag=True, help="Run on the available images if some are missing.")
@click.option("--preset", type=click.Choice(list(PRESETS)), default=None, help="As for train.")
@click.option("--config", type=PATH, default=None, metavar="FILE", help="Settings in TOML, as for train.")
@jobs_option
@click.pass_context
def protocol(
    ctx: click.Context,
    name: str | None,
    folder: Path | None,
    output: Path | None,
    part: bool,
    preset: str | None,
    config: Path | None,
    jobs: int | None,
) -> list[Table]:
    """Run a protocol by which the field compares methods, and print the published figures of others with the result.

    Without NAME, list the protocols. With NAME, describe one: its images, where to get them, which matches are correct,
    and the source of the published figures. With FOLDER, which holds the images under the publisher's names, and DIR,
    learn and recognise the images as the protocol says, and print the commands that do so. DIR then holds both lists of
    images, the ground truth, the model, and the figures of eval.
    """
    if name is None:
        return show_results([_list()], {})
    row = PROTOCOLS[name]
    if folder is None:
        return show_results(_told(row), {})
    if output is None:
        raise click.UsageError("the lists, the model and the figures need a folder; name it with --output DIR")
    found = find_images(row, folder, part=part)
    truth = _written(found, output)
    options = {"--preset": preset, "--config": config, "--jobs": jobs}
    words = [str(word) for option in options.items() if option[1] is not None for word in option]
    model, figures = output / "model.lvpr", output / "eval.json"
    _run(ctx, train, output / "references.txt", "-o", model, *row.learn, *words)
    right = ("--gt", truth, *(("--tolerance", row.tolerance) if found.truth else ()))
    _run(ctx, evaluate, model, output / "queries.txt", *right, "--motion", UNFILTERED, "--json", figures)
    return show_results([_beside(found, json.loads(figures.read_text()), load(model))], {})


def _written(found: FoundImages, output: Path) -> Path:
    """The file that says which places are right, once it and the lists of images stand in ``output``.

    Raises:
        InputError: the folder is there, but not with these lists.
    """
    sides = {"references": found.references, "queries": found.queries}
    texts = {
        f"{side}.txt": "".join(f"{path.resolve()}\n" for path in images.values()) for side, images in sides.items()
    }
    if found.truth is None:
        texts["truth.json"] = json.dumps({str(k): places for k, places in enumerate(found.right())}) + "\n"
    if output.exists():
        if not all((output / name).is_file() and (output / name).read_text() == text for name, text in texts.items()):
            raise InputError(
                f"{shown(output)}: exists, and does not hold the lists of this protocol; name a new folder"
            )
    else:
        output.mkdir()
        for name, text in texts.items():
            write_text(output / name, text)
    return output / "truth.json" if found.truth is None else found.truth


def _run(ctx: click.Context, command: click.Command, *words: object) -> None:
    """Print a command of lava-vpr, and run it."""
    name, args = command.name or "", [str(word) for word in words]
    print_whole(shlex.join(("lava-vpr", name, *args)))
    with command.make_context(name, args, parent=ctx) as inner:
        command.invoke(inner)


def _list() -> Table:
    """The protocols, a row each."""
    rows = [
        (name, row.title, *(f"{size:,}" for size in row.sizes), f"{row.tolerance}") for name, row in PROTOCOLS.items()
    ]
    notes = ("lava-vpr protocol NAME: which images, from where; lava-vpr protocol NAME FOLDER -o DIR: run it",)
    columns = ("name", "protocol", "learned", "recognised", "places off")
    return Table(columns, rows, notes, words=2, long=frozenset({1}))


def _told(row: Protocol) -> list[Table | str]:
    """All that is known of one protocol."""
    learned, recognised = row.sizes
    step = f"query k shows reference {row.every} k" if row.every > 1 else "query k shows reference k"
    right = "as the publisher's file says" if row.layouts[0].truth else step
    return [
        f"{row.title}: {learned:,} images are learned, {recognised:,} recognised",
        f"  right:     {right}, and {row.tolerance} places before and after"
        if row.tolerance
        else f"  right:     {right}",
        f"  images:    {row.page}",
        *(f"  source:    {source}" for source in row.sources),
        *([f"  not said:  {row.unsaid}"] if row.unsaid else []),
        "  folders:   one of these below FOLDER; what is learned first",
        *(f"    {' + '.join(_folder(names) for names in (*one.references, *one.queries))}" for one in row.layouts),
        *([_figures([], row, "")] if row.published else []),
    ]


def _folder(names: Names) -> str:
    """A folder, how many images it holds, and what these are called."""
    first, last = names.numbers[0][0], names.numbers[-1][-1]
    ends = f"{names.name.format(first)} to {names.name.format(last)}, SHA-256 of the names {names.sha256[:16]}"
    return f"{names.folder} ({len(names):,}: {'any names' if names.name == ANY else ends})"


def _beside(found: FoundImages, values: dict[str, Any], model: Model) -> Table:
    """The figures of ``values``, which ``eval`` wrote, and those that others printed."""
    seen, size = model.config.encoder.image_size, f"{model.network.weights.size:,}"
    matchers = {values["default_decoder"]: values["decoders"][values["default_decoder"]], **values["baselines"]}
    rows = []
    for name, figures in matchers.items():
        recall = (figures["recall_at_1"], *(figures["recall_at_n"][rank] for rank in ("5", "10")))
        own = (f"{seen} x {seen}", size) if name == values["default_decoder"] else (NONE, NONE)
        rows.append((name, *map(percent, recall), *own, "here"))
    here, (learned, recognised) = found.protocol, found.protocol.sizes
    title = f"{here.title}: {len(found.references):,} learned, {len(found.queries):,} recognised"
    part = f"; a part: the protocol has {learned:,} and {recognised:,}, so these are not its figures"
    return _figures(rows, here, title + ("" if found.whole else part))


def _figures(rows: list[tuple[str, ...]], row: Protocol, title: str) -> Table:
    """``rows`` of this program, then the printed figures of a protocol."""
    printed = []
    for one in row.published:
        recall = (NONE if figure is None else f"{figure:.1f}" for figure in one.recall)
        printed.append((one.method, *recall, one.pixels or NONE, one.parameters or NONE, one.source))
    columns = ("", *RANKS, "pixels", "parameters", "printed in")
    notes = ("percent; parameters: weights of the inputs; - : the source does not say",)
    return Table(
        columns,
        [*rows, *printed],
        notes,
        title,
        long=frozenset({6}),
        rules=frozenset({len(rows)}) if rows else frozenset(),
    )
