"""The closed form of the cost model beside SANA-FE, component by component, on the same networks, mappings and spikes.

    [LAVA_VPR_DATA=...] python -m benchmarks sanafe.compare [--queries N] [--random N]      (`make sanafe` sets it up)

Real: models of summer images as they are deployed on Kapoho Bay, asked winter images: the default preset with 100 and
500 places, preset fast, other bits, pruned, without signs, Poisson trains, input compartments, under gains that a drive
learned. Random: networks of a few dozen neurons on boards shrunk until they need many cores and tiles, and scattered
over the mesh of both chips; half of them signed, with biases, some with others in each query; one so large that spikes
are injected through relays, and one whose inhibitory neuron has leaves. From pixels on (`benchmarks.sanafe.pixels`):
the spiking front end of 100 places, alone and with neurons that hear its cells. All figures are modelled. Fails where
energy or ``simple`` time is apart by more than 1e-6, in any step, or where SANA-FE's own spikes or counts are not ours.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.learning.replayed import gained
from benchmarks.places import encoded, learn, required
from benchmarks.program import Printed, program, verdict
from benchmarks.sanafe.cross_check import CrossCheck, cross_check
from benchmarks.sanafe.pixels import PixelsChecked, check_pixels
from lava_vpr.backends.interface import HostBackend, Presentations, query_presentations
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.boards.memory import PackedRows
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.bundle.compression import Changes, for_board
from lava_vpr.deploy.bundle.deployment import plan_of
from lava_vpr.deploy.bundle.front_end import front_end_of
from lava_vpr.deploy.mapping.partition import partition
from lava_vpr.engine.inference.counting import count_spikes, inhibitory_spikes
from lava_vpr.engine.inference.fixed import DIRECT, FixedNetwork
from lava_vpr.engine.inference.quantise import RATE_UNIT, biases_of
from lava_vpr.engine.presentations import PixelBlock, Trains
from lava_vpr.engine.random import image_keys, presentation_keys
from lava_vpr.engine.rates import draw_trains
from lava_vpr.inputs.encoder import Keep
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.loihi import NO_MEMORY_DECAY, TILE_CORES
from lava_vpr.model import Model
from lava_vpr.show.table import Table

LIMIT = 1e-6
SEEDS = (0, 2, 3, 5, 7, 8, 16, 18, 22, 27, 28, 31, 39)
"""Random networks: 1 to 36 tiles, so every entry of the barrier's table; in some of them zeros of dense rows reach
membranes that are 0, which SANA-FE updates and the chip's registers do not tell from idle ones."""

MANY = {8: 4_200, 22: 1_100}
"""Neurons of the random networks with leaves and relays."""


@dataclass(frozen=True)
class SanafeCase:
    """A plan and spikes that are compared; `cross_check` has ``input_core`` and ``bias``."""

    name: str
    plan: Plan
    trains: Trains
    input_core: bool = True
    bias: NDArray[np.int32] | None = None


def real(name: str, model: Model, queries: int) -> SanafeCase:
    """A model on Kapoho Bay, and winter images spread over its places."""
    chosen = np.linspace(0, model.places - 1, queries).astype(np.int64)
    images = encoded("winter", model.config.encoder).take(chosen)
    return presented(name, model, query_presentations(model, images))


def presented(name: str, model: Model, shown: Presentations) -> SanafeCase:
    """A model on Kapoho Bay, and what it is shown."""
    return SanafeCase(name, plan_of(model, KAPOHO_BAY), HostBackend().trains(model, shown), bias=shown.bias)


def real_cases(queries: int) -> Iterator[SanafeCase]:
    """Models of real images, with queries of another season."""
    small, large = (learn((0, places), preset("loihi")) for places in (100, 500))
    default = real("100 places, preset loihi", small, queries)
    yield default
    yield replace(default, name="the same, injecting takes no time", input_core=False)
    yield real("500 places", large, queries)
    fast = for_board(learn((0, 100), preset("fast")), KAPOHO_BAY).model
    yield real("100 places, preset fast", fast, queries)
    for bits, prune in ((2, 0.5), (1, 0.0), (5, 0.0)):
        made = for_board(small, KAPOHO_BAY, Changes(weight_bits=bits, prune=prune)).model
        yield real(f"100 places, {bits} bit{'s' * (bits > 1)}{f', {prune:.0%} pruned' if prune else ''}", made, queries)
    for name, changes in (("without signs", {"signed": False}), ("Poisson trains", {"trains": "poisson"})):
        made = learn((0, 100), update(preset("loihi"), {"network": changes}))
        yield real(f"100 places, {name}", made, queries)
    for name, model in (("100", small), ("500", large)):
        made = for_board(model, KAPOHO_BAY, Changes(input_mode="bias")).model
        yield real(f"{name} places, input compartments", made, queries)
        drive = encoded("winter", model.config.encoder).take(slice(0, model.places))
        yield presented(f"{name} places, under gains", model, gained(model, drive, queries))
        yield presented(f"{name} places, input compartments, under gains", made, gained(made, drive, queries))


