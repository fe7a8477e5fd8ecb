"""The bundle of a network that hears the cells of the spiking front end itself: from pixels to counts in one run.

All cores stand in the folder of the front end, the neurons of places, their counters and the one that inhibits them
among the populations. Weights and biases are kept beside: what the cores hold is seen to be theirs. As a model keeps no
pixels, the self-test shows the small pictures of places that it keeps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr import __version__
from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.bundle.folder import AGAIN, MANIFEST, ReadBundle, array_bytes, json_bytes
from lava_vpr.deploy.bundle.front_end import FRONT_END, LEFT_OUT, front_end_files, whole_of
from lava_vpr.deploy.bundle.readme import direct_readme
from lava_vpr.deploy.bundle.references import reference_files
from lava_vpr.deploy.hardware.belief import BIAS_INPUT, HardwareBelief
from lava_vpr.deploy.hardware.table import relied_on
from lava_vpr.deploy.mapping.front_end import PlacedFrontEnd, placed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.whole import counts_of
from lava_vpr.errors import BundleError, LavaVprError, NetworkLimitError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.loihi import WEIGHT_LIMIT
from lava_vpr.model import IntegerModel

WEIGHTS, BIAS, PIXELS, COUNTS = (f"host/{name}.npy" for name in ("weights", "bias", "pixels", "counts"))


def direct_contents(
    model: IntegerModel, board: Board, program: Mapping[str, bytes], *, holds: bool
) -> tuple[dict[str, Any], dict[str, bytes], PlacedFrontEnd]:
    """Manifest, files and placement of the bundle of ``model``; see `lava_vpr.deploy.bundle.deployment.contents`.

    Args:
        model: The model.
        board: The board.
        program: The files of its host program.
        holds: Whether its bundles have files for a front end.
    Raises:
        NetworkLimitError: it does not fit, or bundles for this board hold no front end.
    """
    spec, network = whole_of(model), model.network
    cores, facts = front_end_files(spec, board, (), holds=holds)
    if facts is None or LEFT_OUT in facts:
        raise NetworkLimitError(
            f"{board.title}: {'' if facts is None else facts[LEFT_OUT]}; these neurons hear the cells of the front "
            "end themselves, so the network cannot run without it: train with --input frontend"
        )
    plan, rows = placed(spec, board), unproven(board)
    files = {**reference_files(model), **program, **cores, **_own_files(model)}
    files["mapping.json"] = json_bytes(plan.as_json(0))
    files["README.md"] = direct_readme(model, spec, plan, rows)
    limits = {name: "unknown" if value is None else value for name, value in board.as_json().items()}
    manifest = {
        "target": board.name,
        "lava_vpr": __version__,
        "network": {
            "inputs": network.inputs,
            "neurons": network.neurons,
            **network.scalars,
            "silent_steps": network.silent_steps,
            "places": model.places,
        },
        "input": {"mode": "pixels", "pixels": spec.populations["pixels"]},
        "clearing": {
            "mechanism": "embedded writes",
            "what": "an embedded processor of each chip writes u = v = 0 of all compartments after the last silent "
            "step; until the next query the clock, which has no bias then, makes nothing spike",
            "silent_steps": network.silent_steps,
        },
        "limits": limits,
        "compression": None,
        "modelled": None,
        FRONT_END: facts,
        "unproven": [row.name for row in rows],
    }
    return manifest, files, plan


def unproven(board: Board) -> tuple[HardwareBelief, ...]:
    """Every row of docs/hardware.md without a public source that such a bundle rests on."""
    return relied_on({board.chip, f"{board.chip}: {BIAS_INPUT}"})


def _own_files(model: IntegerModel) -> dict[str, bytes]:
    """The network, and the pictures of the self-test with the counts that they must give."""
    pixels = tested_pixels(whole_of(model), model)
    counts = counts_of(whole_of(model), pixels)
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


def direct_network(bundle: ReadBundle, stated: Mapping[str, int], *, holds: bool) -> FixedNetwork:
    """The network that a bundle keeps beside its cores, with which these are compared.

    Args:
        bundle: The bundle.
        stated: What its manifest says of the network.
        holds: Whether bundles for its board have files for a front end.
    Raises:
        BundleError: it is none, or the board's bundles hold none.
    """
    at = bundle.at(WEIGHTS)
    if not holds:
        raise BundleError(f"{bundle.at(MANIFEST)}: holds a front end for a board that runs none; {AGAIN}")
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


def check_direct(bundle: ReadBundle, model: IntegerModel) -> None:
    """Refuse a bundle whose network or self-test is not what this version writes of its ``model``.

    Raises:
        BundleError: it is another.
    """
    if model.config.encoder.direct is not None:
        bundle.demand(_own_files(model))
