"""What learns one stretch by SLAYER: weights that bring each place's neuron the most spikes, whatever the day.

Every epoch shows each reference once, changed at random (`lava_vpr.inputs.views`), in batches. Each batch runs in the
very integers that would be deployed now: quantised, with their thresholds, inhibition and biases. The loss is the
cross-entropy of the spike counts times ``slayer.sharpness``, by the place of each reference; Adam takes the steps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config, IntegerConfig, integer_config
from lava_vpr.engine.inference import counting, fixed, quantise
from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.surroundings import Shown
from lava_vpr.engine.random import image_keys, presentation_key, presentation_keys
from lava_vpr.engine.rates import query_rates16, training_rates
from lava_vpr.inputs.views import augmented
from lava_vpr.model import Stretch
from lava_vpr.slayer import forward
from lava_vpr.slayer.needs import libraries

_FAR = 1e6
"""Weights start with norm 1, and a step changes each by about ``slayer.rate`` / sqrt(inputs)."""


class SlayerTrainer:
    """A `lava_vpr.training.trainers.StretchTrainer`; all of an epoch is learned when it begins.

    Args:
        config: Settings with ``learning.rule`` slayer.
        stretch: The stretch, with a neuron for each place.
        key: `stretch_key` of its images, for which everything random is drawn.
        activity: Responses to its references, traverse after traverse, float32 (images, inputs).
    """

    def __init__(self, config: Config, stretch: Stretch, key: int, activity: NDArray[np.float32]) -> None:
        self._config, self._key, self._activity = integer_config(config, "SlayerTrainer"), key, activity
        self._labels = np.tile(np.arange(stretch.places), len(activity) // stretch.places)
        self._weights = np.ascontiguousarray(self._start(stretch.places), np.float32)
        self._first, self._second = np.zeros_like(self._weights), np.zeros_like(self._weights)
        shown = query_rates16(activity, config.encoder)
        self._shown = [Shown(shown, slice(0, stretch.places), len(activity) // stretch.places)]

    def _start(self, places: int) -> NDArray[np.float64]:
        """Start weights of norm 1, (inputs, places): templates, or drawn evenly to all sides."""
        if self._config.slayer.start == "template":
            rates = training_rates(self._activity, self._config).astype(np.float64)
            return quantise.unit_norm(rates.reshape(-1, places, rates.shape[1]).sum(axis=0).T)
        drawn = self._rng("start", 0).normal(size=(self._activity.shape[1], places))
        return quantise.unit_norm(drawn)

    def _rng(self, role: str, epoch: int) -> np.random.Generator:
        return np.random.default_rng(presentation_key(self._config.seed, role, self._key, epoch))

    def begin_epoch(self, epoch: int) -> None:
        """Show every reference once, and learn."""
        config, rng = self._config, self._rng("train", epoch)
        activity = augmented(self._activity, config.encoder.layout, config.augment, rng)
        rates = query_rates16(activity, config.encoder)
        order, size = rng.permutation(len(rates)), config.slayer.batch
        batches = [order[first : first + size] for first in range(0, len(order), size)]
        adam = Adam(self._weights, self._first, self._second, epoch * len(batches), config)
        for batch in batches:
            network = self._network()
            keys = presentation_keys(config.seed, "train", image_keys(rates[batch]), epoch)
            film = counting.count_spikes(network, rates[batch], keys, raster=True)[2]
            root = counting.inhibitory_spikes(network, film)[:, :, -1]
            adam.step(network, rates[batch], keys, root, self._labels[batch])

    def _network(self) -> fixed.FixedNetwork:
        """What would be deployed now."""
        settings = self._config.network
        return quantise.quantise(quantise.distinctive(self._weights, settings, self._shown), settings, self._shown)

    def present(self, rates: NDArray[Any], key: int, place: int, epoch: int) -> NDArray[np.int32]:
        """No spike: the epoch has been learned."""
        return np.zeros(self._weights.shape[1], np.int32)

    def state(self) -> dict[str, NDArray[Any]]:
        """Weights, and the means of gradients and of their squares that Adam keeps."""
        return {"weights": self._weights, "first": self._first, "second": self._second}

    def thresholds(self) -> None:
        return None

    def reach(self, epochs: int, traverses: int) -> dict[str, tuple[float, float]]:
        """Anything finite that training can come near."""
        return {"weights": (-_FAR, _FAR), "first": (-_FAR, _FAR), "second": (0, _FAR)}


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
        torch.set_num_threads(1)  # of each thread again: sums then have one order, whatever the machine
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
