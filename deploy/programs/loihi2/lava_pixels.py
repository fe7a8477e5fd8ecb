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
        neurons[name] = LIFReset(**own | {"shape": tuple(own["shape"]), **biases[name]})
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
        self.biases = [
            {"bias_mant": row, "bias_exp": np.full_like(row, exponent)}
            for row, exponent in zip(arrays.get("biases", ()), arrays.get("exponents", ()), strict=True)
        ]
        self.own = {
            name: {"bias_mant": np.array(each["bias_mant"])}
            for name, each in populations.items()
            if each["bias_mant"] != 0
        }
        begin: dict[str, dict[str, Any]] = {name: {"bias_mant": 0} for name in populations}
        if not options["scalars"]:  # a Var cannot be set before the first step
            begin |= self.own | self.shown(0)
            self.own = {}
        self.neurons = wire_pixels(arrays, parameters, begin)
        across(self.neurons[COUNTED].s_out, self.process.s_in, None if self.simulate else "NxToPyAdapter")
        self.start()

    def shown(self, query: int) -> dict[str, dict[str, NDArray[np.int32]]]:
        """What is written for a query, by population: biases of pixels and, if it has any, of the neurons of places."""
        pixels = {SHOWN: {"bias_mant": self.pixels[query].reshape(-1).astype(np.int32)}}
        return {**pixels, COUNTED: self.biases[query]} if self.biases else pixels

    def present(self, start: int, end: int) -> NDArray[np.int32]:
        """Counts of the queries ``start`` .. ``end`` - 1."""
        for query in range(start, end):
            self.go(self.interval)
            following = self.shown(query + 1) if query + 1 < len(self.pixels) else {}
            for name, values in (self.own | following).items():
                write(self.neurons[name], values)
            self.own = {}
        return self.covered(start, end)
