"""Proofs as tables: each row is a command and what it prints; one that compares fails if anything differs.

    LAVA_VPR_DATA=... python -m benchmarks commands.proofs exactness [--row 2 ...] [--record]

Rows that are not asked for stay as their record has them. Commands run in a shell in this checkout; ``$T`` is a folder
that goes afterwards.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import click

from benchmarks import figures
from benchmarks.program import ROOT, BenchmarkTable, Printed, program
from lava_vpr.errors import InputError
from lava_vpr.storage.writing import temporary_folder


class Proof(NamedTuple):
    """What is compared, the command that does, and a pattern whose groups are the figures that it prints."""

    what: str
    command: str
    printed: str


def fitted(places: int) -> Proof:
    """What a map of reference images takes."""
    train = f"lava-vpr train $LAVA_VPR_DATA/data/nordland/summer --places 0:{places} -o $T/m.lvpr"
    printed = r"(?s)0:0 .*? │ +(\d\d\.\d %) │.*?all +│ (\d+ of 256 cores) .*?to take ([\d.]+ ms).*?, a step ([\d.]+ µs)"
    what = f"{places} places: synapse memory of the first core, cores; a query of reference images, a step, modelled"
    return Proof(what, f"{train} && lava-vpr fit $T/m.lvpr --target kapoho-bay", printed)


def under_gains(places: int) -> Proof:
    """A drive that learns gains: its table replayed, and on other backends."""
    drive, summer = "$LAVA_VPR_DATA/data/nordland/winter", "$LAVA_VPR_DATA/data/nordland/summer"
    query = f"lava-vpr query $T/m.lvpr {drive} --places 0:{places}"
    backends = ("bundle", "lava-fixed", "lava-library")
    commands = (
        f"lava-vpr train {summer} --places 0:{places} -o $T/m.lvpr",
        f"{query} --learn --gains $T/g.lvpg -o $T/learned.csv",
        f"{query} --replay $T/g.lvpg -o $T/replayed.csv",
        "cmp $T/learned.csv $T/replayed.csv",
        f"lava-vpr verify $T/m.lvpr {drive} --replay $T/g.lvpg --limit {places} "
        + " ".join(f"--backend {name}" for name in backends),
    )
    printed = r"lava-library +│ (every spike equal) +│ +\d+ +│ +([\d,]+) +│ +([\d,]+) +│ +([\d,]+)"
    what = (
        f"{places} real queries that learn gains: answers replayed from the gain table are the same bytes; a bundle, "
        "`lava-fixed` and `lava-library` beside the host: products of activity and gain, spikes of exc and inh, of "
        "inputs"
    )
    return Proof(what, " && ".join(commands), printed)


SLOW = "pytest -m slow -s --timeout 1800"
PROOFS: Mapping[str, Sequence[Proof]] = {
    "exactness": (
        Proof(
            "20 real queries, input compartments: `lava-fixed`, `lava-library`, exc of `lava-fused`, and the host",
            f"{SLOW} tests/backends/test_verification.py -k 3-bias",
            r"lava-fixed: (\S+ spikes of exc and inh, \S+ in all)",
        ),
        under_gains(100),
        Proof(
            "random networks of LIF and dense synapses beside Lava's library, every spike and state",
            f"{SLOW} tests/engine/test_fuzz.py",
            r"(\d+ networks)",
        ),
        Proof(
            "random networks under random gains and biases: products of activity and gain, rates and every spike, by "
            "our Processes, Lava's library and the host",
            f"{SLOW} tests/processes/test_input_gains.py",
            r"(\d+ networks) under gains, (\S+ products, \S+ spikes)",
        ),
        Proof(
            "STDP beside Lava's `LearningDense`, every weight and trace in every step",
            f"{SLOW} tests/engine/test_learning_dense.py",
            r"(\d+ networks)",
        ),
        Proof(
            "brian2-loihi (it has no biases) and nengo-loihi's emulator, real queries under gains among them, every "
            "spike and membrane; what differs beyond the arithmetic that all define alike is explained by named rules",
            "python -m benchmarks oracles.compare",
            r"(\S+: \d+ networks)",
        ),
        Proof(
            "registers of bundles for Kapoho Bay in nengo-loihi's emulator, every spike and counter: 100 and 500 real "
            "places, the gains of a drive, the spiking front end from pixels on, and pixels to places in one run are "
            "among them",
            "python -m benchmarks oracles.registers",
            r"(\d+ bundles), (\S+ spikes)",
        ),
        Proof(
            "closed form of energy and time beside SANA-FE, real queries under gains among them; of two networks from "
            "pixels on messages and synaptic operations alone",
            "python -m benchmarks sanafe.compare",
            r"(\d+ networks) .*, (the largest difference is \S+)",
        ),
    ),
    "deployed": (
        fitted(100),
        fitted(500),
        Proof(
            "100 real queries: every spike of a bundle's simulation, and the host's",
            f"{SLOW} tests/backends/test_deployed_backends.py",
            r"(100 places, injected, kapoho-bay): (\S+ spikes, \S+ of exc and inh)",
        ),
        Proof(
            "random networks and boards: limits counted again from the bundle's bytes; every spike of some of them",
            f"{SLOW} tests/deploy/registers/test_deploy_fuzz.py",
            r"(\d+ networks, \d+ (?:of several cores|spikes))",
        ),
        Proof(
            "bits, axons, formats, decays and thresholds, ours and nengo-loihi's",
            "python -m benchmarks oracles.needs",
            r"(\d+ cores counted)",
        ),
    ),
}
"""The rows of each record."""


def compared(proof: Proof) -> str:
    """How much a command compares, as it prints it.

    Raises:
        InputError: it fails, or does not print it.
    """
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    with temporary_folder() as place:
        environment = os.environ | {"T": str(place), "PATH": path, "COLUMNS": "220"}
        words = ["sh", "-c", proof.command]
        run = subprocess.run(words, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True, check=False)
    said = chain.from_iterable(found.groups() for found in re.finditer(proof.printed, run.stdout))
    if run.returncode or not (made := ", ".join(said)):
        raise InputError(f"{proof.command}: exit code {run.returncode}, prints no {proof.printed}; run it and see why")
    return made


@program("nordland")
@click.argument("name", type=click.Choice(list(PROOFS)))
@click.option(
    "--row",
    "chosen",
    type=click.IntRange(1),
    multiple=True,
    help="Run these rows alone, counted from 1 (default: all).",
)
def main(name: str, chosen: Sequence[int]) -> Printed:
    """Run proofs."""
    if max(chosen, default=1) > len(PROOFS[name]):
        raise InputError(f"--row {max(chosen)}: {name} has {len(PROOFS[name])} rows; name one of them")
    known, rows = {what: much for what, much, _ in figures.read(name).rows} if chosen else {}, []
    for number, proof in enumerate(PROOFS[name], start=1):
        run = not chosen or number in chosen
        much = compared(proof) if run else known[proof.what]
        rows.append([proof.what, much, f"`{proof.command}`"])
    columns = ["what", "found", "command"]
    yield BenchmarkTable(columns, rows, title=name, words=3, long=frozenset({0, 2}), record=name)
