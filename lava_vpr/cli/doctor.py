"""``lava-vpr doctor``."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import platform
import shutil
from typing import Any

import click
from rich.table import Table
from rich.text import Text

from lava_vpr import __version__
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.cli.common import console, print_reasons
from lava_vpr.engine.threads import cores
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.matching.decoders import DECODERS
from lava_vpr.readers import READERS
from lava_vpr.rows.registry import Registry

NEEDED = {
    "numpy": "arrays",
    "numba": "compiles the host engine",
    "opencv-python-headless": "reads and resizes images",
    "scipy": "distances of the baselines",
    "matplotlib": "plots of the report",
    "gpxpy": "positions from GPX files",
    "utm": "positions in UTM zones beside degrees",
    "h5py": "HDF5 files",
    "nir": "networks as NIR graphs",
}
OPTIONAL = {
    "lava-nc": ("Python 3.10", "Intel's Lava, archived: the backends lava-*, the Processes and their notebook"),
    "lava-dl": ("dl", "Lava's deep-learning library, pulls torch (5.6 GB): pip install 'lava-vpr[dl]'"),
    "lava-loihi": ("vendor", "Intel's closed package that drives Loihi 2; from Intel's research cloud"),
    "nxsdk": ("vendor", "Intel's closed package that drives Kapoho Bay; from Intel's research cloud"),
}
PLUGGED: tuple[Registry[Any], ...] = (INPUTS, DECODERS, BACKENDS, READERS)
"""The registries whose rows packages can bring."""
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def version(package: str) -> str | None:
    """Installed version of a distribution, or None."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _costing() -> list[tuple[str, str, str]]:
    """What ``bench`` uses where it is: name, whether it is there, what for."""
    from lava_vpr.bench.measure import rapl  # only here: it is quick, but the command line need not wait for it

    try:
        rapl.counters()
        there, why = "readable", ""
    except rapl.NoRaplError as error:
        there, why = "not readable", f"; {error}"
    return [
        ("RAPL", there, f"energy of the processor, for bench{why}"),
    ]


def _show_plugins() -> None:
    """Say which rows other packages bring, and why one cannot be used."""
    table = Table(title="plug-ins", title_justify="left")
    for column in ("what", "name", "package", "version", "usable"):
        table.add_column(column, no_wrap=column != "usable", overflow="fold")
    for registry in PLUGGED:
        for plugin, reason in registry.plugged():
            table.add_row(registry.kind, plugin.name, plugin.package, plugin.version, reason or "yes")
    if table.row_count:
        console.print(table)
    else:
        console.print(f"no plug-ins (entry points {', '.join(registry.group or '' for registry in PLUGGED)})")


@click.command()
def doctor() -> None:
    """Say what is installed, what each optional part is for, and which backends can run."""
    console.print(
        f"lava-vpr {__version__}, Python {platform.python_version()}, {platform.machine()}, {cores()} processors",
    )
    table = Table(show_header=True, title="packages", title_justify="left")
    for column in ("package", "version", "what for"):
        table.add_column(column, no_wrap=column != "what for", overflow="fold")
    missing = []
    for package, purpose in NEEDED.items():
        state = version(package)
        missing += [package] if state is None else []
        table.add_row(package, state or Text("missing", style="bold red"), purpose)
    for package, (extra, purpose) in OPTIONAL.items():
        table.add_row(package, version(package) or "not installed", f"optional ({extra}): {purpose}")
    browser = next((name for name in BROWSERS if shutil.which(name)), None)
    table.add_row("Chromium", browser or "not installed", "optional: the test that opens a report in a real browser")
    for name, state, purpose in _costing():
        table.add_row(name, state, f"optional: {purpose}")
    console.print(table)
    names = Table(title="backends", title_justify="left")
    for column in ("backend", "can run", "what"):
        names.add_column(column, no_wrap=column != "what", overflow="fold")
    reasons = {name: row.unavailable() for name, row in BACKENDS.items()}
    for name, row in BACKENDS.items():
        names.add_row(name, "yes" if reasons[name] is None and not missing else "no", row.title)
    console.print(names)
    print_reasons(reasons)
    _show_plugins()
    if missing:
        raise BackendUnavailableError(
            f"{', '.join(missing)} missing; install again: pip install --force-reinstall lava-vpr"
        )
