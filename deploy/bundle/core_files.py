"""The network part of a Loihi 1 bundle: registers, memory and axons of every core, and the host's tables."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.bundle.folder import AGAIN, MANIFEST, ReadBundle, array_bytes, json_bytes
from lava_vpr.deploy.registers import core_images as registers
from lava_vpr.deploy.registers import rebuilding
from lava_vpr.deploy.registers.core_images import CoreImage, HostTables
from lava_vpr.deploy.registers.simulator import Chips
from lava_vpr.engine.inference.fixed import SCALARS, FixedNetwork
from lava_vpr.errors import BundleError, ModelFileError, brief
from lava_vpr.loihi import WEIGHT_BITS
from lava_vpr.settings.ranges import whole
from lava_vpr.storage.arrays import Shape
from lava_vpr.storage.limits import excess

CORES = "cores"
CORE_ARRAYS: dict[str, tuple[type, Shape]] = {
    "compartments": (np.int32, ("compartments", 4)),
    "synapses": (np.uint64, ("words",)),
    "axons_in": (np.int32, ("axons", 3)),
    "axons_out": (np.int32, ("axons", 4)),
}
"""The arrays of a core: type and shape of each."""

HOST_TABLES = {"injection": 4, "inputs": 3, "exc": 3, "counters": 3, "inh": 3}
"""The host's tables, and how many columns each has."""

HOST_TABLE = "host/{}.npy"
_CORE = re.compile(rf"{CORES}/chip(\d)-core(\d{{3}})")
_CORE_FILES = {"registers.json", *(f"{name}.npy" for name in CORE_ARRAYS)}
_MOST = (1 << 31) - 1
_RANGES = {"inputs": (1, _MOST), "neurons": (1, _MOST), "bits": (1, WEIGHT_BITS), "steps": (1, 100_000)}
_RANGES |= dict.fromkeys(("signed", "regular", "bias_input"), (0, 1))
"""Least and most of the numbers of a network; of others 0 and `_MOST`. Steps are as the settings allow them."""


class BundleSpikes(NamedTuple):
    """Every spike of some presentations, uint8 (n, steps, width), of exc, of inh (leaves, root) and of the inputs."""

    exc: NDArray[np.uint8]
    inh: NDArray[np.uint8]
    inputs: NDArray[np.uint8]


class BundlePlayer(Protocol):
    """Simulates a bundle."""

    def __call__(
        self, rates: NDArray[np.uint16], keys: NDArray[np.uint64], bias: NDArray[np.int32] | None = None
    ) -> BundleSpikes:
        """The spikes of presentations.

        Args:
            rates: Spikes a step in units of 2^-16, uint16 (n, inputs).
            keys: One key per presentation, uint64 (n,).
            bias: Biases of each presentation in units of v, int32 (n, neurons); None: always the bundle's.
        """
        ...


def network_files(plan: Plan) -> dict[str, bytes]:
    """Files of a bundle that hold the network of ``plan``, by name."""
    files = {}
    for image in registers.core_images(plan):
        folder = f"{CORES}/chip{image.chip}-core{image.core:03d}"
        files[f"{folder}/registers.json"] = json_bytes(image.registers)
        for name in CORE_ARRAYS:
            files[f"{folder}/{name}.npy"] = array_bytes(getattr(image, name))
    tables = registers.host_tables(plan)
    return files | {HOST_TABLE.format(name): array_bytes(getattr(tables, name)) for name in HOST_TABLES}


def core_images(bundle: ReadBundle) -> tuple[CoreImage, ...]:
    """Every core of a bundle, by chip and core.

    Raises:
        BundleError: a file is missing, too much or of the wrong kind, or counts from below 0.
    """
    board, images = BOARDS[bundle.target], []
    for folder, files in sorted(_core_folders(bundle).items()):
        known = _CORE.fullmatch(folder)
        chip, core = (int(known[1]), int(known[2])) if known is not None else (-1, -1)
        if not (0 <= chip < board.chips and 0 <= core < board.cores) or files != _CORE_FILES:
            raise BundleError(f"{bundle.at(folder)}: is no core of {board.title}, or lacks files; {AGAIN}")
        arrays = {name: bundle.array(f"{folder}/{name}.npy", *CORE_ARRAYS[name]) for name in CORE_ARRAYS}
        for name in ("axons_in", "axons_out"):
            _from_0(bundle, f"{folder}/{name}.npy", arrays[name])
        images.append(CoreImage(chip=chip, core=core, registers=bundle.json(f"{folder}/registers.json"), **arrays))
    if not images:
        raise BundleError(f"{bundle.at(CORES)}: holds no core; {AGAIN}")
    return tuple(images)


