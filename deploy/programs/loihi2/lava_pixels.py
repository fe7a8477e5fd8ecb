"""A network from pixels to places in Lava, and how pictures are presented to it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_network import Arrays, CountedRun, across, between, write

SHOWN, COUNTED = "pixels", "exc"
ROWS = ("weights", "sources", "begins")
"""What a projection has: each target's weights and sources, one target after another, and where each's begin."""


def wire_pixels(arrays: Arrays, parameters: dict[str, Any], biases: dict[str, Any]) -> dict[str, Any]:
    """All populations by name, which begin with these ``biases``, and the synapses between them.

    Every arrow takes one step. ``arrays`` has the `ROWS` of each projection, below its name.
    """
    from lava.proc.lif.process import LIFReset
    from lava.proc.sparse.process import Sparse
    from lava.utils.weightutils import SignMode
    from scipy.sparse import csr_matrix

    neurons = {}
    for name, own in parameters["populations"].items():
        neurons[name] = LIFReset(**own | {"shape": tuple(own["shape"]), "bias_mant": biases[name]})
    for one in parameters["synapses"]:
        data, indices, begins = (arrays[f"{one['name']}/{part}"] for part in ROWS)
        source, target, form = neurons[one["source"]], neurons[one["target"]], one["form"]
        weights = csr_matrix((data.astype(np.int32), indices, begins), (*target.v.shape, *source.v.shape))
        between(source, Sparse(weights=weights, **form | {"sign_mode": SignMode[form["sign_mode"]]}), target)
    return neurons


class PixelPlayer(CountedRun):
    """The network, and how a batch of pictures is presented to it: their pixels are written between runs."""

    def __init__(self, arrays: Arrays, options: dict[str, Any], seen: NDArray[np.int64]) -> None:
        self.pixels, parameters = arrays["pixels"], options["parameters"]
        populations = parameters["populations"]
        super().__init__(options, seen, len(self.pixels), *populations[COUNTED]["shape"])
        self.own = {name: np.array(each["bias_mant"]) for name, each in populations.items() if each["bias_mant"] != 0}
        begin: dict[str, Any] = dict.fromkeys(populations, 0)
        if not options["scalars"]:  # a Var cannot be set before the first step
            begin |= {**self.own, SHOWN: self.grey(0)}
            self.own = {}
        self.neurons = wire_pixels(arrays, parameters, begin)
        across(self.neurons[COUNTED].s_out, self.process.s_in, None if self.simulate else "NxToPyAdapter")
        self.start()

    def grey(self, query: int) -> NDArray[np.int32]:
        """The mantissas of the pixels' biases."""
        return self.pixels[query].reshape(-1).astype(np.int32)

    def present(self, start: int, end: int) -> NDArray[np.int32]:
        """Counts of the queries ``start`` .. ``end`` - 1."""
        for query in range(start, end):
            self.go(self.interval)
            if query + 1 < len(self.pixels):
                write(self.neurons[SHOWN], {"bias_mant": self.grey(query + 1)})
            for name, mantissas in self.own.items():
                write(self.neurons[name], {"bias_mant": mantissas})
            self.own = {}
        return self.covered(start, end)
