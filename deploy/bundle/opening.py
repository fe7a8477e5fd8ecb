"""From a bundle back to the model that it holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from lava_vpr.deploy.bundle import folder as bundle_folder
from lava_vpr.deploy.bundle.core_files import scalars
from lava_vpr.deploy.bundle.folder import AGAIN, MANIFEST
from lava_vpr.deploy.bundle.references import read_model
from lava_vpr.deploy.bundle.targets import TARGETS
from lava_vpr.errors import BundleError
from lava_vpr.model import Model


def open_bundle(path: Path) -> Model:
    """The model in the bundle at ``path``, its network rebuilt from what the board would get.

    Raises:
        BundleError: it is not intact.
    """
    whole = bundle_folder.load(path)
    rebuilt = TARGETS[whole.target].network(whole)
    stated = scalars(whole)
    for name, number in {"inputs": rebuilt.inputs, "neurons": rebuilt.neurons, **rebuilt.scalars}.items():
        if number != stated[name]:
            raise BundleError(f"{path / MANIFEST}: says {name} {stated[name]}, the registers say {number}; {AGAIN}")
    return replace(read_model(whole, rebuilt), bundle=path)
