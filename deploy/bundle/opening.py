"""From a bundle back to what it holds: cores, host tables, network, model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.bundle import folder as bundle_folder
from lava_vpr.deploy.bundle import loihi2
from lava_vpr.deploy.bundle.folder import AGAIN, MANIFEST, Bundle
from lava_vpr.deploy.bundle.references import read_model
from lava_vpr.deploy.registers.core_images import CoreImage, HostTables, network_of
from lava_vpr.engine.inference.fixed import SCALARS, FixedNetwork
from lava_vpr.errors import BundleError
from lava_vpr.model import Model

CORES = "cores"
CORE_ARRAYS = ("compartments", "synapses", "axons_in", "axons_out")
HOST_TABLES = ("injection", "inputs", "exc", "inh")


def core_images(bundle: Bundle) -> tuple[CoreImage, ...]:
    """Every core of a Kapoho Bay bundle, by chip and core.

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
    """Where spikes go in and out of a Kapoho Bay bundle."""
    return HostTables(**{name: bundle.array(f"host/{name}.npy") for name in HOST_TABLES})


def scalars(bundle: Bundle) -> Mapping[str, int]:
    """The numbers of the network that the manifest tells.

    Raises:
        BundleError: one is missing or no whole number.
    """
    given = bundle.manifest.get("network")
    names = ("inputs", "neurons", "silent_steps", *SCALARS)
    if not isinstance(given, dict) or any(type(given.get(name)) is not int for name in names):
        raise BundleError(f"{bundle.path / MANIFEST}: does not describe the network; {AGAIN}")
    return {name: given[name] for name in names}


def network(bundle: Bundle) -> FixedNetwork:
    """The network of a bundle, rebuilt from its registers and memory (Loihi 2: from its Lava parameters).

    Raises:
        ModelFileError: they do not fit together.
    """
    if BOARDS[bundle.target].shifts_sum:
        return loihi2.network_of(bundle.files)
    return network_of(core_images(bundle), host_tables(bundle), scalars(bundle))


def open_bundle(path: Path) -> Model:
    """The model in the bundle at ``path``, its network rebuilt from what the board would get.

    Raises:
        BundleError: it is not intact.
    """
    whole = bundle_folder.load(path)
    rebuilt = network(whole)
    told = scalars(whole)
    for name, number in {"inputs": rebuilt.inputs, "neurons": rebuilt.neurons, **rebuilt.scalars}.items():
        if number != told[name]:
            raise BundleError(f"{path / MANIFEST}: says {name} {told[name]}, the registers say {number}; {AGAIN}")
    return replace(read_model(whole, rebuilt), bundle=path)
