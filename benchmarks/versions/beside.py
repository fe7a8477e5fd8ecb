"""The host engine of this checkout beside that of another, in turns.

    LAVA_VPR_DATA=... python -m benchmarks versions.beside CHECKOUT [--rounds 15]

Each checkout learns the same places with its own preset, but for the encoder. What is presented is the same: input
spikes, steps and number of neurons, those of this checkout's presets, with regular and with Poisson trains. Figures are
processor time of one thread, the least of all rounds, because other programs share the machine.
"""

from __future__ import annotations

import json
import os
import subprocess
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from pathlib import Path

import click

from benchmarks.program import ROOT, BenchmarkTable, Printed, program, turns
from benchmarks.versions.worker import VersionCase
from lava_vpr.config import integer_config, preset
from lava_vpr.configfile import to_dict
from lava_vpr.engine.inference.fixed import silent_steps
from lava_vpr.errors import InputError

SCRIPT = Path(__file__).with_name("worker.py")


def cases() -> list[VersionCase]:
    """Both presets on 100 places and on 500, with regular and with Poisson trains."""
    made = []
    for name, places in (("loihi", 100), ("loihi", 500), ("fast", 100), ("fast", 500)):
        config = integer_config(preset(name), "timing")
        steps = config.network.steps - silent_steps(places, False)
        encoder = json.dumps(to_dict(config)["encoder"])
        made += [VersionCase(name, encoder, places, steps, regular) for regular in (True, False)]
    return made


def python_of(checkout: Path) -> Path:
    """The Python of a checkout.

    Raises:
        InputError: it has none of its own.
    """
    python = checkout / ".venv" / "bin" / "python"
    if not python.exists():
        raise InputError(f"{checkout}: has no .venv; run make lint there, or name another checkout")
    return python


class Worker:
    """A process that runs cases in a checkout when it is told to.

    Args:
        checkout: The folder of a checkout that has a ``.venv``.
        cases: What it runs.
    Raises:
        InputError: it has no Python of its own.
    """

    def __init__(self, checkout: Path, cases: list[VersionCase]) -> None:
        self._checkout = checkout
        self._process = subprocess.Popen(
            [python_of(checkout), SCRIPT, json.dumps([asdict(case) for case in cases])],
            cwd=checkout,
            env={**os.environ, "PYTHONPATH": str(checkout)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def run(self, case: int) -> dict[str, float]:
        """What `runner` says of a case, once.

        Raises:
            InputError: the worker has ended.
        """
        if self._process.stdin is None or self._process.stdout is None:
            raise InputError("the worker has no pipes")
        print(case, file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        if not line:
            raise InputError(f"{self._checkout}: its worker failed, see above; name another checkout")
        said: dict[str, float] = json.loads(line)
        return said


def cpu_flags() -> str:
    """The widest vector instructions of this processor, which decide most of the speed."""
    try:
        with open("/proc/cpuinfo") as file:
            flags = next((line for line in file if line.startswith("flags")), "").split()
    except OSError:
        return "unknown"
    return next((name for name in ("avx512f", "avx2", "avx") if name in flags), "none")


def row(case: VersionCase, here: list[dict[str, float]], there: list[dict[str, float]], other: Path) -> list[str]:
    """Microseconds of processor time a query of a case, here and in the checkout ``other``.

    Raises:
        InputError: the other checkout has not the same input spikes.
    """
    if here[0]["input_spikes"] != there[0]["input_spikes"]:
        raise InputError(f"{other}: its input spikes are not those of this checkout; name a nearer one")
    least = [1e6 * min(said["seconds"] for said in side) for side in (here, there)]
    return [
        f"{case.preset}, {'regular' if case.regular else 'Poisson'}",
        *(f"{value:,.0f}" for value in (case.places, case.steps, here[0]["input_spikes"])),
        *(f"{side[0]['exc_spikes']:.1f}" for side in (here, there)),
        *(f"{value:.1f}" for value in least),
        f"{least[1] / least[0]:.2f}",
    ]


@program("nordland")
@click.argument("other", type=click.Path(exists=True, file_okay=False, resolve_path=True, path_type=Path))
@click.option("--rounds", default=15, show_default=True, help="Turns with the other checkout.")
def main(other: Path, rounds: int) -> Printed:
    """Processor time a query of this checkout's host engine, beside that of another checkout."""
    every = cases()
    with ExitStack() as stack:
        workers = [stack.enter_context(Worker(checkout, every)) for checkout in (ROOT, other)]
        sides = [(number, side) for number in range(len(every)) for side in (0, 1)]
        taken = turns({(k, side): partial(workers[side].run, k) for k, side in sides}, rounds)
    columns = ["", "neurons", "steps", "input spikes", "exc, here", "exc, other", "us, here", "us, other", "ratio"]
    rows = [row(case, taken[number, 0], taken[number, 1], other) for number, case in enumerate(every)]
    title = f"processor time a query, one thread, least of {rounds} turns; vector instructions: {cpu_flags()}"
    yield BenchmarkTable(columns, rows, title=title)
