"""Steps down the gradient, by torch's Adam, on arrays that stand outside torch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.gate import IntegerConfig
from lava_vpr.slayer import forward
from lava_vpr.slayer.needs import libraries


class Adam:
    """Adam on ``weights``, in place.

    Args:
        weights: float32 (inputs, neurons).
        first, second: Adam's means of gradients and of squares, of the same shape and type, changed too.
        taken: Steps taken before.
        config: Settings.
    """

    def __init__(
        self,
        weights: NDArray[np.float32],
        first: NDArray[np.float32],
        second: NDArray[np.float32],
        taken: int,
        config: IntegerConfig,
    ) -> None:
        torch = libraries().torch
        torch.set_num_threads(1)  # of each thread anew: sums then have one order, whatever the machine
        self._weights, self._config = torch.nn.Parameter(torch.from_numpy(weights)), config
        rate = config.slayer.rate / np.sqrt(len(weights))
        self._adam = torch.optim.Adam([self._weights], lr=rate, foreach=False)
        self._adam.state[self._weights] = {
            "step": torch.tensor(float(taken)),
            "exp_avg": torch.from_numpy(first),
            "exp_avg_sq": torch.from_numpy(second),
        }

    def step(
        self,
        network: FixedNetwork,
        rates: NDArray[np.uint16],
        keys: NDArray[np.uint64],
        root: NDArray[np.uint8],
        labels: NDArray[np.int64],
    ) -> float:
        """One step, and the loss before it.

        Args:
            network: What would be deployed of the weights as they are.
            rates, keys: The presentations, (n, inputs) and (n,).
            root: Spikes of the inhibitory neuron in them, (n, interval).
            labels: The neuron that should spike most, (n,).
        """
        torch, slayer = libraries().torch, self._config.slayer
        weights = forward.scaled(self._weights, network.bits, network.signed)
        trains = forward.input_trains(network, rates, keys)
        counts = forward.spikes(network, weights, trains, root, slayer.surrogate).sum(dim=-1)
        loss = torch.nn.functional.cross_entropy(counts * slayer.sharpness, torch.from_numpy(labels))
        self._adam.zero_grad()
        loss.backward()
        self._adam.step()
        return float(loss.item())
