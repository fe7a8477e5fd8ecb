"""What a bundle keeps of its model besides the network: to decode, to compare with baselines, to test itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr import container
from lava_vpr.deploy.bundle.folder import Bundle, array_bytes
from lava_vpr.encoding import query_rates, query_rates16
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.random import presentation_keys
from lava_vpr.errors import BundleError
from lava_vpr.model import Model, assemble, content

REFERENCES = "host/references.lvpr"
RATES, KEYS, RESPONSES, LABELS = (f"host/{name}.npy" for name in ("rates", "keys", "responses", "labels"))


def response_keys(model: Model) -> NDArray[np.uint64]:
    """Keys of the presentations that measure S^R, one for each reference image, in the order of ``model.labels``."""
    traverses = len(model.labels) // model.places
    keys = [presentation_keys(model.config.seed, "response", model.place_indices, t) for t in range(traverses)]
    return np.concatenate(keys)


def measured_responses(model: Model, network: FixedNetwork, threads: int) -> NDArray[np.int32]:
    """S^R of ``network`` on the references of ``model``, as a bundle presents them, int32 (neurons, places)."""
    rates = query_rates16(model.activity, model.config.encoder)
    counts, _, _ = fixed.count_spikes(network, rates, response_keys(model), threads=threads)
    responses = np.zeros((network.neurons, model.places), np.int32)
    np.add.at(responses.T, model.labels, counts)
    return responses


def reference_files(model: Model) -> dict[str, bytes]:
    """References as they are presented, what they must give, and the rest of the model without its network."""
    return {
        RATES: array_bytes(query_rates(model.activity, model.config)),
        KEYS: array_bytes(response_keys(model)),
        RESPONSES: array_bytes(model.responses.astype(np.int32)),
        LABELS: array_bytes(model.labels.astype(np.int64)),
        REFERENCES: container.pack("references", *content(model, network=False)),
    }


def read_model(bundle: Bundle, network: FixedNetwork) -> Model:
    """The model in a bundle.

    Args:
        bundle: An intact one.
        network: Rebuilt from its registers.
    Raises:
        BundleError: the parts do not fit each other.
    """
    path = bundle.path / REFERENCES
    header, arrays = container.unpack(bundle.data(REFERENCES), path, "references")
    model = assemble(path, header, arrays, network)
    if not np.array_equal(bundle.array(RESPONSES), model.responses):
        raise BundleError(f"{bundle.path / RESPONSES}: differs from what {REFERENCES} says; deploy the model again")
    return model
