"""``lava-vpr doctor``."""

from __future__ import annotations

import platform
import shutil
from collections.abc import Sequence
from typing import Any

import click

from lava_vpr import __version__
from lava_vpr.backends.interface import BackendRow
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.bench.query_set import installed
from lava_vpr.cli.common import console, print_reasons
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import BackendUnavailableError, PluginError
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.matching.decoders import DECODERS
from lava_vpr.neurons.models import NEURONS
from lava_vpr.readers import READERS
from lava_vpr.rows.registry import Registry
from lava_vpr.show.table import Table
from lava_vpr.training.trainers import LEARNING

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
    "pi-heif": ("heic", "reads HEIC, only of people you trust (docs/limits.md): pip install 'lava-vpr[heic]'"),
    "pillow-heif": ("by hand", "reads HEIC in pi-heif's place, is maintained, has GPL parts: pip install pillow-heif"),
    "lava-loihi": ("vendor", "Intel's closed package that drives Loihi 2; from Intel's research cloud"),
    "nxsdk": ("vendor", "Intel's closed package that drives Kapoho Bay; from Intel's research cloud"),
}
PLUGGED: tuple[Registry[Any], ...] = (INPUTS, LEARNING, NEURONS, DECODERS, BACKENDS, READERS)
"""The registries whose rows packages can bring."""
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def _costing() -> tuple[str, str, str]:
    """The row of what ``bench`` reads energy from: name, whether it can be read, what for."""
    from lava_vpr.bench.measure import rapl  # only here: it is quick, but the command line need not wait for it

    try:
        rapl.counters()
        there, why = "readable", ""
    except rapl.NoRaplError as error:
        there, why = "not readable", f"; {error}"
    return "RAPL", there, f"optional: energy of the processor, for bench{why}"


def _missing(row: BackendRow) -> str | None:
    """Why a backend cannot run here; None if it can."""
    try:
        return row.unavailable()
    except PluginError as error:
        return str(error)


def _show_plugins() -> None:
    """List the rows that other packages bring, and why one cannot be used."""
    rows = [
        (registry.kind, plugin.name, plugin.package, plugin.version, reason or "yes")
        for registry in PLUGGED
        for plugin, reason in registry.plugged()
    ]
    if rows:
        _print(("what", "name", "package", "version", "usable"), rows, "plug-ins")
    else:
        console.print(f"no plug-ins (entry points {', '.join(registry.group or '' for registry in PLUGGED)})")


def _print(
    columns: Sequence[str], rows: Sequence[Sequence[str]], title: str, strong: frozenset[int] = frozenset()
) -> None:
    """Print a table of words whose last column takes the width that the terminal leaves."""
    last = frozenset({len(columns) - 1})
    console.print(
        Table(columns, rows, title=title, words=len(columns), long=last, widest=None, strong=strong).terminal()
    )


@click.command()
def doctor() -> None:
    """Report what is installed, what each optional part is for, and which backends can run."""
    console.print(
        f"lava-vpr {__version__}, Python {platform.python_version()}, {platform.machine()}, {cores()} processors",
    )
    missing = [package for package in NEEDED if installed(package) is None]
    reasons = {name: _missing(row) for name, row in BACKENDS.items()}
    able = {name: "yes" if reason is None and not missing else "no" for name, reason in reasons.items()}
    needs = f"{', '.join(missing)} missing" if missing else "All that is needed is installed"
    console.print(f"{needs}; {[*able.values()].count('yes')} of {len(able)} backends can run.")
    browser = next((name for name in BROWSERS if shutil.which(name)), "not installed")
    rows = [(package, installed(package) or "missing", purpose) for package, purpose in NEEDED.items()]
    rows += [(k, installed(k) or "not installed", f"optional ({extra}): {why}") for k, (extra, why) in OPTIONAL.items()]
    rows.append(("Chromium", browser, "optional: the test that opens a report in a real browser"))
    rows.append(_costing())
    strong = frozenset(k for k, package in enumerate(NEEDED) if package in missing)
    _print(("package", "version", "what for"), rows, "packages", strong)
    _print(
        ("backend", "can run", "what"), [(name, able[name], row.title) for name, row in BACKENDS.items()], "backends"
    )
    print_reasons(reasons)
    _show_plugins()
    if missing:
        raise BackendUnavailableError(
            f"{', '.join(missing)} missing; install again: pip install --force-reinstall lava-vpr"
        )
