"""The registry of targets, a row for each board: files of its bundle, functions that open and run them, and its guide.

`lava_vpr.deploy.boards.board` has what the boards hold; a board without a row here is refused when this is imported.

From a bundle back to the model that it holds: here all that a bundle says is checked. Whoever made the bundle made its
checksums right, too. So every file that is used is checked by its type, shape and range
(`lava_vpr.deploy.bundle.core_files`, `loihi2`, `learning`), against the references, and in the end against what this
version writes for the network that was read: registers, memory, axons and tables must be those, one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from lava_vpr.deploy.boards.board import BOARDS, KAPOHO_BAY, LOIHI_2
from lava_vpr.deploy.boards.memory import UNLIMITED
from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.bundle import core_files, folder as bundle_folder, loihi2, loihi2_pixels, readme
from lava_vpr.deploy.bundle.core_files import BundlePlayer, scalars
from lava_vpr.deploy.bundle.direct import (
    IN_LAVA,
    ON_CORES,
    PixelsForm,
    check_direct,
    direct_network,
)
from lava_vpr.deploy.bundle.folder import AGAIN, MANIFEST, ReadBundle
from lava_vpr.deploy.bundle.front_end import FrontEndPlayer, check_front_end, front_end_player
from lava_vpr.deploy.bundle.gains import check_gains
from lava_vpr.deploy.bundle.learning import SETTINGS, check_learning
from lava_vpr.deploy.bundle.references import read_references, referenced
from lava_vpr.engine.inference.fixed import OF_DIRECT, FixedNetwork
from lava_vpr.errors import BackendUnavailableError, BundleError, brief
from lava_vpr.isolated import lifetime
from lava_vpr.model import Model, integer_model
from lava_vpr.rows.registry import Registry
from lava_vpr.settings.ranges import whole

PROGRAMS = Path(__file__).parents[1] / "programs"
FOLDER = "program"
OURS = {"loihi2": ("first_failure.py", "job_folder.py", "lifetime.py")}
"""Files of `lava_vpr.isolated` that a host program has copies of, by its folder; they import nothing of lava_vpr."""


def program_files(folder: str) -> dict[str, bytes]:
    """The host program ``run.py`` of a board and the files that it needs beside it, by their names in a bundle.

    Args:
        folder: Its folder in ``deploy/programs``.
    """
    isolated = Path(lifetime.__file__).parent
    folders = (PROGRAMS / "common", PROGRAMS / folder)
    files = [path for holder in folders for path in holder.iterdir() if path.is_file()]
    files += [isolated / name for name in OURS.get(folder, ())]
    return {f"{FOLDER}/{path.name}": path.read_bytes() for path in sorted(files, key=lambda path: path.name)}


@dataclass(frozen=True)
class Target:
    """How bundles for one board are written, opened and run.

    Attributes:
        name: The board's name.
        network_files: The files that hold the network of a plan, by name.
        network: The network of a bundle, rebuilt from these files alone.
        player: A simulation of a bundle, from these files alone.
        front_end_player: A simulation of what a bundle holds from pixels on; None: it begins with the inputs.
        program: Folder of the host program in ``deploy/programs``.
        interpreter: Environment variable that names the Python with the vendor's software; None: the running one.
        guide: How to run the program, for the README in the bundle.
        parts: What the network's files are, for the README in the bundle.
        learns: Whether a bundle can hold the network that learns.
        holds_front_end: Whether a bundle can hold the spiking front end before a network whose inputs have rates.
        pixels: How a bundle holds a network that hears the cells of the front end itself.
    """

    name: str
    network_files: Callable[[Plan], Mapping[str, bytes]]
    network: Callable[[ReadBundle], FixedNetwork]
    player: Callable[[ReadBundle], BundlePlayer]
    front_end_player: Callable[[ReadBundle], FrontEndPlayer | None]
    program: str
    interpreter: str | None
    guide: str
    parts: str
    learns: bool
    holds_front_end: bool
    pixels: PixelsForm


TARGETS: Registry[Target] = Registry("target", BackendUnavailableError)
"""How bundles are made, by the name of the board."""

TARGETS.register(
    Target(
        KAPOHO_BAY.name,
        network_files=core_files.network_files,
        network=core_files.network,
        player=core_files.player,
        front_end_player=front_end_player,
        program="kapoho_bay",
        interpreter="NXSDK_PYTHON",
        guide=readme.KAPOHO_BAY,
        parts=readme.CORES,
        learns=False,
        holds_front_end=True,
        pixels=ON_CORES,
    )
)
TARGETS.register(
    Target(
        LOIHI_2.name,
        network_files=lambda plan: loihi2.network_files(plan.network),
        network=lambda bundle: loihi2.network_of(bundle.files, bundle.path),
        player=loihi2.player,
        front_end_player=loihi2_pixels.player,
        program="loihi2",
        interpreter=None,
        guide=readme.LOIHI_2,
        parts=readme.NETWORK,
        learns=True,
        holds_front_end=False,
        pixels=IN_LAVA,
    )
)


def check_targets() -> None:
    """Check that every board has its target.

    Raises:
        TypeError: a board lacks it.
    """
    missing = sorted(set(BOARDS) - set(TARGETS))
    if missing:
        raise TypeError(f"board {missing[0]!r} has no target; register one in {__name__}")


check_targets()


def open_whole(path: Path) -> tuple[ReadBundle, Model]:
    """The bundle at ``path`` and the model in it, its network rebuilt from what the board would get.

    Raises:
        BundleError: it is not intact, holds what no bundle does, or is beyond the limits.
        ModelFileError: its references are no model's.
    """
    whole_bundle = bundle_folder.load(path)
    at, stated, target = whole_bundle.at(MANIFEST), scalars(whole_bundle), TARGETS[whole_bundle.target]
    limits, most = whole_bundle.manifest.get("limits"), BOARDS[whole_bundle.target].host_spikes
    spikes = limits.get("host_spikes") if isinstance(limits, dict) else None
    if most < UNLIMITED and not (isinstance(spikes, int) and whole(spikes) and 0 <= spikes <= most):
        raise BundleError(f"{at}: has host_spikes {brief(spikes)}, of 0..{most}; {AGAIN}")
    kept = read_references(whole_bundle, stated)
    if OF_DIRECT[0] in stated:
        rebuilt = direct_network(whole_bundle, stated)
    else:
        rebuilt = target.network(whole_bundle)
    for name, number in {"inputs": rebuilt.inputs, "neurons": rebuilt.neurons, **rebuilt.scalars}.items():
        if number != stated[name]:
            raise BundleError(f"{at}: says {name} {stated[name]}, but its other files say {number}; {AGAIN}")
    model = referenced(whole_bundle, *kept, rebuilt)
    if SETTINGS in whole_bundle.files:
        if not target.learns:
            raise BundleError(f"{whole_bundle.at(SETTINGS)}: is for a board that does not learn; {AGAIN}")
        check_learning(whole_bundle, model)
    check_gains(whole_bundle, model)
    own = integer_model(model, "a bundle")
    if own.network.direct:
        check_direct(whole_bundle, own, target.pixels)
    else:
        check_front_end(whole_bundle, model, holds=target.holds_front_end)
    return whole_bundle, replace(model, bundle=path)


def open_bundle(path: Path) -> Model:
    """The model in the bundle at ``path``; see `open_whole`."""
    return open_whole(path)[1]
