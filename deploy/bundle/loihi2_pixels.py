"""A network from pixels to places in a Loihi 2 bundle: every population and projection, written, read and simulated.

Intel's compiler places Lava's LIFReset and Sparse on the chip, so a bundle holds what they are constructed with:
``network/parameters.json`` with Lava's names for everything but the synapses, which stand in a folder for each
projection: ``weights.npy``, ``sources.npy`` and ``begins.npy``, the rows of the targets one after another (data,
indices and indptr of scipy's csr_matrix). Synapses are those that `lava_vpr.deploy.mapping.front_end` places, those
that excite and those that inhibit apart: no threshold is 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from lava_vpr.deploy.boards.board import LOIHI_2
from lava_vpr.deploy.bundle.folder import AGAIN, ReadBundle, array_bytes, json_bytes
from lava_vpr.deploy.bundle.front_end import FRONT_END, FrontEndPlayer
from lava_vpr.deploy.bundle.loihi2 import PARAMETERS, check_decay
from lava_vpr.deploy.mapping.front_end import stored_rows
from lava_vpr.engine.general.lif import LifParameters, bias_of, lif_step
from lava_vpr.engine.inference.whole import WholeNetwork
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.errors import BundleError
from lava_vpr.inputs.front_end_network import NeuronGroup, Projection, populations
from lava_vpr.loihi import WEIGHT_BITS, reset_interval

NETWORK = "network"
"""The folder of the files."""
_ROWS = ("weights", "sources", "begins")


def whole_files(spec: WholeNetwork) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Files of a bundle that hold the network, by name, and what the manifest says of it.

    Raises:
        NetworkLimitError: a decay is beyond the chip's registers.
    """
    check_decay(spec.places)
    files, described = {}, []
    for number, one in enumerate(_projections(spec)):
        name = f"{number:02}-{one.source}-{one.target}"
        arrays = (one.weights.data.astype(np.int16), one.weights.indices, one.weights.indptr)
        for part, array in zip(_ROWS, arrays, strict=True):
            kind = np.int16 if part == "weights" else np.int32
            files[_file(name, part)] = array_bytes(array.astype(kind))
        sign = "EXCITATORY" if one.weights.data[0] > 0 else "INHIBITORY"
        form = {"num_weight_bits": WEIGHT_BITS, "weight_exp": one.exponent, "sign_mode": sign}
        described.append({"name": name, "source": one.source, "target": one.target, "form": form})
    interval = reset_interval(spec.steps)
    parameters = {
        "steps": spec.steps,
        "silent_steps": interval - spec.steps,
        "populations": {name: _neurons(each, interval) for name, each in populations(spec).items()},
        "synapses": described,
    }
    facts = {"steps": spec.steps, "interval": interval, "populations": dict(spec.populations)}
    return files | {PARAMETERS: json_bytes(parameters)}, facts


def cleared(spec: WholeNetwork) -> dict[str, Any]:
    """How states return to 0 between two queries, for the manifest."""
    interval = reset_interval(spec.steps)
    return {
        "mechanism": "LIFReset",
        "what": "Lava's LIFReset sets u and v of all neurons to 0 in the first step of each presentation; before that, "
        "in the silent steps, nothing spikes: neurons that spiked once have silenced themselves",
        "reset_interval": interval,
        "reset_offset": 1,
        "silent_steps": interval - spec.steps,
        "writes_per_query": spec.populations["pixels"],
    }


def _file(name: str, part: str) -> str:
    return f"{NETWORK}/{name}/{part}.npy"


def _neurons(one: NeuronGroup, interval: int) -> dict[str, Any]:
    """A population as LIFReset takes it; between presentations the mantissas of pixels are written."""
    bias = 0 if one.bias is None else one.bias.tolist()
    own = {"shape": [one.size], "du": one.du, "dv": one.dv, "vth": max(1, one.threshold)}
    return {**own, "bias_mant": bias, "bias_exp": one.bias_exp, "reset_interval": interval, "reset_offset": 1}


def _projections(spec: WholeNetwork) -> Iterator[Projection]:
    """Every synapse, each projection of one sign."""
    for (source, target, exponent), weights in stored_rows(spec, LOIHI_2).items():
        for sign in (1, -1):
            part = csr_matrix(weights.multiply(sign).maximum(0).multiply(sign))
            part.eliminate_zeros()
            part.sort_indices()
            if part.nnz:
                yield Projection(source, target, part, exponent)


class _Population:
    """A population while it runs."""

    def __init__(self, given: Mapping[str, Any]) -> None:
        (n,) = given["shape"]
        self.u, self.v, self.held = (np.zeros(n, np.int32) for _ in range(3))
        self.threshold, self.exponent = np.full(n, given["vth"], np.int32), given["bias_exp"]
        self.bias = np.broadcast_to(bias_of(np.array(given["bias_mant"]), self.exponent), n).copy()
        self.constants = LifParameters(given["du"], given["dv"]).constants
        self.drive, self.fired = np.zeros(n, np.int64), np.zeros(n, bool)

    def rest(self) -> None:
        """Begin a presentation."""
        self.u[:] = self.v[:] = 0
        self.fired[:] = False

    def step(self) -> None:
        """Integrate what arrived."""
        lif_step(self.u, self.v, self.threshold, self.held, self.drive, self.bias, self.constants, self.fired)
        self.drive[:] = 0


def player(bundle: ReadBundle) -> FrontEndPlayer | None:
    """A simulation of the Processes of a bundle in which nothing contradicts the rest; its files are read once.

    Returns:
        It, or None if the bundle holds no such network.
    """
    if "interval" not in bundle.manifest.get(FRONT_END, {}):
        return None
    parameters = bundle.json(PARAMETERS)
    neurons = {name: _Population(given) for name, given in parameters["populations"].items()}
    ways = [(each["source"], each["target"], _weights(bundle, each, neurons)) for each in parameters["synapses"]]
    steps, silent = parameters["steps"], parameters["silent_steps"]

    def play(images: PixelBlock) -> dict[str, NDArray[np.uint8]]:
        grey, bias = images
        films = {name: np.zeros((len(grey), steps + silent, len(one.u)), np.uint8) for name, one in neurons.items()}
        for number, image in enumerate(grey):
            neurons["pixels"].bias = bias_of(image.reshape(-1), neurons["pixels"].exponent)
            if bias is not None:
                neurons["exc"].bias = bias[number].astype(np.int64)
            for one in neurons.values():
                one.rest()
            for step in range(steps + silent):
                for source, target, weights in ways:
                    neurons[target].drive += weights @ neurons[source].fired.astype(np.int64)
                for name, one in neurons.items():
                    one.step()
                    films[name][number, step] = one.fired
        if any(film[:, steps:].any() for film in films.values()):
            raise BundleError(f"{bundle.at(PARAMETERS)}: a neuron spikes in a silent step; {AGAIN}")
        return {name: film[:, :steps] for name, film in films.items()}

    return play


def _weights(bundle: ReadBundle, described: Mapping[str, Any], neurons: Mapping[str, _Population]) -> csr_matrix:
    """What each spike adds, int64 (targets, sources)."""
    weights, sources, begins = (bundle.array(_file(described["name"], part)) for part in _ROWS)
    shape = len(neurons[described["target"]].u), len(neurons[described["source"]].u)
    return csr_matrix((weights.astype(np.int64) << described["form"]["weight_exp"], sources, begins), shape)
