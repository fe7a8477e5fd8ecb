"""Registers of bundles for Kapoho Bay, read by a reader of its own and run in nengo-loihi's emulator, beside the host.

    python -m benchmarks oracles.registers [BUNDLE ...] [--presentations N] [--no-real]      (`make oracles` sets it up)

Without BUNDLE: made-up networks on one and on several cores of both chips and, of real images (LAVA_VPR_DATA) as
`lava-vpr deploy` writes them, the default model of 100 and of 500 places, of 100 under the gains that a drive learns,
and of 100 from pixels, the network and its spiking front end. A BUNDLE is run on its own references. nengo-loihi
(1.1.0, in an environment of its own) gets the core files and the host's tables alone (`registers_in_nengo_loihi`) and
validates every core as one of its own blocks; every spike of every population must be the host's, and every counter
hold 128 a spike. What a board's program does to clear, inject, write and read out is no part of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.learning.replayed import gained
from benchmarks.oracles.inference import Made, made_up
from benchmarks.oracles.needs import PYTHON
from benchmarks.places import encoded, learn, required
from benchmarks.program import Printed, program, run_elsewhere, verdict
from lava_vpr.backends.interface import query_presentations
from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import KAPOHO_BAY, Board
from lava_vpr.deploy.boards.memory import PackedRows
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.deploy.bundle.front_end import FRONT_END, whole_of
from lava_vpr.deploy.bundle.targets import TARGETS, open_whole
from lava_vpr.deploy.mapping.partition import partition
from lava_vpr.engine.inference.biases import bias_registers
from lava_vpr.engine.inference.counting import count_spikes, inhibitory_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.random import presentation_keys
from lava_vpr.engine.rates import draw_trains
from lava_vpr.errors import InputError
from lava_vpr.inputs.encoder import Keep
from lava_vpr.model import integer_model
from lava_vpr.show.numbers import counted
from lava_vpr.show.table import Table
from lava_vpr.storage.writing import temporary_folder

SCRIPT = Path(__file__).with_name("registers_in_nengo_loihi.py")
PIXELS = {"encoder": {"kind": "frontend"}}
SMALL_CORES = replace(KAPOHO_BAY, compartments=9, cores=2)
"""A board on which small networks take many cores, of both chips."""

MADE_UP = (
    ("one core", Made(3, True, True, 40), KAPOHO_BAY, False),
    ("one core, dense rows", Made(3, True, True, 40), replace(KAPOHO_BAY, memory=PackedRows(110)), True),
    ("both chips", Made(6, True, False, 300), SMALL_CORES, False),
    ("without signs", Made(5, False, False, 200), SMALL_CORES, False),
    ("7 bits and sign, inhibition 2^1", Made(7, True, True, 500, exponent=1), SMALL_CORES, False),
    ("relays", Made(3, True, True, 30, inputs=40, neurons=1100, steps=28), KAPOHO_BAY, False),
    ("relays and leaves", Made(2, True, False, 20, inputs=24, neurons=4200, steps=27), KAPOHO_BAY, False),
)
"""Names, networks, boards, and whether rows may be dense."""


@dataclass(frozen=True)
class RegisterCase:
    """What is compared, n presentations.

    Attributes:
        name: For people.
        folder: Where ``cores`` and ``host`` of a bundle are.
        films: The host's spikes of each population by name, uint8 (n, steps, neurons).
        injected: Spikes that the host injects, bool (n, steps, inputs); None: none.
        mantissas: Biases that the host writes to a population before each presentation, int32 (n, neurons), by name.
        exponents: Those of each presentation, int32 (n,), of populations whose exponents it writes too.
    """

    name: str
    folder: Path
    films: Mapping[str, NDArray[np.uint8]]
    injected: NDArray[np.bool_] | None = None
    mantissas: Mapping[str, NDArray[np.int32]] = field(default_factory=dict)
    exponents: Mapping[str, NDArray[np.int32]] = field(default_factory=dict)

    @classmethod
    def of_network(
        cls,
        name: str,
        folder: Path,
        network: FixedNetwork,
        rates: NDArray[np.uint16],
        keys: NDArray[np.uint64],
        bias: NDArray[np.int32] | None = None,
    ) -> RegisterCase:
        """The place network of a bundle, whose inputs' spikes are injected.

        Args:
            name, folder: As above.
            network: The network that the bundle holds.
            rates, keys: Spike probabilities uint16 (n, inputs), and key of each presentation uint64 (n,).
            bias: Biases of exc in each presentation, in units of v, int32 (n, neurons); None: the network's own.
        """
        exc = count_spikes(network, rates, keys, raster=True, bias=bias)[2]
        films = {"exc": exc, "inh": inhibitory_spikes(network, exc)}
        spikes = draw_trains(rates, keys, network.steps, network.interval, regular=network.regular)
        written = {} if bias is None else {"exc": bias_registers(bias)}
        mantissas, exponents = ({key: each[k] for key, each in written.items()} for k in range(2))
        return cls(name, folder, films, spikes.astype(bool), mantissas, exponents)


@dataclass(frozen=True)
class ComparedRegisters:
    """What was read and compared: cores, synapses and axons, spikes of the host, spikes and counters that differ."""

    cores: int
    synapses: int
    axons: int
    spikes: int
    differ: int
    counters_differ: int


def written(folder: Path, network: FixedNetwork, board: Board, dense_rows: bool) -> Path:
    """The core files and tables of a made-up network, as a bundle has them.

    Raises:
        InputError: rows are dense though they should not be, or the other way round.
    """
    plan = partition(network, board, np.full(network.inputs, 5 / network.inputs), dense_rows=dense_rows)
    if any(core.dense_inputs.any() for core in plan.cores) != dense_rows:
        raise InputError(f"dense rows are {'missing' if dense_rows else 'not asked for'}; choose another network")
    return put(folder, TARGETS[KAPOHO_BAY.name].network_files(replace(plan, board=KAPOHO_BAY)))


def put(folder: Path, files: Mapping[str, bytes]) -> Path:
    """``folder``, with ``files`` in it by their names."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def made_up_cases(folder: Path, presentations: int) -> Iterator[RegisterCase]:
    """The networks of `MADE_UP`."""
    for number, (name, made, board, dense_rows) in enumerate(MADE_UP):
        network, few = made_up(made, bias=made.signed), presentations if made.neurons < 1000 else 1
        network = replace(network, inhibition=min(127, network.inhibition))
        rates = np.random.default_rng(number).integers(0, 12_000, (few, made.inputs)).astype(np.uint16)
        keys = presentation_keys(0, "query", np.arange(few))
        bundle = written(folder / f"{number}", network, board, dense_rows)
        yield RegisterCase.of_network(name, bundle, network, rates, keys)


