"""Tables that commands of lava-vpr print, taken into their records: studies, the paper's table, the largest maps.

    LAVA_VPR_DATA=... python -m benchmarks commands.tables study-bits [NAME...] --record

Each record in docs/results names its command; each command is run once, in a folder that holds what it names
(`images`). A record takes one of the tables, and of that the columns that it has.
"""

from __future__ import annotations

import contextlib
import os
import shlex
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import click

from benchmarks import figures
from benchmarks.places import images_of
from benchmarks.program import BenchmarkTable, Printed, program
from lava_vpr.cli import main as lava_vpr
from lava_vpr.show.table import Table
from lava_vpr.storage.writing import temporary_folder

NAMES = [name for name in figures.names() if figures.read(name).command.startswith("lava-vpr ")]


LINKS = {
    "summer": "nordland/summer",
    "winter": "nordland/winter",
    "gardens/ref": "gardens/reference",
    "gardens/query": "gardens/query",
    "lens/example-reference": "lens_example/reference",
    "lens/example-query": "lens_example/query",
    "lens/example-reference_example-query_GT.npy": "lens_example/ground_truth.npy",
}
"""What the commands find below ``$N``, under the names that publishers gave it: where it is among the images."""
FILES = {"four.toml": "[network]\nneurons_per_place = 4\n"}


@contextlib.contextmanager
def images() -> Iterator[None]:
    """Work in a folder, which goes afterwards, with all that commands of records name; ``$N`` is its path.

    Nordland's 1,500 places stand there as the lists summer.txt and winter.txt, and as folders in nordland/.
    """
    data, before = images_of("nordland", "summer").resolve().parents[1], Path.cwd()
    with temporary_folder() as place, contextlib.ExitStack() as stack:
        os.environ["N"] = str(place)
        os.chdir(place)
        stack.callback(os.chdir, before)
        for name, target in LINKS.items():
            Path(name).parent.mkdir(exist_ok=True)
            Path(name).symlink_to(data / target)
        for season in ("summer", "winter"):
            paths = [
                path for part in ("nordland", "nordland_long") for path in sorted((data / part / season).iterdir())
            ]
            Path(f"{season}.txt").write_text("".join(f"{path}\n" for path in paths))
            (folder := Path("nordland", season)).mkdir(parents=True)
            for path in paths:
                (folder / path.name).symlink_to(path)
        for name, text in FILES.items():
            Path(name).write_text(text)
        yield


@cache
def printed(command: str) -> list[Table]:
    """The tables that a command of lava-vpr prints."""
    made: list[Table] = lava_vpr.main(shlex.split(os.path.expandvars(command))[1:], standalone_mode=False)
    return made


@program("nordland", "nordland_long", "gardens", "lens_example")
@click.argument("names", nargs=-1, required=True, type=click.Choice(NAMES))
def main(names: Sequence[str]) -> Printed:
    """Run the commands of some records."""
    with images():
        for name in names:
            record = figures.read(name)
            table = printed(record.command)[record.table]
            yield BenchmarkTable(table.columns, table.rows, title=name, record=name)