def random_network(seed: int, rng: np.random.Generator, rates: NDArray[np.uint16], neurons: int) -> FixedNetwork:
    """A network that spikes at ``rates`` (queries, inputs); of some, membranes forget at once."""
    inputs, signed, bias_input = rates.shape[1], bool(seed // 2 % 2), bool(seed % 2)
    bits = int(rng.integers(1, 8))
    share = rng.uniform(0.1, 0.9) if neurons < DIRECT else 0.2
    weights = rng.integers(1, 1 << bits, (inputs, neurons)) * (rng.random((inputs, neurons)) < share)
    if signed:
        weights *= rng.choice([-1, 1], weights.shape)
    drives = rates.astype(np.float64) @ weights / (1 << 16)
    usual = drives.mean(axis=0) if signed else np.zeros(neurons)
    threshold = max(1, int((drives - usual).max() * rng.uniform(1.0, 6.0)))
    made = FixedNetwork(
        weights=weights.astype(np.int16),
        bias=np.zeros(neurons, np.int32),
        bits=bits,
        signed=signed,
        threshold=threshold,
        inhibition=int(rng.choice([0, min(127, threshold // 2), min(127, threshold)])),
        inhibition_exponent=0,
        decay=NO_MEMORY_DECAY if seed % 5 == 2 else int(rng.integers(50, 900)),
        steps=40,
        regular=bias_input or seed % 3 == 1,
        bias_input=bias_input,
    )
    return replace(made, bias=biases_of(usual, made.highest_bias))


def random_case(seed: int, queries: int = 2) -> SanafeCase:
    """A random network on a board shrunk around it; every third one scattered over both chips."""
    rng = np.random.default_rng([seed, 6])
    neurons, inputs = MANY.get(seed, int(rng.integers(12, 60))), int(rng.integers(20, 80))
    rates = (rng.random((queries, inputs)) * rng.uniform(3_000, 20_000)).astype(np.uint16)
    made = random_network(seed, rng, rates, neurons)
    board = replace(KAPOHO_BAY, compartments=neurons // 12)
    if seed not in MANY:
        compartments = int(rng.integers(3, 7) if seed % 3 == 0 else rng.integers(8, 40))
        words = max(int(rng.integers(inputs * 2, inputs * 6)), 2 * neurons)
        cores, memory = int(rng.integers(16, 129)), PackedRows(words)
        board = replace(KAPOHO_BAY, cores=cores, compartments=compartments, memory=memory)
    plan = partition(made, board, rates.mean(axis=0) / (1 << 16), dense_rows=True)
    if seed % 3 == 0:
        plan = scattered(plan, rng)
    keys = presentation_keys(seed, "query", image_keys(rates))
    bias = None
    if made.signed and seed % 3 == 1:
        bias = biases_of(made.drives(rates) / RATE_UNIT * rng.integers(0, 3, (queries, neurons)), made.highest_bias)
    _, _, exc = count_spikes(made, rates, keys, bias=bias, raster=True)
    spikes = draw_trains(rates, keys, made.steps, made.interval, regular=made.regular)
    kind = "input compartments" if made.bias_input else "through relays" if made.relayed else "injected"
    kind = ("signed, " if made.signed else "") + kind + (", leaves" if made.leaves else "")
    kind += "" if bias is None else ", biases of each query"
    if seed % 3 == 0:
        kind += ", scattered"
    name = f"random {seed}: {neurons:,} neurons on {len(plan.cores)} cores, {kind}"
    return SanafeCase(name, plan, Trains(exc, spikes, inhibitory_spikes(made, exc)), seed % 4 < 2, bias)


def scattered(plan: Plan, rng: np.random.Generator) -> Plan:
    """The plan with each core on a tile of its own, anywhere on both chips of Kapoho Bay."""
    tiles = np.sort(rng.choice(KAPOHO_BAY.chips * KAPOHO_BAY.cores // TILE_CORES, len(plan.cores), replace=False))
    positions = tiles * TILE_CORES + rng.integers(0, TILE_CORES, tiles.size)
    order = rng.permutation(len(plan.cores))
    cores = [
        replace(plan.cores[i], chip=int(position) // KAPOHO_BAY.cores, core=int(position) % KAPOHO_BAY.cores)
        for i, position in zip(order, positions, strict=True)
    ]
    return replace(plan, board=KAPOHO_BAY, cores=tuple(cores))


def pixel_cases(queries: int) -> Iterator[tuple[str, FrontEnd, PixelBlock]]:
    """The spiking front end of 100 places, alone and with the neurons that hear its cells, and images of winter."""
    for kind, name in (("frontend", "the spiking front end"), ("frontend-direct", "pixels to places in one run")):
        model = learn((0, 100), update(preset("loihi"), {"encoder": {"kind": kind}}))
        chosen = np.linspace(0, model.places - 1, queries).astype(np.int64)
        grey = encoded("winter", model.config.encoder).take(chosen).kept(Keep.GREY, "the comparison")
        spec = front_end_of(model)
        if spec is not None:
            yield f"100 places, {name}", spec, PixelBlock(grey)


def pixel_failures(checked: PixelsChecked) -> list[str]:
    """Whatever must not be of a network from pixels on, a line each."""
    lines = [] if checked.difference <= LIMIT else [f"apart by {checked.difference}"]
    silent = [name for name, (ours, _) in checked.counts.items() if not ours.all()]
    return lines + [f"no {name}, so little was compared" for name in silent]


def failures(case: SanafeCase, checked: CrossCheck) -> list[str]:
    """Whatever of the comparison must not be, a line each; none if all is well."""
    lines = []
    if not checked.difference <= LIMIT:
        lines.append(f"apart by {checked.difference}")
    if checked.spikes_differ:
        lines.append(f"{checked.spikes_differ} of SANA-FE's own spikes are not ours")
    pairs = checked.counts.items()
    lines += [f"{name}: {ours:g}, SANA-FE {theirs:g}" for name, (ours, theirs) in pairs if ours != theirs]
    if not case.trains.exc.any():
        lines.append("no neuron spiked, so little was compared")
    return lines


def row(name: str, pair: tuple[float, float], digits: str) -> list[str]:
    """A row of the table: both figures, and how far they are apart."""
    ours, theirs = pair
    apart = "0" if ours == theirs else f"{abs(ours - theirs) / max(abs(ours), abs(theirs)):.1e}"
    return [name, f"{ours:{digits}}", f"{theirs:{digits}}", apart]


def pixel_rows(name: str, checked: PixelsChecked) -> Iterator[list[str]]:
    """A part of the table for a network from pixels on, mean over the images."""
    yield [name, "", "", f"{checked.difference:.1e}"]
    for what, pair in checked.microjoules.items():
        yield row(f"  {what}, uJ", (float(pair[0].mean()), float(pair[1].mean())), ",.8g")
    for what, pair in checked.counts.items():
        yield row(f"  {what}", (float(pair[0].mean()), float(pair[1].mean())), ",.12g")


def rows(case: SanafeCase, checked: CrossCheck) -> Iterator[list[str]]:
    """A part of the table: figures of a query, mean over the queries."""
    yield [case.name, "", "", f"{checked.difference:.1e}"]
    for name, pair in checked.microjoules.items():
        yield row(f"  {name}, uJ", pair, ",.8g")
    yield row("  time, simple, ms", checked.simple_milliseconds, ",.8g")
    yield ["  time, detailed, ms", "", f"{checked.detailed_milliseconds:,.8g}", ""]
    for name, pair in checked.counts.items():
        yield row(f"  {name}", pair, ",.12g")


@program()
@click.option("--queries", default=2, show_default=True, help="Of each network.")
@click.option("--random", "count", default=0, show_default=True, help="More random networks.")
def main(queries: int, count: int) -> Printed:
    """Hold the closed form against SANA-FE."""
    cases: Iterator[SanafeCase] = (random_case(seed, queries) for seed in (*SEEDS, *range(100, 100 + count)))
    if os.environ.get("LAVA_VPR_DATA"):
        required("nordland")
        cases = chain(real_cases(queries), cases)
    else:
        yield "no real images: LAVA_VPR_DATA does not name them"
    bad, largest, lines, first = list[str](), 0.0, list[list[str]](), list[int]()
    for case in cases:
        checked = cross_check(case.plan, case.trains, input_core=case.input_core, bias=case.bias)
        bad += [f"{case.name}: {line}" for line in failures(case, checked)]
        first.append(len(lines))
        lines += rows(case, checked)
        largest = max(largest, checked.difference)
    for name, spec, images in pixel_cases(queries) if os.environ.get("LAVA_VPR_DATA") else ():
        seen = check_pixels(spec, images)
        bad += [f"{name}: {line}" for line in pixel_failures(seen)]
        first.append(len(lines))
        lines += pixel_rows(name, seen)
        largest = max(largest, seen.difference)
    title = f"modelled energy and time of a query, mean of {queries}; bold: largest difference of any query and step"
    columns = ("", "closed form", "SANA-FE", "relative difference")
    yield Table(columns, lines, title=title, strong=frozenset(first), rules=frozenset(first))
    well = f"{len(first)} networks equal within {LIMIT:g}, the largest difference is {largest:.1e}"
    yield from verdict(bad, well)
