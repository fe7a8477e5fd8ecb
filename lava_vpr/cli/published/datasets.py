"""``lava-vpr datasets``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from lava_vpr.cli.common import PATH, RegisteredName
from lava_vpr.cli.nouns import json_option
from lava_vpr.cli.outputs import Outputs, show_results
from lava_vpr.datasets.layouts import DATASETS, Dataset, DatasetLayout
from lava_vpr.datasets.selecting import Check, check
from lava_vpr.show.numbers import NONE
from lava_vpr.show.table import Table


@click.command()
@click.argument("name", type=RegisteredName(DATASETS), required=False)
@click.argument("folder", type=PATH, required=False)
@json_option("what is printed")
def datasets(name: str | None, folder: Path | None, json_path: Path | None) -> None:
    """Describe the five benchmark datasets, and check a copy of one.

    Without NAME, list the datasets. With NAME, describe one: what to download, from where, its folders, and how the
    paper uses them. With FOLDER, which holds the dataset, report which of its layouts was found, the images of each
    traverse, the places and sections that they give, and where they differ from what the paper needs; the exit code is
    1 if nothing can be learned from them.
    """
    Outputs((json_path,), images=() if folder is None else (str(folder),))
    if name is None:
        show_results(_list(), {json_path: {"datasets": [_described(dataset) for dataset in DATASETS.values()]}})
    elif folder is None:
        show_results(_told(DATASETS[name]), {json_path: _described(DATASETS[name])})
    else:
        found = check(name, folder)
        show_results(_found(found), {json_path: found.as_json()})
        if not found.usable:
            sys.exit(1)


def _list() -> list[Table | str]:
    """The datasets, a row each."""
    notes = ("lava-vpr datasets NAME: what to download, and the folders", "lava-vpr datasets NAME FOLDER: check them")
    columns = ("name", "dataset", "the paper's task", "sections", "places")
    rows = [(name, d.title, d.task, f"{d.sections} x {d.places}", _sampling(d)) for name, d in DATASETS.items()]
    table = Table(columns, rows, notes, "benchmark datasets", words=5, long=frozenset({2}))
    return [table, *(f"{name}: {row.page}" for name, row in DATASETS.items())]


def _sampling(row: Dataset) -> str:
    """How the first layout samples, in few words."""
    layout = row.layouts[0]
    if layout.spacing is not None:
        return f"every {layout.spacing:g} m"
    return "every image" if layout.step == 1 else f"every {layout.step}th image"


def _told(row: Dataset) -> list[str]:
    """All that is known of one dataset."""
    return [
        f"{row.title}: {row.what}",
        f"  page:      {row.page}",
        f"  download:  {row.download}",
        f"  the paper: {row.task}; {row.sections} x {row.places} places, one model each.",
        f"  places:    {row.sampling}",
        f"  truth:     {row.truth}",
        f"  not said:  {row.unsaid}",
        "  folders:   one of these below FOLDER, or lists of images; the query last",
        *(f"    {_folders(layout)}" for layout in row.layouts),
    ]


def _folders(layout: DatasetLayout) -> str:
    taken = [f"every {layout.step}th image"] if layout.step > 1 else []
    taken += [f"a place every {layout.spacing:g} m"] if layout.spacing is not None else []
    taken += ["positions needed"] if layout.ground_truth == "positions" else []
    return " + ".join(layout.folders) + (f" ({', '.join(taken)})" if taken else "")


def _described(row: Dataset) -> dict[str, Any]:
    """A dataset as plain values."""
    return {
        "name": row.name,
        "title": row.title,
        "what": row.what,
        "page": row.page,
        "download": row.download,
        "learned": list(row.learned),
        "recognised": row.recognised,
        "sampling": row.sampling,
        "truth": row.truth,
        "not_said": row.unsaid,
        "sections": row.sections,
        "places": row.places,
        "layouts": [
            {
                "references": list(layout.references),
                "query": layout.query,
                "step": layout.step,
                "spacing_m": layout.spacing,
                "ground_truth": layout.ground_truth,
            }
            for layout in row.layouts
        ],
    }


def _found(found: Check) -> list[Table | str]:
    """What was found, and what differs."""
    rows = [
        (
            row.folder,
            f"{row.images:,}",
            f"{row.in_use:,}",
            NONE if row.size is None else f"{row.size[0]} x {row.size[1]}",
        )
        for row in found.traverses
    ]
    title = f"{found.dataset.title}: {found.dataset.task}"
    places = "positions decide which images are places: " + found.dataset.truth
    if found.places is not None:
        places = f"{found.places:,} places: {found.sections} of the paper's {found.dataset.sections} sections"
    table = Table(("traverse", "images", "in use", "pixels"), rows, title=title)
    return [table, places, *(f"differs: {one}" for one in found.differs), "usable" if found.usable else "not usable"]