def real_cases(folder: Path, presentations: int) -> Iterator[RegisterCase]:
    """Models of summer images as `deploy` writes them, and winter queries, spread over the places.

    Raises:
        InputError: LAVA_VPR_DATA does not name the images.
    """
    for places, inputs in ((100, {}), (500, {}), (100, PIXELS)):
        model = integer_model(learn((0, places), update(preset("loihi"), inputs)), KAPOHO_BAY.title)
        name, bundle = f"{places} places{', from pixels' if inputs else ''}", folder / f"{places}{'p' * len(inputs)}"
        plan = deploy(model, KAPOHO_BAY, bundle, picture=False).plan
        if any(core.dense_inputs.any() for core in plan.cores):
            raise InputError(f"{name}: the bundle has dense rows, which were not asked for")
        queries = encoded("winter", model.config.encoder).take(slice(places))
        chosen = np.linspace(0, places - 1, presentations).astype(np.int64)
        cases = {"real queries": query_presentations(model, queries).part(chosen)}
        if places == 100 and not inputs:
            cases["gains of a drive"] = gained(model, queries, presentations)
        for how, some in cases.items():
            own = some.rates, some.keys, some.bias
            yield RegisterCase.of_network(f"{name}, {how}", bundle, model.network, *own)
        if (spec := model.config.encoder.front_end) is not None:
            grey = queries.take(chosen).kept(Keep.GREY, "comparing the front end")
            written = {"pixels": grey.reshape(len(grey), -1).astype(np.int32)}
            yield RegisterCase(f"{name}, the front end", bundle / FRONT_END, spec.trains(grey), mantissas=written)