def _core_folders(bundle: ReadBundle) -> dict[str, set[str]]:
    """The folders of cores, and the names of the files in each."""
    found: dict[str, set[str]] = {}
    for name in bundle.files:
        folder, _, file = name.rpartition("/")
        if name.startswith(f"{CORES}/"):
            found.setdefault(folder, set()).add(file)
    return found


def _from_0(bundle: ReadBundle, file: str, numbers: NDArray[np.int32]) -> NDArray[np.int32]:
    """``numbers`` of chips, cores, compartments and axons, none of them below 0, which would count from the end.

    Raises:
        BundleError: naming one that is.
    """
    if numbers.min(initial=0) < 0:
        raise BundleError(f"{bundle.at(file)}: names number {numbers.min()}, but numbers count from 0; {AGAIN}")
    return numbers


def within(bundle: ReadBundle, file: str, name: str, values: NDArray[Any], end: int, first: int = 0) -> None:
    """Refuse ``values`` of a bundle's file that are not all in ``first`` .. ``end`` - 1.

    Raises:
        BundleError: naming one that is not.
    """
    wrong = (values < first) | (values >= end)
    if wrong.any():
        raise BundleError(f"{bundle.at(file)}: names {name} {values[wrong][0]}, of {first}..{end - 1}; {AGAIN}")


def host_tables(bundle: ReadBundle) -> HostTables:
    """Where spikes go in and out of a bundle's cores.

    Raises:
        BundleError: a file is missing or of the wrong kind, or counts from below 0.
    """
    network = rebuilding.outline(scalars(bundle))
    counts: dict[str, int | str] = {
        "injection": "axons",
        "inputs": network.input_compartments,
        "exc": network.neurons,
        "counters": network.neurons,
        "inh": network.inhibitory,
    }
    files = {name: HOST_TABLE.format(name) for name in HOST_TABLES}
    return HostTables(
        **{
            name: _from_0(bundle, file, bundle.array(file, np.int32, (counts[name], HOST_TABLES[name])))
            for name, file in files.items()
        }
    )


def scalars(bundle: ReadBundle) -> Mapping[str, int]:
    """The numbers of the network that the manifest tells, and how large it is.

    Raises:
        BundleError: one is missing, no whole number or out of range, or contradicts another, or the network is beyond a
            limit.
    """
    described, at = bundle.manifest.get("network"), bundle.at(MANIFEST)
    names = ("inputs", "neurons", "silent_steps", *SCALARS)
    if not isinstance(described, dict):
        raise BundleError(f"{at}: does not describe the network; {AGAIN}")
    for name in names:
        least, most = _RANGES.get(name, (0, _MOST))
        if not whole(described.get(name)) or not least <= described[name] <= most:
            said = brief(described.get(name))
            raise BundleError(f"{at}: does not describe the network ({name} {said}, of {least}..{most}); {AGAIN}")
    beyond = excess("model_bytes", 2 * described["inputs"] * described["neurons"])
    if beyond is not None:
        raise BundleError(f"{at}: describes a network whose weights take {beyond}")
    numbers = {name: described[name] for name in names}
    silent = rebuilding.outline(numbers).silent_steps
    if numbers["silent_steps"] != silent:
        raise BundleError(f"{at}: says silent_steps {numbers['silent_steps']}, but its network has {silent}; {AGAIN}")
    return numbers


def network(bundle: ReadBundle) -> FixedNetwork:
    """The network of a bundle, rebuilt from the registers and memory of its cores, which are those of this network.

    Raises:
        BundleError: a file is missing or of the wrong kind, or differs from what this version writes of that network.
    """
    try:
        images, tables = core_images(bundle), host_tables(bundle)
        return rebuilding.network_of(images, tables, scalars(bundle), BOARDS[bundle.target])
    except BundleError:
        raise
    except ModelFileError as error:
        raise BundleError(f"{bundle.at(CORES)}: {error}") from None


def player(bundle: ReadBundle) -> BundlePlayer:
    """A simulation of the registers and memory of a bundle's cores, which `network` has seen; they are read once.

    Raises:
        BundleError: see `network`.
    """
    numbers = scalars(bundle)
    chips = Chips.of(
        core_images(bundle),
        host_tables(bundle),
        steps=numbers["steps"],
        silent_steps=numbers["silent_steps"],
        regular=bool(numbers["regular"]),
        bias_input=bool(numbers["bias_input"]),
    )
    return lambda rates, keys, bias=None: BundleSpikes(*chips.run(rates, keys, bias))
