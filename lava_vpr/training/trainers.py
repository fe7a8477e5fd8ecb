"""Trainers of one stretch of a route: in floating point, in Loihi's integers, or by the conductance model.

`LEARNING` has a row for each; loop, checkpoints, commands and their help use the row.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import RULES_GROUP, Config, IntegerConfig, as_integer_config, integer_config
from lava_vpr.engine.conductance import model as conductance
from lava_vpr.engine.learning import integer, stdp
from lava_vpr.engine.learning.recruiting import Thresholds
from lava_vpr.errors import ConfigError
from lava_vpr.loihi import THRESHOLD_LIMIT, WEIGHT_LIMIT
from lava_vpr.model import Stretch
from lava_vpr.neurons.models import NEURONS
from lava_vpr.rows.registry import Registry
from lava_vpr.settings.conductance import ConductanceLearning
from lava_vpr.slayer import needs
from lava_vpr.slayer.trainer import SlayerTrainer
from lava_vpr.storage.arrays import ArrayRule, UnfitError, check_arrays


class StretchTrainer(Protocol):
    """A trainer of one stretch: it learns from each image that it is shown, and returns its spike counts.

    `state` has named arrays, not copied. `reach` gives the smallest and largest value that learning can give each array
    after a number of epochs and traverses; arrays that it leaves out never change. `thresholds` is None where nothing
    is recruited.
    """

    def begin_epoch(self, epoch: int) -> None:
        """Prepare for ``epoch``, from 0; call it before the epoch's first image."""
        return None

    def present(self, rates: NDArray[Any], key: int, place: int, epoch: int) -> NDArray[np.int32]: ...

    def state(self) -> dict[str, NDArray[Any]]: ...

    def thresholds(self) -> Thresholds | None:
        return None

    def reach(self, epochs: int, traverses: int) -> dict[str, tuple[float, float]]: ...


def restore(trainer: StretchTrainer, arrays: dict[str, NDArray[Any]], epochs: int, traverses: int) -> None:
    """Put saved ``arrays`` (of `StretchTrainer.state`) in place.

    Args:
        trainer: A new one.
        arrays: The arrays from the file.
        epochs: Whole epochs that the trainer that saved them had done.
        traverses: Reference traverses.
    Raises:
        UnfitError: they are not what this trainer can have saved; nothing is changed.
    """
    state, reach = trainer.state(), trainer.reach(epochs, traverses)
    rules = {name: ArrayRule(str(own.dtype), own.shape, *reach.get(name, (0, math.inf))) for name, own in state.items()}
    check_arrays(arrays, rules)
    for name, own in state.items():
        if name not in reach and not np.array_equal(own, arrays[name]):
            raise UnfitError(f"{name} that differ from those that the seed gives")
    for name, own in state.items():
        own[...] = arrays[name]


ROUNDING = 1.001
"""Tolerance for float32 sums that round up."""


class StdpTrainer(StretchTrainer):
    """The integer network, learning in float or in Loihi's integers, as ``learning.arithmetic`` says."""

    def __init__(self, config: Config, stretch: Stretch, key: int) -> None:
        self._learning = learning = integer_config(config, "StdpTrainer").learning
        self._places, self._exact = stretch.places, learning.arithmetic == "integer"
        inputs, spikes = config.encoder.inputs, config.encoder.learning_spikes
        self._arithmetic: Any = integer if self._exact else stdp
        self._phases = self._arithmetic.phases(learning, inputs, spikes)
        self._state = self._arithmetic.initial_state(inputs, stretch.neurons, learning, spikes, config.seed, key)
        self._start = float(self._state.theta[0])

    def begin_epoch(self, epoch: int) -> None:
        if epoch == self._learning.competing:
            self._arithmetic.scale_thresholds(self._state.theta, self._learning.consolidation_threshold)

    def present(self, rates: NDArray[Any], key: int, place: int, epoch: int) -> NDArray[np.int32]:
        phase = self._phases[epoch >= self._learning.competing]
        counts: NDArray[np.int32] = self._arithmetic.present(self._state, phase, rates, key)[0]
        return counts

    def state(self) -> dict[str, NDArray[Any]]:
        return {"weights": self._state.weights, "theta": self._state.theta}

    def thresholds(self) -> Thresholds:
        return Thresholds(self._state.theta, self._start, THRESHOLD_LIMIT - 1 if self._exact else math.inf)

    def reach(self, epochs: int, traverses: int) -> dict[str, tuple[float, float]]:
        if self._exact:
            return {"weights": (0, WEIGHT_LIMIT), "theta": (1, THRESHOLD_LIMIT - 1)}
        learning, inputs = self._learning, len(self._state.weights)
        spikes = epochs * self._places * learning.steps  # of the first traverse: thresholds rise in the first phase
        theta = (learning.threshold + learning.theta_plus * spikes) * max(1.0, learning.consolidation_threshold)
        heaviest = max(learning.w_max, learning.mean_weight * inputs)  # all of a neuron's weights can be one input's
        return {"weights": (0, heaviest * ROUNDING), "theta": (0, theta * ROUNDING)}


