"""Every figure of the docs again, by one command: all records, docs/results.json, and the pages.

    LAVA_VPR_DATA=... python -m benchmarks commands.records [NAME ...] [--after COMMAND]

`make figures` calls it. It runs the command of each record once, with ``--record``, one after the other: hours on two
cores, a day with the paper's table. A command that fails is named at the end, and its record stays as it was; after an
interruption, ``--after`` goes on behind the last command that was done. Figures of time want a machine with nothing
else to do.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import click

from benchmarks import figures
from benchmarks.commands import tables
from benchmarks.program import ROOT, Printed, program, verdict
from lava_vpr.errors import InputError

OTHER_CHECKOUT = "CHECKOUT"
"""In a command: an older checkout of this project, which nobody but the caller has."""
RESULTS, PAGES = "python -m benchmarks.results", "python -m scripts.pages"


def commands(names: Sequence[str] = ()) -> dict[str, str]:
    """The commands that write the records ``names``, or all records and pages; each with what bars it, or nothing.

    Raises:
        InputError: there is no such record.
    """
    found: dict[str, str] = {}
    for name in names or figures.names():
        command = figures.read(name).command
        if name in tables.NAMES:
            same = [other for other in tables.NAMES if figures.read(other).command == command]
            command = f"python -m benchmarks commands.tables {' '.join(same)}"
        python = command.split()[0]
        missing = python.startswith(".venv") and not (ROOT / python).exists()
        found[f"{command} --record"] = (
            "it compares with an older checkout: name one by hand"
            if OTHER_CHECKOUT in command
            else f"{python} is missing: run make {'ci-torch' if 'torch' in python else 'test'}"
            if missing
            else ""
        )
    return found | ({} if names else {RESULTS: "", PAGES: ""})


def remaining(found: Mapping[str, str], after: str | None) -> dict[str, str]:
    """Those of ``found`` behind the command ``after``.

    Raises:
        InputError: ``after`` is none of them.
    """
    if after is None:
        return dict(found)
    if after not in found:
        raise InputError(f"--after {after!r}: no such command; a line above each run's output names it")
    return dict(list(found.items())[list(found).index(after) + 1 :])


@program("nordland", "nordland_long", "gardens", "lens_example")
@click.argument("names", nargs=-1, type=click.Choice(figures.names()))
@click.option("--after", metavar="COMMAND", help="Go on behind this command, as a run before printed it.")
@click.option("--dry-run", is_flag=True, help="Print the commands and run none.")
def main(names: Sequence[str], after: str | None, dry_run: bool) -> Printed:
    """Compute the figures of docs again: of some records, or all of them."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    failed = []
    todo = remaining(commands(names), after)
    for number, (command, barred) in enumerate(todo.items(), start=1):
        yield f"{number} of {len(todo)}: {command}" + (f" ({barred})" if barred else "")
        if dry_run or barred:
            continue
        started = time.monotonic()
        code = subprocess.run(["sh", "-c", command], cwd=ROOT, env=os.environ | {"PATH": path}, check=False).returncode
        yield f"exit code {code} after {time.monotonic() - started:.0f} s"
        if code:
            failed.append(f"failed: {command}")
    yield from verdict(failed, f"{sum(not barred for barred in todo.values())} commands of {len(todo)}")
