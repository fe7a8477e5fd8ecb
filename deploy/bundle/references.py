"""What a bundle says of its model, and the parts that it stores besides the network: for decoding, baselines and
self-tests."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr import __version__
from lava_vpr.configfile import of_file
from lava_vpr.deploy.boards.board import Board
from lava_vpr.deploy.bundle.folder import AGAIN, MANIFEST, ReadBundle, array_bytes
from lava_vpr.engine.effort import check_query
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.rates import query_rates16
from lava_vpr.errors import BundleError, LavaVprError, brief
from lava_vpr.model import Model, assemble, content
from lava_vpr.settings.ranges import whole
from lava_vpr.storage import container
from lava_vpr.training.measuring import response_keys

REFERENCES = "host/references.lvpr"
RATES, KEYS, RESPONSES, LABELS = (f"host/{name}.npy" for name in ("rates", "keys", "responses", "labels"))


def reference_files(model: Model) -> dict[str, bytes]:
    """References as they are presented, what they must give, and the rest of the model without its network."""
    rates = query_rates16(model.activity, model.config.encoder)
    return {
        RATES: array_bytes(rates),
        KEYS: array_bytes(response_keys(rates, model.config.seed)),
        RESPONSES: array_bytes(model.responses.astype(np.int32)),
        LABELS: array_bytes(model.labels.astype(np.int64)),
        REFERENCES: container.pack("references", *content(model, network=False)),
    }


def described(model: Model, network: FixedNetwork, board: Board) -> dict[str, Any]:
    """What every manifest says of the bundle's model, ``network`` and board."""
    limits = {name: "unknown" if value is None else value for name, value in board.as_json().items()}
    return {
        "target": board.name,
        "lava_vpr": __version__,
        "network": {
            "inputs": network.inputs,
            "neurons": network.neurons,
            **network.scalars,
            "silent_steps": network.silent_steps,
            "places": model.places,
        },
        "limits": limits,
    }


def rates_of(bundle: ReadBundle, name: str, expected: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """The rates (images, inputs) of references in the file ``name``, which are ``expected`` but for the machine.

    Machines may add the responses of an image in another order: a rate can differ by one unit.

    Raises:
        BundleError: they differ by more.
    """
    rates = bundle.array(name, np.uint16, expected.shape)
    if np.abs(rates - expected.astype(np.int32)).max(initial=0) > 1:
        raise BundleError(f"{bundle.at(name)}: are not the rates of the references; {AGAIN}")
    return rates


def read_references(bundle: ReadBundle, stated: Mapping[str, int]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """What `lava_vpr.model.content` kept of the references in ``bundle``, seen to be for a network of the stated size.

    Raises:
        ModelFileError: they cannot be read, or a query is beyond the limits.
        BundleError: they are for another network.
    """
    header, arrays = container.unpack(bundle.data(REFERENCES), bundle.path / REFERENCES, "references")
    at = bundle.at(REFERENCES)
    try:
        config = of_file(header.get("config"))
        check_query(config, stated["neurons"])
    except LavaVprError as error:
        raise BundleError(f"{at}: the settings cannot be used ({error}); {AGAIN}") from None
    if config.encoder.inputs != stated["inputs"]:
        said = f"says inputs {stated['inputs']}, but the settings in {REFERENCES} make {config.encoder.inputs}"
        raise BundleError(f"{bundle.at(MANIFEST)}: {said}; {AGAIN}")
    return header, arrays


def referenced(
    bundle: ReadBundle, header: dict[str, Any], arrays: dict[str, NDArray[Any]], network: FixedNetwork
) -> Model:
    """The model that references make with the bundle's ``network``; the host's arrays are those that belong to it.

    Args:
        bundle: The bundle that they are in.
        header, arrays: From `read_references`.
        network: The bundle's.
    Raises:
        ModelFileError: they are no model's.
        BundleError: the parts do not fit each other.
    """
    model = assemble(bundle.path / REFERENCES, header, arrays, network)
    said = bundle.manifest["network"].get("places", model.places)
    if not whole(said) or said != model.places:
        raise BundleError(f"{bundle.at(MANIFEST)}: says places {brief(said)}, but holds {model.places}; {AGAIN}")
    rates = rates_of(bundle, RATES, query_rates16(model.activity, model.config.encoder))
    keys, responses = response_keys(rates, model.config.seed), model.responses.astype(np.int32)
    own: dict[str, NDArray[Any]] = {KEYS: keys, RESPONSES: responses, LABELS: model.labels}
    bundle.demand({name: array_bytes(array) for name, array in own.items()})
    return model
