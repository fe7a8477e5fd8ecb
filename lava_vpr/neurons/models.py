"""Neuron models: the step-by-step dynamics of excitatory neurons, and the backends that run them.

Each row is one model. The `LIF` model of Loihi is `lif` here, its definition, and runs compiled; the conductance model
of preset ``paper`` has separate settings and a separate engine (`lava_vpr.engine.conductance`). A package adds others
by its entry points (docs/plugins.md): a function of one step, with which the host counts spikes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import ConfigError
from lava_vpr.loihi import DECAY_BITS, DECAY_UNITY, STATE_LIMIT
from lava_vpr.rows.registry import Registry


class NeuronConstants(NamedTuple):
    """Constants of all neurons of a network: the ``threshold`` in units of v, the ``decay`` of v in 2^-12 a step."""

    threshold: int
    decay: int


State = NDArray[np.int64]
Step = Callable[[NeuronConstants, State, NDArray[np.int64]], tuple[State, NDArray[np.bool_]]]
"""One step: of the constants, the states (states, n, neurons) that the step before returned, at first 0, and the drive
(n, neurons) in units of v, less inhibition, with the bias; to the states after it, and which neurons spike, bool
(n, neurons). Each presentation and neuron stands for itself."""


def decayed(value: State, decay: int) -> State:
    """``value``, any shape, minus a share of ``decay`` 2^-12, rounded towards 0 as the chip does."""
    return np.sign(value) * (np.abs(value) * (DECAY_UNITY - decay) >> DECAY_BITS)


def lif(constants: NeuronConstants, state: State, drive: NDArray[np.int64]) -> tuple[State, NDArray[np.bool_]]:
    """Loihi's leaky integrate-and-fire neurons, as a `Step`; the one state is v."""
    v = np.clip(decayed(state[0], constants.decay) + drive, 1 - STATE_LIMIT, STATE_LIMIT - 1)
    spikes = v > constants.threshold
    return np.where(spikes, 0, v)[None], spikes


@dataclass(frozen=True)
class NeuronModel:
    """A model of the excitatory neurons, as ``network.model`` in the settings chooses it.

    Weights, threshold, decay, inhibition and biases are made as for LIF, and learning rules use their own neurons.

    Attributes:
        name: What the setting says.
        title: The model in words, for people.
        step: One step of the neurons; None: the model has a separate engine and settings.
        states: Whole numbers that each neuron keeps from step to step.
        backends: The backends that run it; None: all of them, and boards and other formats have it, too.
    """

    name: str
    title: str
    step: Step | None = None
    states: int = 1
    backends: tuple[str, ...] | None = ("host",)

    def check(self, what: str, path: Path | None = None) -> None:
        """Refuse ``what``, a backend or another target, if it cannot run these neurons.

        Args:
            what: Its name; the message begins with it.
            path: The file of the model, if it is known.
        Raises:
            ConfigError: it cannot.
        """
        if self.backends is not None and what not in self.backends:
            raise self.refusal(what, path)

    def refusal(self, what: str, path: Path | None = None) -> ConfigError:
        """The refusal of `check`."""
        file, backends = "" if path is None else f"{path}: ", " or ".join(self.backends or ())
        return ConfigError(
            f"{file}{what} needs an integer network, but preset paper is {self.title}; train with --preset loihi, or "
            f"run this one with --backend {backends}"
            if self.step is None
            else f"{file}{what} needs neurons of network.model lif, but these are {self.name} ({self.title}), which "
            f"only --backend {backends} runs; train with lif"
        )


NEURONS: Registry[NeuronModel] = Registry(
    "neuron model", ConfigError, group="lava_vpr.neuron_models", row_class=NeuronModel
)
"""Every neuron model by name."""
LIF = NEURONS.register(NeuronModel("lif", "leaky integrate-and-fire, in Loihi's integers", lif, backends=None))
CONDUCTANCE = NEURONS.register(
    NeuronModel("conductance", "the float conductance model", backends=("host", "lava-float"))
)


def stepped(name: str) -> bool:
    """Whether ``name`` is that of a model with a step, which the settings of the integer network can choose."""
    return name in NEURONS and NEURONS[name].step is not None