def pixels_to_places(folder: Path, presentations: int) -> Iterator[RegisterCase]:
    """A model whose neurons hear the cells themselves, as `deploy` writes it, and winter queries.

    Raises:
        InputError: LAVA_VPR_DATA does not name the images.
    """
    config = update(preset("loihi"), {"encoder": {"kind": "frontend-direct"}})
    model, bundle = integer_model(learn((0, 100), config), KAPOHO_BAY.title), folder / "direct"
    deploy(model, KAPOHO_BAY, bundle, picture=False)
    chosen = np.linspace(0, 99, presentations).astype(np.int64)
    grey = encoded("winter", config.encoder).take(chosen).kept(Keep.GREY, "comparing the front end")
    spec = whole_of(model)
    clock = np.zeros((len(grey), spec.populations["clock"]), np.int32)
    clock[:, 0] = 1
    written = {"pixels": grey.reshape(len(grey), -1).astype(np.int32), "clock": clock}
    yield RegisterCase(
        "100 places, pixels to places in one run", bundle / FRONT_END, spec.trains(grey), mantissas=written
    )


def bundle_case(path: Path, presentations: int) -> RegisterCase:
    """A bundle and its first references.

    Raises:
        BundleError: it is none.
        InputError: it is for another board, or its inputs integrate a bias.
    """
    bundle, model = open_whole(path)
    network = integer_model(model, KAPOHO_BAY.title).network
    if bundle.target != KAPOHO_BAY.name or network.bias_input:
        raise InputError(
            f"{path}: is no bundle for Kapoho Bay whose input spikes are injected; deploy the model with --target "
            f"{KAPOHO_BAY.name} --input-mode injected"
        )
    rates, keys = (bundle.array(f"host/{name}.npy")[:presentations] for name in ("rates", "keys"))
    return RegisterCase.of_network(path.name, path, network, rates, keys)


def emulated(case: RegisterCase) -> dict[str, NDArray[np.int64]]:
    """What nengo-loihi's emulator makes of a bundle's files and of what is presented.

    Raises:
        InputError: its environment is missing, or it failed.
    """
    with temporary_folder() as folder:
        (folder / "bundle").symlink_to(case.folder.resolve())
        if case.injected is not None:
            np.save(folder / "spikes.npy", case.injected)
        np.savez(folder / "mantissas.npz", **case.mantissas)
        np.savez(folder / "exponents.npz", **case.exponents)
        shape = next(iter(case.films.values())).shape[:2]
        run_elsewhere("nengo-loihi", PYTHON, "oracles", SCRIPT, folder, *map(str, shape), *case.films)
        with np.load(folder / "spikes.npz", allow_pickle=False) as found:
            return {name: found[name].astype(np.int64) for name in found.files}


def compared(case: RegisterCase) -> ComparedRegisters:
    """Every spike and counter of a bundle in nengo-loihi's emulator beside the host's."""
    found = emulated(case)
    differ = sum(int((found[name] != own).sum()) for name, own in case.films.items())
    counted = case.films.get("exc", np.zeros((len(found["counted"]), 0, 0)))  # a front end has no counters
    counters = counted.sum(axis=1, dtype=np.int64) << 7
    spikes = sum(int(film.sum()) for film in case.films.values())
    return ComparedRegisters(*found["read"].tolist(), spikes, differ, int((found["counted"] != counters).sum()))


@program()
@click.argument("bundles", nargs=-1, type=click.Path(path_type=Path))
@click.option("--presentations", default=4, show_default=True, help="Of each bundle.")
@click.option("--real/--no-real", default=True, help="Also models trained on real images (LAVA_VPR_DATA).")
def main(bundles: Sequence[Path], presentations: int, real: bool) -> Printed:
    """Registers of bundles in nengo-loihi's emulator, and the host; fails if anything differs."""
    if real and not bundles:
        required("nordland")
    failed, rows, spikes = list[str](), list[list[str]](), 0
    with temporary_folder() as folder:
        cases = [bundle_case(path, presentations) for path in bundles]
        made = () if bundles else made_up_cases(folder, presentations)
        learned: Iterable[RegisterCase] = ()
        if real and not bundles:
            learned = chain(real_cases(folder, presentations), pixels_to_places(folder, presentations))
        for case in chain(cases, made, learned):
            result = compared(case)
            if result.spikes == 0 or result.differ or result.counters_differ:
                failed.append(f"{case.name}: {result}")
            rows.append([case.name, *(f"{value:,}" for value in vars(result).values())])
            spikes += result.spikes
    columns = ("", "cores", "synapses", "axons", "spikes", "differ", "counters differ")
    yield Table(columns, rows, title="registers of bundles in nengo-loihi's emulator, and the host")
    ran = counted(len(rows), "bundle")
    yield from verdict(failed, f"{ran}, {spikes:,} spikes: each spike and counter is the host's")
