"""The spiking front end in a Loihi 1 bundle: cores and tables in the formats of the place network's, beside them.

The board's host program runs the place network alone; what plays these cores is the simulation of registers.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import BOARDS, Board
from lava_vpr.deploy.bundle.core_files import CORES, HOST_TABLE, core_images, image_files
from lava_vpr.deploy.bundle.folder import AGAIN, MANIFEST, ReadBundle, array_bytes
from lava_vpr.deploy.mapping.front_end import NO_AXONS
from lava_vpr.deploy.mapping.front_end_images import front_end_images
from lava_vpr.deploy.registers.front_end import FrontEndChips
from lava_vpr.engine.inference.whole import WholeNetwork
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.errors import BundleError, ConfigError, NetworkLimitError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.model import IntegerModel, Model, integer_model

FRONT_END = "front_end"
"""Its key in the manifest, and the folder of its files."""
_CORES, _TABLE = f"{FRONT_END}/{CORES}", f"{FRONT_END}/{HOST_TABLE}"

LEFT_OUT = "left_out"
"""The key of the reason why it is left out."""


def whole_of(model: IntegerModel, *, counted: bool = True) -> WholeNetwork:
    """The front end of ``model`` with the network that hears its cells.

    Args:
        model: The model.
        counted: Whether a board needs counters (`lava_vpr.deploy.boards.board.Board.counters`).
    Raises:
        ConfigError: no neuron hears the cells.
    """
    spec = model.config.encoder.direct
    if spec is None:
        raise ConfigError("these neurons do not hear the cells of a front end; train with --input frontend-direct")
    return WholeNetwork.of(spec, model.network, counted=counted)


def front_end_of(model: Model, *, counted: bool = True) -> FrontEnd | None:
    """The front end that a bundle of ``model`` holds, with the network that hears its cells and, if they are
    ``counted``, counters; None: it has none."""
    if model.config.encoder.direct is None:
        return model.config.encoder.front_end
    return whole_of(integer_model(model, "a bundle"), counted=counted)


FrontEndPlayer = Callable[[PixelBlock], Mapping[str, NDArray[np.uint8]]]
"""Every spike of each population by name, uint8 (n, steps, neurons), of some images."""


def barred(spec: FrontEnd, board: Board, *, holds: bool) -> str:
    """Why no bundle for ``board`` holds the front end, whatever its size; empty: nothing bars it.

    Args:
        spec: The front end.
        board: The board.
        holds: Whether bundles for ``board`` have files for a front end.
    """
    if not holds:
        return f"a bundle for {board.title} has no files for it"
    return NO_AXONS if spec.window else ""


def front_end_files(
    spec: FrontEnd | None, board: Board, taken: Sequence[tuple[int, int]], *, holds: bool = True
) -> tuple[dict[str, bytes], dict[str, Any] | None]:
    """The files of a front end by name, and what the manifest says of it: without files, why it is left out.

    Args:
        spec: The front end; None: the model has none.
        board: The board.
        taken: The cores of the place network, by chip and core.
        holds: Whether bundles for ``board`` have files for it.
    """
    if spec is None:
        return {}, None
    if why := barred(spec, board, holds=holds):
        return {}, {LEFT_OUT: why}
    try:
        found = front_end_images(spec, board, taken)
    except NetworkLimitError as error:
        return {}, {LEFT_OUT: str(error)}
    tables = {_TABLE.format(name): array_bytes(table) for name, table in found.tables.items()}
    facts = {"steps": spec.steps, "cores": len(found.cores), "populations": dict(spec.populations)}
    return image_files(found.cores, _CORES) | tables, facts


def held_sentence(said: Mapping[str, Any]) -> str:
    """What a bundle holds of a front end, for people, by what its manifest says."""
    if LEFT_OUT in said:
        return f"The bundle holds no spiking front end: {said[LEFT_OUT]}. The host counts the front end's spikes."
    if "interval" in said:
        return (
            "From pixels to places the network is made of Lava's LIFReset and Sparse alone, which Intel's compiler "
            f"places; it takes {said['steps']} steps, and neurons are reset every {said['interval']}."
        )
    if "exc" in said["populations"]:
        return f"From pixels to places the network stands on {said['cores']} cores, and takes {said['steps']} steps."
    return (
        f"The spiking front end stands on {said['cores']} cores more, which lava-vpr's --backend bundle simulates; the "
        "board's program runs the network alone, and the host counts the front end's spikes."
    )


def check_front_end(bundle: ReadBundle, model: Model, *, holds: bool = True) -> None:
    """Refuse a front end that is not what this version writes for ``model``, the bundle's, or that is there in part.

    Args:
        bundle: The bundle.
        model: Its model.
        holds: Whether bundles for its board have files for a front end.
    Raises:
        BundleError: it is another.
    """
    said, held = bundle.manifest.get(FRONT_END), {name for name in bundle.files if name.startswith(f"{FRONT_END}/")}
    if said is None and not held:
        return
    taken = [(image.chip, image.core) for image in core_images(bundle)]
    files, facts = front_end_files(model.config.encoder.front_end, BOARDS[bundle.target], taken, holds=holds)
    if facts is None or json.dumps(said, sort_keys=True) != json.dumps(facts, sort_keys=True):
        raise BundleError(f"{bundle.at(MANIFEST)}: what it says of a front end is not what its settings make; {AGAIN}")
    if held - set(files):
        raise BundleError(f"{bundle.at(min(held - set(files)))}: is no part of the front end; {AGAIN}")
    bundle.demand(files)


def front_end_player(bundle: ReadBundle) -> FrontEndPlayer | None:
    """A simulation of the registers and memory of the cores of the front end, which `check_front_end` has seen.

    Returns:
        It, or None if the bundle holds none.
    """
    said = bundle.manifest.get(FRONT_END)
    if said is None or LEFT_OUT in said:
        return None
    tables = {
        name: bundle.array(_TABLE.format(name), np.int32, (size, 3)) for name, size in said["populations"].items()
    }
    return FrontEndChips.of(core_images(bundle, _CORES), tables, said["steps"]).present
