"""What a bundle keeps of its model besides the network: to decode, to compare with baselines, to test itself."""

from __future__ import annotations

import numpy as np

from lava_vpr.deploy.bundle.folder import Bundle, array_bytes
from lava_vpr.encoding import query_rates
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import BundleError
from lava_vpr.model import Model, assemble, content
from lava_vpr.storage import container
from lava_vpr.training.references import response_keys

REFERENCES = "host/references.lvpr"
RATES, KEYS, RESPONSES, LABELS = (f"host/{name}.npy" for name in ("rates", "keys", "responses", "labels"))


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
