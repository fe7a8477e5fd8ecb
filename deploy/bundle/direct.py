"""The bundle of a network that hears the cells of the spiking front end itself: from pixels to counts in one run.

Each board has its form of the network's files (`PixelsForm`): cores in the folder of the front end, on which the
neurons of places, their counters and the one that inhibits them are further populations, or what Lava's library is made
with (`lava_vpr.deploy.bundle.loihi2_pixels`). Weights and biases are kept beside: what these files hold is seen to be
theirs. As a model keeps no pixels, the self-test shows the small pictures of places that it keeps.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import BOARDS, KAPOHO_BAY, Board, LifReset
from lava_vpr.deploy.bundle import loihi2_pixels, readme
from lava_vpr.deploy.bundle.folder import AGAIN, MANIFEST, ReadBundle, array_bytes, json_bytes
from lava_vpr.deploy.bundle.front_end import FRONT_END, LEFT_OUT, front_end_files, whole_of
from lava_vpr.deploy.bundle.references import described, reference_files
from lava_vpr.deploy.hardware.belief import BIAS_INPUT, LONG, HardwareBelief
from lava_vpr.deploy.hardware.loihi_2 import RESET_SHOWN
from lava_vpr.deploy.hardware.table import relied_on
from lava_vpr.deploy.mapping.front_end import PlacedFrontEnd, placed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.whole import WholeNetwork, counts_of
from lava_vpr.errors import BundleError, LavaVprError, NetworkLimitError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.loihi import WEIGHT_LIMIT, reset_interval
from lava_vpr.model import IntegerModel

WEIGHTS, BIAS, PIXELS, COUNTS = (f"host/{name}.npy" for name in ("weights", "bias", "pixels", "counts"))


@dataclass(frozen=True)
class PixelsForm:
    """How the bundles of a board hold a network from pixels to places.

    Attributes:
        folder: The folder of the network's files.
        files: These, by name, and what the manifest says of them.
        cleared: How states return to 0 between two queries, for the manifest.
        guide: What it takes and how to run the program, for the README in the bundle.
        parts: What the network's files are, for the README in the bundle.
    """

    folder: str
    files: Callable[[WholeNetwork], tuple[dict[str, bytes], dict[str, Any]]]
    cleared: Callable[[WholeNetwork], dict[str, Any]]
    guide: str
    parts: str


def _on_cores(spec: WholeNetwork) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Files of the cores of a Kapoho Bay.

    Raises:
        NetworkLimitError: the network does not fit.
    """
    files, facts = front_end_files(spec, KAPOHO_BAY, ())
    if facts is None or LEFT_OUT in facts:
        raise NetworkLimitError("" if facts is None else facts[LEFT_OUT])
    return files, facts


def _cleared_by_writes(spec: WholeNetwork) -> dict[str, Any]:
    """How a Kapoho Bay does."""
    return {
        "mechanism": "embedded writes",
        "what": "an embedded processor of each chip writes u = v = 0 of all compartments after the last silent "
        "step; until the next query the clock, which has no bias then, makes nothing spike",
        "silent_steps": spec.places.silent_steps,
    }


ON_CORES = PixelsForm(FRONT_END, _on_cores, _cleared_by_writes, readme.PIXELS_KAPOHO_BAY, readme.PIXELS_CORES)
IN_LAVA = PixelsForm(
    loihi2_pixels.NETWORK,
    loihi2_pixels.whole_files,
    loihi2_pixels.cleared,
    readme.PIXELS_LOIHI_2,
    readme.PIXELS_NETWORK,
)


