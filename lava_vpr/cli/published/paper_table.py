"""``lava-vpr paper-table``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from lava_vpr.cli.common import PATH, Parsed, progress_bar, seed_type, setting_type, whole_numbers
from lava_vpr.cli.nouns import jobs_option, json_option
from lava_vpr.cli.outputs import Files, Outputs, command_line, show_results
from lava_vpr.cli.show.clusters import cluster_option, pool_at
from lava_vpr.cli.show.headings import IMAGES, LEARNED, MEASURED, OUTPUT, Headed, under
from lava_vpr.config import StdpLearning
from lava_vpr.datasets.layouts import DATASETS
from lava_vpr.errors import InputError, brief, shown
from lava_vpr.paper_table import run
from lava_vpr.paper_table.methods import NETWORKS
from lava_vpr.paper_table.sections import Source, official, stand_in
from lava_vpr.paper_table.show.tables import RULES, as_csv, as_json, markdown, tables
from lava_vpr.show.table import Table

NamedPaths = tuple[str, tuple[Path, ...]]
"""The name of a dataset, and files or folders of it in order."""


def named_paths(form: str, count: int = 0) -> Parsed:
    """The type of an option value ``NAME=PATH,PATH..``.

    Args:
        form: How usage shows it.
        count: How many paths; 0: any number from 1.
    """

    def parse(text: str) -> NamedPaths:
        name, equals, rest = text.partition("=")
        paths = [rest] if count == 1 else rest.split(",")
        if not equals or not all(paths):
            raise ValueError(f"{brief(text)} is not of the form {form}")
        if name not in DATASETS:
            raise ValueError(f"there is no dataset {brief(name)}; choose from {', '.join(DATASETS.names())}")
        if count and len(paths) != count:
            raise ValueError(f"{brief(text)} names {len(paths)} files; it is of the form {form}")
        return name, tuple(map(Path, paths))

    return Parsed(form, parse, lambda named: f"{named[0]}={','.join(path.name for path in named[1])}")


@click.command("paper-table", cls=Headed)
@under(
    IMAGES,
    click.option(
        "--dataset",
        "folders",
        type=named_paths("NAME=DIR", 1),
        multiple=True,
        help="The folder that holds a dataset in its official layout (lava-vpr datasets NAME).",
    ),
    click.option(
        "--traverses",
        type=named_paths("NAME=REFERENCE,..,QUERY"),
        multiple=True,
        help="Plain traverses (folders, lists) in place of a dataset, the query last; every image is a place.",
    ),
    click.option(
        "--positions",
        type=named_paths("NAME=REFERENCE.csv,..,QUERY.csv"),
        multiple=True,
        help="Positions of each traverse of a dataset, the query's last, where the order of images does not tell their "
        "places.",
    ),
    click.option(
        "--descriptors",
        type=named_paths("NAME=REF.npy,QUERY.npy", 2),
        multiple=True,
        help="Descriptors of a dataset, made by NetVLAD: a row for each place, or for each image, traverse after "
        "traverse.",
    ),
)
@under(
    MEASURED,
    click.option(
        "--only",
        type=click.Choice(list(NETWORKS)),
        multiple=True,
        help="Compute only the rows of this network; repeat it for several (default: all).",
    ),
    click.option(
        "--sections",
        type=whole_numbers(),
        default=(),
        metavar="K,K,...",
        help="Compute only these sections, counted from 1 (default: all of the paper's).",
    ),
)
@under(
    LEARNED,
    click.option("--epochs", type=setting_type(StdpLearning, "epochs"), default=None, help="Epochs of every network."),
    click.option("--seed", type=seed_type, default=0, show_default=True, help="Seed of start weights and spikes."),
)
@jobs_option
@cluster_option
@click.option("--keep", type=PATH, default=None, metavar="DIR", help="Save finished sections in DIR, and reuse them.")
@click.option("--kept-only", is_flag=True, help="Compute nothing: print the table of the sections saved so far.")
@under(
    OUTPUT,
    json_option("the table"),
    click.option("--csv", "csv_path", type=PATH, default=None, metavar="FILE", help="Write the table as CSV."),
    click.option("--markdown", "markdown_path", type=PATH, default=None, metavar="FILE", help="Write it as Markdown."),
    click.option(
        "--report", "report_folder", type=PATH, default=None, metavar="DIR", help="Write DIR/paper_table.html."
    ),
)
@click.pass_context
def paper_table(
    ctx: click.Context,
    jobs: int | None,
    address: str | None,
    keep: Path | None,
    kept_only: bool,
    json_path: Path | None,
    csv_path: Path | None,
    markdown_path: Path | None,
    report_folder: Path | None,
    **given: Any,
) -> list[Table]:
    """Compute the paper's table again, and print it beside the paper's own figures.

    The rows are VPRSNN's network with the paper's four decoders, SAD, NetVLAD if its descriptors are given, and this
    package's presets and matchers, all on the same images, section by section. A row that cannot be computed says why.
    A section takes seconds, with preset paper one to two minutes; with --keep, an interrupted run is continued.
    """
    page = report_folder and report_folder / "paper_table.html"
    if kept_only and keep is None:
        raise click.UsageError("--kept-only takes what is kept; give --keep DIR")
    wanted = _wanted((json_path, csv_path, markdown_path), page, keep, **given)
    with pool_at(address, jobs) as pool, progress_bar("paper's table", len(wanted.tasks())) as advance:
        try:
            parts = run.paper_table(wanted, keep, pool=pool, kept_only=kept_only, advance=advance)
        except KeyboardInterrupt:
            if keep is not None:
                text = f"finished sections are kept in {shown(keep)}; the same command goes on from there"
                click.echo(text, err=True)
            raise
    repeat = command_line(ctx)
    page_text = markdown(wanted, parts, repeat)
    files: Files = {json_path: as_json(wanted, parts), csv_path: as_csv(parts), markdown_path: page_text}

    def drawn() -> str:
        from lava_vpr.paper_table.show.page import page  # matplotlib takes a second to import

        return page(wanted, parts, repeat)

    return show_results([*tables(parts), RULES], files, page, drawn)


def _wanted(
    files: tuple[Path | None, ...],
    page: Path | None,
    keep: Path | None,
    *,
    folders: tuple[NamedPaths, ...],
    traverses: tuple[NamedPaths, ...],
    positions: tuple[NamedPaths, ...],
    descriptors: tuple[NamedPaths, ...],
    only: tuple[str, ...],
    sections: tuple[int, ...],
    epochs: int | None,
    seed: int,
) -> run.PaperRequest:
    """What the table is computed from; no output is one of its files.

    Raises:
        LavaVprError: an output, or an input, that cannot be used.
    """
    given = [path for _, paths in (*positions, *descriptors) for path in paths]
    images = [str(path) for _, paths in (*folders, *traverses) for path in paths]
    outputs = Outputs(files, made=(page,), read=given, images=images)
    if keep is not None and keep.exists() and not keep.is_dir():
        raise InputError(f"{shown(keep)}: is a file; name a folder with --keep")
    sources = _sources(folders, traverses, positions)
    outputs.spare(path for source in sources.values() for traverse in source.traverses for path in traverse.paths)
    vectors = {name: (paths[0], paths[1]) for name, paths in _once(descriptors, "--descriptors").items()}
    for name in vectors.keys() - sources.keys():
        raise InputError(f"--descriptors {name}: no images of it are given; add --dataset or --traverses")
    return run.PaperRequest(sources, vectors, only or NETWORKS, sections, seed, epochs)


def _once(given: Sequence[NamedPaths], option: str) -> dict[str, tuple[Path, ...]]:
    """Paths by dataset.

    Raises:
        UsageError: a dataset is named twice.
    """
    found: dict[str, tuple[Path, ...]] = {}
    for name, paths in given:
        if name in found:
            raise click.UsageError(f"{option} names {name} twice; give it once")
        found[name] = paths
    return found


def _sources(
    folders: Sequence[NamedPaths], traverses: Sequence[NamedPaths], positions: Sequence[NamedPaths]
) -> dict[str, Source]:
    """The datasets that are at hand, in the order of the table.

    Raises:
        InputError: one cannot be used.
    """
    official_ones, plain = _once(folders, "--dataset"), _once(traverses, "--traverses")
    known = _once(positions, "--positions")
    for name in official_ones.keys() & plain.keys():
        raise click.UsageError(f"--dataset and --traverses both name {name}; give one of them")
    for name in known.keys() - official_ones.keys() - plain.keys():
        raise click.UsageError(f"--positions names {name}, of which no images are given; add --dataset or --traverses")
    found = {}
    for name in DATASETS:
        if name in official_ones:
            found[name] = official(name, official_ones[name][0], known.get(name, ()))
        elif name in plain:
            found[name] = stand_in(name, plain[name], known.get(name, ()))
    return found
