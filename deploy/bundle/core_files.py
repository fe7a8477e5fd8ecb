"""The network part of a Loihi 1 bundle: registers, memory and axons of every core, and the host's tables."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.bundle.folder import AGAIN, MANIFEST, ReadBundle, array_bytes, json_bytes
from lava_vpr.deploy.registers import core_images as registers, rebuilding
from lava_vpr.deploy.registers.core_images import CoreImage, HostTables
from lava_vpr.deploy.registers.simulator import Chips
from lava_vpr.engine.inference.fixed import OF_DIRECT, SCALARS, FixedNetwork
from lava_vpr.errors import BundleError, LavaVprError, ModelFileError, brief
from lava_vpr.loihi import INPUT_LIMIT, WEIGHT_BITS
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
_CORE = re.compile(r"chip(\d)-core(\d{3})")
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
    return files_of(registers.core_images(plan), registers.host_tables(plan))


def files_of(images: Iterable[CoreImage], tables: HostTables) -> dict[str, bytes]:
    """Files of a bundle that hold the content of all cores, and where spikes go in and out of them, by name."""
    return image_files(images) | {HOST_TABLE.format(name): array_bytes(getattr(tables, name)) for name in HOST_TABLES}


def image_files(images: Iterable[CoreImage], cores: str = CORES) -> dict[str, bytes]:
    """Files of a bundle that hold the content of cores, in the folder ``cores``, by name."""
    files = {}
    for image in images:
        folder = f"{cores}/chip{image.chip}-core{image.core:03d}"
        files[f"{folder}/registers.json"] = json_bytes(image.registers)
        for name in CORE_ARRAYS:
            files[f"{folder}/{name}.npy"] = array_bytes(getattr(image, name))
    return files


def core_images(bundle: ReadBundle, cores: str = CORES) -> tuple[CoreImage, ...]:
    """Every core in the folder ``cores`` of a bundle, by chip and core.

    Raises:
        BundleError: a file is missing, too much or of the wrong kind.
    """
    board, images = BOARDS[bundle.target], []
    folders: defaultdict[str, set[str]] = defaultdict(set)
    for folder, _, file in (name.rpartition("/") for name in bundle.files if name.startswith(f"{cores}/")):
        folders[folder].add(file)
    for folder, files in sorted(folders.items()):
        known = _CORE.fullmatch(folder.removeprefix(f"{cores}/"))
        chip, core = (int(known[1]), int(known[2])) if known is not None else (board.chips, board.cores)
        if chip >= board.chips or core >= board.cores or files != _CORE_FILES:
            raise BundleError(f"{bundle.at(folder)}: is no core of {board.title}, or lacks files; {AGAIN}")
        arrays = {name: bundle.array(f"{folder}/{name}.npy", *CORE_ARRAYS[name]) for name in CORE_ARRAYS}
        images.append(CoreImage(chip=chip, core=core, registers=bundle.json(f"{folder}/registers.json"), **arrays))
    return tuple(images)


def host_tables(bundle: ReadBundle) -> HostTables:
    """Where spikes go in and out of a bundle's cores.

    Raises:
        BundleError: a file is missing or of the wrong kind.
    """
    network = rebuilding.outline(scalars(bundle))
    counts: dict[str, int | str] = {
        "injection": "axons",
        "inputs": network.input_compartments,
        "exc": network.neurons,
        "counters": network.neurons,
        "inh": network.inhibitory,
    }
    shapes = {name: (counts[name], columns) for name, columns in HOST_TABLES.items()}
    return HostTables(**{name: bundle.array(HOST_TABLE.format(name), np.int32, shapes[name]) for name in shapes})


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
    if OF_DIRECT[0] in described:
        for name, least, most in zip(OF_DIRECT, (1, 0), (numbers["steps"] - 1, INPUT_LIMIT), strict=True):
            if not whole(described.get(name)) or not least <= described[name] <= most:
                raise BundleError(f"{at}: has {name} {brief(described.get(name))}, of {least}..{most}; {AGAIN}")
            numbers[name] = described[name]
    silent = rebuilding.outline(numbers).silent_steps
    if numbers["silent_steps"] != silent:
        raise BundleError(f"{at}: says silent_steps {numbers['silent_steps']}, but its network has {silent}; {AGAIN}")
    return numbers


def network(bundle: ReadBundle) -> FixedNetwork:
    """The network of a bundle, rebuilt from the registers and memory of its cores, which are those of this network.

    Raises:
        BundleError: a file is missing or of the wrong kind, or differs from what this version writes of that network.
    """
    images, tables, numbers = core_images(bundle), host_tables(bundle), scalars(bundle)
    try:
        plan = rebuilding.rebuilt_plan(images, tables, numbers, BOARDS[bundle.target])
        files = network_files(plan)
    except ModelFileError as error:
        raise BundleError(f"{bundle.at(CORES)}: {error}") from None
    except (LookupError, ValueError, TypeError, OverflowError, LavaVprError) as error:
        raise BundleError(f"{bundle.at(CORES)}: hold no network of ours ({error}); {AGAIN}") from None
    bundle.demand(files)
    return plan.network


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
    return lambda rates, keys, bias=None: BundleSpikes(*chips.present(rates, keys, bias)[:3])