def direct_contents(
    model: IntegerModel, board: Board, program: Mapping[str, bytes], form: PixelsForm
) -> tuple[dict[str, Any], dict[str, bytes], PlacedFrontEnd]:
    """Manifest, files and placement of the bundle of ``model``; see `lava_vpr.deploy.bundle.deployment.contents`.

    Args:
        model: The model.
        board: The board.
        program: The files of its host program.
        form: How its bundles hold such a network.
    Raises:
        NetworkLimitError: it does not fit.
    """
    spec, network = whole_of(model, counted=board.counters), model.network
    plan, rows = placed(spec, board), unproven(spec, board)
    try:
        if exceeded := plan.exceeded():
            raise NetworkLimitError(exceeded)
        parts, facts = form.files(spec)
    except NetworkLimitError as error:
        raise NetworkLimitError(
            f"{board.title}: {error}; these neurons hear the cells of the front end themselves, so the network cannot "
            "run without it: train with --input frontend"
        ) from None
    files = {**reference_files(model), **program, **parts, **_own_files(model)}
    files["mapping.json"] = json_bytes(plan.as_json(0))
    files["README.md"] = readme.direct_readme(model, spec, plan, form.guide, form.parts, rows)
    manifest = described(model, network, board) | {
        "input": {"mode": "pixels", "pixels": spec.populations["pixels"]},
        "clearing": form.cleared(spec),
        "compression": None,
        "modelled": None,
        FRONT_END: facts,
        "unproven": [row.name for row in rows],
    }
    return manifest, files, plan


def unproven(spec: FrontEnd, board: Board) -> tuple[HardwareBelief, ...]:
    """Every row of docs/hardware.md without a public source that such a bundle rests on."""
    long = isinstance(board.clearing, LifReset) and reset_interval(spec.steps) > RESET_SHOWN
    return relied_on({board.chip, f"{board.chip}: {BIAS_INPUT}", *([f"{board.chip}: {LONG}"] if long else ())})


def _own_files(model: IntegerModel) -> dict[str, bytes]:
    """The network, and the pictures of the self-test with the counts that they must give."""
    spec = whole_of(model)
    pixels = tested_pixels(spec, model)
    counts = counts_of(spec, pixels)
    arrays: dict[str, NDArray[Any]] = {
        WEIGHTS: model.network.weights,
        BIAS: model.network.bias,
        PIXELS: pixels,
        COUNTS: counts,
    }
    return {name: array_bytes(array) for name, array in arrays.items()}


MOST_TESTED = 200
"""Places that the self-test shows at most, evenly spread."""


def tested_pixels(spec: FrontEnd, model: IntegerModel) -> NDArray[np.uint8]:
    """What pixels take of the small pictures of places, uint8 (n, height, width)."""
    chosen = np.linspace(0, model.places - 1, min(model.places, MOST_TESTED)).round().astype(np.int64)
    return np.array([spec.seen(model.thumbnails[place]) for place in chosen])


def direct_network(bundle: ReadBundle, stated: Mapping[str, int]) -> FixedNetwork:
    """The network that a bundle keeps beside the files that its board gets, with which these are compared.

    Args:
        bundle: The bundle.
        stated: What its manifest says of the network.
    Raises:
        BundleError: it is none.
    """
    at = bundle.at(WEIGHTS)
    weights = bundle.array(WEIGHTS, np.int16, (stated["inputs"], stated["neurons"]))
    bias = bundle.array(BIAS, np.int32, (stated["neurons"],))
    try:
        if np.abs(weights.astype(np.int32)).max(initial=0) > WEIGHT_LIMIT:
            raise NetworkLimitError("a weight is beyond 8 bits")
        network = FixedNetwork.of_scalars(weights, bias, stated)
        network.check()
    except LavaVprError as error:
        raise BundleError(f"{at}: is no network of ours ({error}); {AGAIN}") from None
    return network


def check_direct(bundle: ReadBundle, model: IntegerModel, form: PixelsForm) -> None:
    """Refuse files of a network from pixels to places, or a self-test, that are not what this version writes for
    ``model``, the bundle's, which hears cells directly.

    Raises:
        BundleError: they are others.
    """
    try:
        files, facts = form.files(whole_of(model, counted=BOARDS[bundle.target].counters))
    except NetworkLimitError as error:
        raise BundleError(
            f"{bundle.at(MANIFEST)}: its network is none that the board can run ({error}); {AGAIN}"
        ) from None
    if json.dumps(bundle.manifest.get(FRONT_END), sort_keys=True) != json.dumps(facts, sort_keys=True):
        raise BundleError(f"{bundle.at(MANIFEST)}: what it says of a front end is not what its settings make; {AGAIN}")
    more = [name for name in bundle.files if name.startswith(f"{form.folder}/") and name not in files]
    if more:
        raise BundleError(f"{bundle.at(min(more))}: is no part of the network; {AGAIN}")
    bundle.demand({**files, **_own_files(model)})
