"""What learns one stretch of a route: in float, in Loihi's integers, or as the conductance model does."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import ConductanceLearning, Config
from lava_vpr.engine.conductance import model as conductance
from lava_vpr.engine.learning import integer, stdp
from lava_vpr.errors import ConfigError
from lava_vpr.gate import as_integer_config, integer_config
from lava_vpr.model import Stretch


class StretchTrainer(Protocol):
    """What learns one stretch: shown an image, it learns and tells its spike counts. Its state is named live arrays."""

    def begin_epoch(self, epoch: int) -> None: ...

    def present(self, rates: NDArray[Any], key: int, place: int, epoch: int) -> NDArray[np.int32]: ...

    def state(self) -> dict[str, NDArray[Any]]: ...


def restore(trainer: StretchTrainer, arrays: dict[str, NDArray[Any]]) -> None:
    """Put saved ``arrays`` (of `StretchTrainer.state`) in place."""
    for name, value in trainer.state().items():
        value[...] = arrays[name]


class LifTrainer:
    """The ``loihi`` preset's network, learning in float."""

    def __init__(self, config: Config, stretch: Stretch, number: int) -> None:
        settings = integer_config(config, "LifTrainer")
        start = stdp.initial_state(config.encoder.inputs, stretch.neurons, settings.learning, config.seed, number)
        self._trainer = stdp.Trainer(start, settings.learning, config.encoder.train_spikes, settings.network.drive)

    def begin_epoch(self, epoch: int) -> None:
        self._trainer.begin_epoch(epoch)

    def present(self, rates: NDArray[Any], key: int, place: int, epoch: int) -> NDArray[np.int32]:
        return self._trainer.present(rates, key)[0]

    def state(self) -> dict[str, NDArray[Any]]:
        return {"weights": self._trainer.state.weights, "theta": self._trainer.state.theta}


class IntegerLifTrainer:
    """The current-based network, learning in Loihi's integers."""

    def __init__(self, config: Config, stretch: Stretch, number: int) -> None:
        settings = integer_config(config, "IntegerLifTrainer")
        inputs, spikes, drive = config.encoder.inputs, config.encoder.train_spikes, settings.network.drive
        self._trainer = integer.IntegerTrainer(
            inputs, stretch.neurons, settings.learning, spikes, drive, config.seed, number
        )

    def begin_epoch(self, epoch: int) -> None:
        self._trainer.begin_epoch(epoch)

    def present(self, rates: NDArray[Any], key: int, place: int, epoch: int) -> NDArray[np.int32]:
        return self._trainer.present(rates, key)

    def state(self) -> dict[str, NDArray[Any]]:
        return {"weights": self._trainer.state.weights, "theta": self._trainer.state.theta}


class ConductanceTrainer:
    """The ``paper`` preset's network; S^R is counted during the last epochs, while it still learns."""

    def __init__(self, config: Config, stretch: Stretch, number: int) -> None:
        if not isinstance(config.learning, ConductanceLearning):
            raise ConfigError("ConductanceTrainer needs network.model 'conductance'")
        self._config, self._learning = config, config.learning
        self.network = conductance.initial_state(config, config.encoder.inputs)
        self.responses = np.zeros((stretch.neurons, stretch.places), np.int32)

    def begin_epoch(self, epoch: int) -> None:
        pass  # one phase only

    def present(self, rates: NDArray[Any], key: int, place: int, epoch: int) -> NDArray[np.int32]:
        counts, _ = conductance.train_presentation(self.network, rates, key, self._config)
        if epoch >= self._learning.epochs - self._learning.label_epochs:
            self.responses[:, place] += counts
        return counts

    def state(self) -> dict[str, NDArray[Any]]:
        return {
            "weights": self.network.weights,
            "theta_mv": self.network.theta_mv,
            "delays": self.network.delays,
            "responses": self.responses,
        }


def trainer_of(config: Config, stretch: Stretch, number: int) -> StretchTrainer:
    """The trainer that learns one stretch under ``config``."""
    chosen = as_integer_config(config)
    if chosen is None:
        return ConductanceTrainer(config, stretch, number)
    kind = IntegerLifTrainer if chosen.learning.arithmetic == "integer" else LifTrainer
    return kind(config, stretch, number)
