"""The network as the package neurobench sees it: python package.py PROBLEM.npz (environment: `make neurobench`).

Reads weights, numbers and input spikes (`benchmarks.neurobench.metrics` has the format), builds the network in torch
with neurons of its own arithmetic, runs neurobench's benchmark on it, and prints metrics and spike counts as JSON.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np
import snntorch
import torch
from neurobench.benchmarks import Benchmark
from neurobench.metrics.static import ConnectionSparsity, Footprint, ParameterCount
from neurobench.metrics.workload import ActivationSparsity, MembraneUpdates, SynapticOperations
from neurobench.models import SNNTorchModel, TorchModel
from torch import Tensor, nn
from torch.utils.data import DataLoader, TensorDataset

LIMIT = 1 << 23
NUMBERS = ("threshold", "decay", "inhibition", "inhibition_exponent")
Numbers = dict[str, int]


class Neurons(snntorch.SpikingNeuron):
    """Leaky integrate-and-fire in Loihi's integers, held exactly in float64."""

    def __init__(self, threshold: int, decay: int, bias: Tensor | None = None) -> None:
        super().__init__(threshold=float(threshold << 6))
        self.keep, self.mem = float(4096 - decay), torch.zeros(1)
        self.bias = torch.zeros(1) if bias is None else bias

    def forward(self, drive: Tensor) -> tuple[Tensor, Tensor]:
        """Advance the neurons by one step; returns their spikes and membranes."""
        u = drive * 64
        u = torch.where(u > LIMIT, u - 2 * LIMIT, torch.where(u <= -LIMIT, u + 2 * LIMIT, u))
        v = torch.sign(self.mem) * torch.floor(torch.abs(self.mem) * self.keep / 4096) + u + self.bias
        v = torch.clamp(v, 1 - LIMIT, LIMIT - 1)
        spikes = (v > self.threshold).to(v.dtype)
        self.mem = v * (1 - spikes)
        return spikes, self.mem


class NeurobenchNetwork(nn.Module):
    """Inputs to exc, exc to the one inhibitory neuron, which inhibits all of exc; every arrow takes one step."""

    def __init__(self, weights: np.ndarray, bias: np.ndarray, numbers: Numbers, batch: int) -> None:
        super().__init__()
        inputs, n = weights.shape
        self.excite, self.inhibit = nn.Linear(inputs, n, bias=False), nn.Linear(1, n, bias=False)
        self.listen = nn.Linear(n, 1, bias=False)
        with torch.no_grad():
            self.excite.weight.copy_(torch.from_numpy(weights.T.astype(np.float64)))
            self.listen.weight.fill_(2.0)
            self.inhibit.weight.fill_(float(numbers["inhibition"]))
        self.biases = torch.from_numpy(bias.astype(np.float64))
        self.exc, self.inh = Neurons(numbers["threshold"], numbers["decay"], self.biases), Neurons(1, 0)
        self.batch, self.n = batch, n
        self.exponent = float(1 << numbers["inhibition_exponent"])
        self.counts = torch.zeros(batch, n)
        self.reset()

    def reset(self) -> None:
        """Clear all states, as before a presentation."""
        self.drive, self.heard = torch.zeros(self.batch, self.n), torch.zeros(self.batch, 1)
        self.exc.mem, self.inh.mem = torch.zeros(self.batch, self.n), torch.zeros(self.batch, 1)

    def forward(self, spikes: Tensor) -> tuple[Tensor, Tensor]:
        """Advance the network by one step; synapses are given the spikes of this step and deliver them in the next."""
        exc, mem = self.exc(self.drive)
        inh, _ = self.inh(self.heard)
        self.drive = self.excite(spikes) - self.exponent * self.inhibit(inh)
        self.heard = self.listen(exc)
        self.counts = self.counts + exc
        return exc, mem


class StoredNetwork(nn.Module):
    """The network as it is stored: one byte a weight, four a bias, if there are any, and a membrane."""

    def __init__(self, network: NeurobenchNetwork) -> None:
        super().__init__()
        self.layers = nn.ModuleList([network.excite, network.listen, network.inhibit])
        for layer in self.layers:
            kind = torch.int8 if layer is network.excite and (layer.weight < 0).any() else torch.uint8
            layer.weight = nn.Parameter(layer.weight.detach().to(kind), requires_grad=False)
        if network.biases.any():
            self.bias = nn.Parameter(network.biases.to(torch.int32), requires_grad=False)
        for name, size in (("exc", network.n), ("inh", 1)):
            self.register_buffer(name, torch.zeros(size, dtype=torch.int32))


def measured(weights: np.ndarray, bias: np.ndarray, numbers: Numbers, spikes: np.ndarray) -> dict[str, Any]:
    """Every metric, and the spike counts (n, neurons)."""
    network = NeurobenchNetwork(weights, bias, numbers, len(spikes))
    data = TensorDataset(torch.from_numpy(spikes.astype(np.float64)), torch.zeros(len(spikes)))
    loader = DataLoader(data, batch_size=len(spikes))
    workload = [ActivationSparsity, SynapticOperations, MembraneUpdates]
    with torch.no_grad():
        metrics = Benchmark(SNNTorchModel(network), loader, [], [], [[], workload]).run(quiet=True)
        counts = network.counts.numpy().astype(int).tolist()
    stored = TorchModel(StoredNetwork(network))
    metrics |= {metric.__name__: metric()(stored) for metric in (Footprint, ParameterCount, ConnectionSparsity)}
    return {"metrics": metrics, "counts": counts}


def main(path: str) -> None:
    """Print the metrics of a problem."""
    torch.set_default_dtype(torch.float64)
    torch.set_num_threads(1)
    problem = np.load(path)
    numbers = {name: int(problem[name]) for name in NUMBERS}
    result = measured(problem["weights"], problem["bias"], numbers, problem["spikes"])
    print(json.dumps(result, default=float))


if __name__ == "__main__":
    main(sys.argv[1])
