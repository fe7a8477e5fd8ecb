"""The network part of a Loihi 1 bundle: registers, memory and axons of every core, and the host's tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.bundle.folder import AGAIN, MANIFEST, Bundle, array_bytes, json_bytes
from lava_vpr.deploy.registers import core_images as registers
from lava_vpr.deploy.registers.core_images import CoreImage, HostTables
from lava_vpr.deploy.registers.simulator import Chips
from lava_vpr.engine.inference.fixed import SCALARS, FixedNetwork
from lava_vpr.errors import BundleError

CORES = "cores"
CORE_ARRAYS = ("compartments", "synapses", "axons_in", "axons_out")
HOST_TABLES = ("injection", "inputs", "exc", "inh")


class Spikes(NamedTuple):
    """Every spike of some presentations: uint8 (n, steps, neurons) of exc and inh, (n, steps, inputs) of the inputs."""

    exc: NDArray[np.uint8]
    inh: NDArray[np.uint8]
    inputs: NDArray[np.uint8]


Player = Callable[[NDArray[np.uint16], NDArray[np.uint64]], Spikes]
"""Simulates a bundle: from rates uint16 (n, inputs) and keys uint64 (n,) to spikes."""


def network_files(plan: Plan) -> dict[str, bytes]:
    """Files of a bundle that hold the network of ``plan``, by name."""
    files = {}
    for image in registers.core_images(plan):
        folder = f"{CORES}/chip{image.chip}-core{image.core:03d}"
        files[f"{folder}/registers.json"] = json_bytes(image.registers)
        for name in CORE_ARRAYS:
            files[f"{folder}/{name}.npy"] = array_bytes(getattr(image, name))
    tables = registers.host_tables(plan)
    return files | {f"host/{name}.npy": array_bytes(getattr(tables, name)) for name in HOST_TABLES}


def core_images(bundle: Bundle) -> tuple[CoreImage, ...]:
    """Every core of a bundle, by chip and core.

    Raises:
        BundleError: a file is missing or of the wrong kind.
    """
    images = []
    for folder in bundle.folders(CORES):
        chip, core = (int("".join(c for c in word if c.isdigit())) for word in folder.split("/")[-1].split("-"))
        arrays = {name: bundle.array(f"{folder}/{name}.npy") for name in CORE_ARRAYS}
        images.append(CoreImage(chip=chip, core=core, registers=bundle.json(f"{folder}/registers.json"), **arrays))
    return tuple(images)


def host_tables(bundle: Bundle) -> HostTables:
    """Where spikes go in and out of a bundle's cores.

    Raises:
        BundleError: a file is missing or of the wrong kind.
    """
    return HostTables(**{name: bundle.array(f"host/{name}.npy") for name in HOST_TABLES})


def scalars(bundle: Bundle) -> Mapping[str, int]:
    """The numbers of the network that the manifest tells.

    Raises:
        BundleError: one is missing or no whole number.
    """
    described = bundle.manifest.get("network")
    names = ("inputs", "neurons", "silent_steps", *SCALARS)
    if not isinstance(described, dict) or any(type(described.get(name)) is not int for name in names):
        raise BundleError(f"{bundle.path / MANIFEST}: does not describe the network; {AGAIN}")
    return {name: described[name] for name in names}


def network(bundle: Bundle) -> FixedNetwork:
    """The network of a bundle, rebuilt from the registers and memory of its cores.

    Raises:
        BundleError: a file is missing or of the wrong kind.
        ModelFileError: the files do not fit together.
    """
    return registers.network_of(core_images(bundle), host_tables(bundle), scalars(bundle), BOARDS[bundle.target])


def player(bundle: Bundle) -> Player:
    """A simulation of the registers and memory of a bundle's cores; they are read once."""
    numbers = scalars(bundle)
    chips = Chips.of(
        core_images(bundle),
        host_tables(bundle),
        steps=numbers["steps"],
        silent_steps=numbers["silent_steps"],
        bias_input=bool(numbers["regular"]),
    )
    return lambda rates, keys: Spikes(*chips.run(rates, keys))