class TemplateTrainer(StretchTrainer):
    """The baseline for learning: a place's neuron has the mean rates of the place's references as its weights."""

    def __init__(self, config: Config, stretch: Stretch) -> None:
        self._weights = np.zeros((config.encoder.inputs, stretch.neurons), np.float32)

    def present(self, rates: NDArray[Any], key: int, place: int, epoch: int) -> NDArray[np.int32]:
        self._weights[:, place] += rates.astype(np.float32) / 65536
        return np.zeros(self._weights.shape[1], np.int32)

    def state(self) -> dict[str, NDArray[Any]]:
        return {"weights": self._weights}

    def reach(self, epochs: int, traverses: int) -> dict[str, tuple[float, float]]:
        return {"weights": (0, epochs * traverses)}


class ConductanceTrainer(StretchTrainer):
    """The ``paper`` preset's network; S^R is counted during the last epochs, while it still learns."""

    def __init__(self, config: Config, stretch: Stretch, key: int) -> None:
        if not isinstance(config.learning, ConductanceLearning):
            raise ConfigError("ConductanceTrainer needs network.model 'conductance'")
        self._config, self._learning = config, config.learning
        self.network = conductance.initial_state(config, config.encoder.inputs)
        self.responses = np.zeros((stretch.neurons, stretch.places), np.int32)

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

    def reach(self, epochs: int, traverses: int) -> dict[str, tuple[float, float]]:
        learning, steps = self._learning, self._config.network.steps
        presentations = epochs * traverses * self.responses.shape[1]
        counted = max(0, epochs - max(0, learning.epochs - learning.label_epochs))
        return {
            "weights": (0, max(learning.w_max, learning.weight_sum) * ROUNDING),
            "theta_mv": (0, (learning.theta_start_mv + learning.theta_plus_mv * steps * presentations) * ROUNDING),
            "responses": (0, steps * traverses * counted),
        }


def rule_of(config: Config) -> LearningRule:
    """How weights are learned under ``config``."""
    chosen = as_integer_config(config)
    if chosen is None:
        return CONDUCTANCE
    learning = chosen.learning
    return LEARNING[learning.arithmetic if learning.rule == STDP else learning.rule]


def rule_settings(name: str, config: Config) -> dict[str, Any]:
    """The settings of ``learning`` that choose the rule called ``name``, beside those of ``config``.

    Raises:
        ConfigError: there is no such rule.
    """
    row = LEARNING[name]
    of_conductance = isinstance(config.learning, ConductanceLearning) and row.rule == STDP  # which has rules of its own
    settings = {
        "rule": None if of_conductance else row.rule or row.name,
        "arithmetic": row.arithmetic,
        "epochs": row.epochs,
    }
    return {key: value for key, value in settings.items() if value is not None}


@dataclass(frozen=True)
class LearningRule:
    """A way to learn the weights of a stretch.

    Attributes:
        name: What ``train --learning`` takes.
        title: What it does, for help.
        trainer: Makes the trainer of a stretch. It takes the settings; the stretch; `stretch_key` of its images, for
            which start weights are drawn; and the responses to its references, traverse after traverse, float32
            (images, inputs).
        rule: The setting ``learning.rule`` that chooses it; a plug-in's is its name, and may be left out.
        arithmetic: The setting ``learning.arithmetic`` that does; None: either.
        epochs: How often it shows each image unless a user says otherwise; None: as the settings say.
        check: Refuses, before any work, settings that it cannot learn with, or where a library is missing.
        neuron_a_place: Whether it takes exactly one neuron for each place.
        signed: Whether weights have a sign; the mean of all others is normalised.
    """

    name: str
    title: str
    trainer: Callable[[Config, Stretch, int, NDArray[np.float32]], StretchTrainer]
    rule: str = ""
    arithmetic: str | None = None
    epochs: int | None = None
    check: Callable[[IntegerConfig], object] = lambda config: None
    neuron_a_place: bool = False
    signed: bool = False


def _check_slayer(config: IntegerConfig) -> None:
    """Refuse neurons without gradients, and learning without lava-dl."""
    NEURONS[config.network.model].check("learning.rule slayer")
    needs.require()


STDP = "stdp"
LEARNING: Registry[LearningRule] = Registry("learning rule", ConfigError, group=RULES_GROUP, row_class=LearningRule)
"""The ways to learn an integer network."""
OWN = (
    LearningRule(
        "float",
        "by STDP, in real numbers",
        lambda config, stretch, key, _: StdpTrainer(config, stretch, key),
        STDP,
        "float",
    ),
    LearningRule(
        "integer",
        "in Loihi's 8-bit weights and 7-bit traces",
        lambda config, stretch, key, _: StdpTrainer(config, stretch, key),
        STDP,
        "integer",
        check=lambda config: integer.phases(config.learning, config.encoder.inputs, config.encoder.learning_spikes),
    ),
    LearningRule(
        "slayer",
        "by gradients through spikes on changed references (lava-dl and torch, an extra)",
        SlayerTrainer,
        "slayer",
        epochs=10,
        check=_check_slayer,
        neuron_a_place=True,
        signed=True,
    ),
    LearningRule(
        "template",
        "no learning, the references' own rates are the weights (the baseline for learning)",
        lambda config, stretch, key, _: TemplateTrainer(config, stretch),
        "template",
        epochs=1,
        neuron_a_place=True,
    ),
)
"""Those of this program, the default first."""
for _row in OWN:
    LEARNING.register(_row)
CONDUCTANCE = LearningRule(
    "conductance", "preset paper", lambda config, stretch, key, _: ConductanceTrainer(config, stretch, key), "triplet"
)
"""How the float conductance model learns, which takes no other way."""
