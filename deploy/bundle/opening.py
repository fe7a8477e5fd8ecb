"""From a bundle back to the model that it holds: the one place where all that a bundle says is checked.

Whoever made the bundle made its checksums right, too. So every file that is used is held against its type, shape and
range (`lava_vpr.deploy.bundle.core_files`, `loihi2`, `learning`), against the references, and in the end against what
this version writes for the network that was read: registers, memory, axons and tables must be those, one by one.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.boards.memory import UNLIMITED
from lava_vpr.deploy.bundle import folder as bundle_folder
from lava_vpr.deploy.bundle.core_files import scalars
from lava_vpr.deploy.bundle.folder import AGAIN, MANIFEST, ReadBundle
from lava_vpr.deploy.bundle.learning import SETTINGS, check_learning
from lava_vpr.deploy.bundle.references import read_references, referenced
from lava_vpr.deploy.bundle.targets import TARGETS
from lava_vpr.errors import BundleError, brief
from lava_vpr.model import Model
from lava_vpr.settings.ranges import whole


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
    rebuilt = target.network(whole_bundle)
    for name, number in {"inputs": rebuilt.inputs, "neurons": rebuilt.neurons, **rebuilt.scalars}.items():
        if number != stated[name]:
            raise BundleError(f"{at}: says {name} {stated[name]}, but its other files say {number}; {AGAIN}")
    model = referenced(whole_bundle, *kept, rebuilt)
    if SETTINGS in whole_bundle.files:
        if not target.learns:
            raise BundleError(f"{whole_bundle.at(SETTINGS)}: is for a board that does not learn; {AGAIN}")
        check_learning(whole_bundle, model)
    return whole_bundle, replace(model, bundle=path)


def open_bundle(path: Path) -> Model:
    """The model in the bundle at ``path``; see `open_whole`."""
    return open_whole(path)[1]
