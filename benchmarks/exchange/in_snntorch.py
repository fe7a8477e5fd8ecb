"""Runs NIR graphs in snnTorch: python -I in_snntorch.py FOLDER (environment: `make nir-peers`).

Reads every ``NAME.nir`` and the input spikes beside it, ``NAME.trains.npz`` (`benchmarks.exchange.compare` writes
them), and writes ``NAME.result.npz``: all spikes of the population, and of a few presentations those of the module that
snnTorch's own `import_from_nir` makes. It imports nothing of the project.

The graph is executed by nirtorch, edge by edge, with the torch module that snnTorch makes of each node. The front
of snnTorch 1.0.0, `import_from_nir`, wraps a recurrent population into a sub-graph first, in which the edge from
outside leads into the recurrent weights instead of the neurons (``import_nir.py``, `_create_rnn_subgraph`).
"""

from __future__ import annotations

import contextlib
import io
import sys
from pathlib import Path
from typing import Any

import nir
import nirtorch
import numpy as np
import torch
from snntorch import import_nir

FEW = 10


def module_of(node: Any) -> torch.nn.Module:
    """What snnTorch makes of a node; its neurons keep their own state."""
    return import_nir._nir_to_snntorch_module(node, init_hidden=True)


def spikes_of(network: torch.nn.Module, graph: nir.NIRGraph, trains: np.ndarray) -> np.ndarray:
    """Every spike of the population, (presentations, interval, population); inputs come as late as the graph says."""
    delay, interval = int(graph.metadata["input_delay"]), int(graph.metadata["interval"])
    given = np.zeros((interval, len(trains), trains.shape[2]), np.float32)
    given[delay:] = trains.transpose(1, 0, 2)[: interval - delay]
    state, spikes = None, []
    with torch.no_grad():
        for step in torch.from_numpy(given):
            out, state = network(step, state)
            spikes.append(out.numpy().astype(np.uint8))
    return np.stack(spikes, axis=1)


def run(path: Path) -> None:
    """One graph and its input spikes."""
    with np.load(path.with_suffix(".trains.npz")) as file:
        trains = np.unpackbits(file["packed"], axis=2, count=int(file["inputs"]))
    modules = {kind: module_of for kind in (nir.Affine, nir.Linear, nir.LIF)}
    graph = nir.read(path)
    with contextlib.redirect_stdout(io.StringIO()):  # snnTorch prints what it does
        network = nirtorch.nir_to_torch(graph, modules)
        own = import_nir.import_from_nir(nir.read(path))
    spikes, few = spikes_of(network, graph, trains), spikes_of(own, graph, trains[:FEW])
    np.savez(path.with_suffix(".result.npz"), spikes=np.packbits(spikes, axis=2), few=np.packbits(few, axis=2))


for problem in sorted(Path(sys.argv[1]).glob("*.nir")):
    run(problem)
