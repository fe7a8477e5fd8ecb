"""The cost of one presentation in operations and memory, checked against limits before it runs.

It follows from the settings and the number of neurons; values within their allowed ranges can still cost years. An
operation updates one state, or adds or changes one weight; an input is taken to spike at its rate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from lava_vpr.config import Config, LifNetwork, StdpLearning
from lava_vpr.errors import ConfigError
from lava_vpr.settings.conductance import ConductanceNetwork
from lava_vpr.storage.limits import excess


class Effort(NamedTuple):
    """The cost of one presentation: ``operations``, and bytes of ``memory`` besides network and results."""

    operations: int
    memory: int


def query_effort(config: Config, neurons: int) -> Effort:
    """The cost of a query with ``neurons`` excitatory neurons."""
    network, inputs = config.network, config.encoder.inputs
    if not isinstance(network, LifNetwork):
        return _conductance(network, neurons, _arrivals(config, network))
    spikes = min(inputs, config.encoder.query_spikes)
    operations = network.steps * neurons * (1 + spikes)
    return Effort(math.ceil(operations), math.ceil(4 * network.steps * spikes) + 40 * (inputs + neurons))


def training_effort(config: Config, neurons: int) -> Effort:
    """The cost of a training presentation to a stretch of ``neurons`` excitatory neurons."""
    network, learning, inputs = config.network, config.learning, config.encoder.inputs
    if isinstance(network, LifNetwork) and learning.rule == "slayer":  # all synapses in all steps, both passes
        return Effort(3 * network.steps * neurons * inputs, 8 * network.steps * (inputs + 20 * neurons))
    if isinstance(learning, StdpLearning):
        spikes = min(inputs, config.encoder.learning_spikes)
        operations = learning.steps * (neurons * (1 + spikes) + inputs)
        return Effort(math.ceil(operations), math.ceil(4 * learning.steps * spikes) + 40 * (inputs + neurons))
    if isinstance(network, LifNetwork):
        raise ConfigError("network.model 'lif' does not learn by conductance rules; use the preset paper")
    arrivals = _arrivals(config, network)
    shown = _conductance(network, neurons, arrivals)
    # Each neuron that has spiked keeps a list of its arrivals.
    return Effort(shown.operations + inputs * network.steps, shown.memory + 8 * neurons * (arrivals + inputs))


def _arrivals(config: Config, network: ConductanceNetwork) -> int:
    """Input spikes of a presentation of the conductance network, all inputs at their highest rate."""
    rate = min(1.0, config.encoder.max_rate_hz * network.dt_ms / 1000)
    return math.ceil(config.encoder.inputs * rate * network.steps)


def _conductance(network: ConductanceNetwork, neurons: int, arrivals: int) -> Effort:
    """The cost of a presentation of the frozen conductance network: two populations, and input spikes in flight."""
    total, longest = network.steps + network.rest_steps, math.ceil(network.delay_max_ms / network.dt_ms)
    return Effort(neurons * (2 * total + arrivals), 8 * neurons * (longest + 300) + 24 * (total + 1) + 24 * arrivals)


def check_query(config: Config, neurons: int) -> None:
    """Refuse settings whose queries cost more than the limits allow.

    Raises:
        ConfigError: naming cost, limit, and how it is raised.
    """
    _check("a query", query_effort(config, neurons), "network.steps")


def check_training(config: Config, neurons: int, presentations: int) -> None:
    """Refuse settings whose training costs more than the limits allow.

    Args:
        config: The settings.
        neurons: Excitatory neurons of the largest stretch.
        presentations: Presentations of all images in all epochs.
    Raises:
        ConfigError: naming cost, limit, and how it is raised.
    """
    effort = training_effort(config, neurons)
    setting = "learning.steps" if isinstance(config.learning, StdpLearning) else "network.steps"
    _check("a training presentation", effort, setting)
    beyond = excess("training_operations", effort.operations * presentations)
    if beyond is not None:
        raise ConfigError(f"training takes {beyond}, or lower learning.epochs or {setting}")


def _check(what: str, effort: Effort, setting: str) -> None:
    for name, amount in (("presentation_operations", effort.operations), ("presentation_bytes", effort.memory)):
        beyond = excess(name, amount)
        if beyond is not None:
            raise ConfigError(f"{what} takes {beyond}, or lower {setting}")
