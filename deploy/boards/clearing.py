"""How each board comes to rest between two queries: the mechanisms that fulfil the contract in `docs/network.md`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError
from lava_vpr.loihi import DECAY_BITS, DECAY_UNITY, LOIHI_2_RESET_LIMIT, STATE_LIMIT, reset_interval


def rest_steps(network: FixedNetwork) -> int | None:
    """Steps without input after which every membrane is 0 by its own decay, whatever it was.

    None: no number of steps does that, as neurons have biases or membranes do not decay.
    """
    if network.bias.any() or network.decay == 0:
        return None
    keep, v, steps = DECAY_UNITY - network.decay, STATE_LIMIT - 1, 0
    while v:
        v, steps = v * keep >> DECAY_BITS, steps + 1
    return steps


def check_reset(interval: int, setting: str) -> None:
    """Refuse a presentation after which Loihi 2 cannot clear its neurons: LIFReset's intervals are powers of two.

    Args:
        interval: Steps of a presentation, the silent ones included.
        setting: The setting that it follows from, for the remedy.
    Raises:
        NetworkLimitError: naming the intervals that it can.
    """
    above = reset_interval(interval)
    if interval != above or interval > LOIHI_2_RESET_LIMIT:
        below, above = min(above // 2, LOIHI_2_RESET_LIMIT), min(above, LOIHI_2_RESET_LIMIT)
        able = f"{below:,}" if below == above else f"{below:,} or {above:,}"
        raise NetworkLimitError(
            f"a presentation takes {interval:,} steps, but Loihi 2 resets neurons at powers of two of at most "
            f"{LOIHI_2_RESET_LIMIT:,}; train with {setting} such that it takes {able}, the silent steps included"
        )


def _always(network: FixedNetwork, bias: int, adapted: bool) -> dict[str, Any]:
    """What either mechanism says besides its own: with ``adapted``, registers written for biases of a query."""
    return ({"bias_writes_per_query": bias} if adapted else {}) | {
        "rest_steps_instead": rest_steps(network),
        "silent_steps": network.silent_steps,
    }


@dataclass(frozen=True)
class LifReset:
    """Lava's LIFReset, in the first step of each presentation."""

    def check(self, network: FixedNetwork) -> None:
        """Refuse a network whose presentations cannot be followed by a reset; see `check_reset`."""
        check_reset(network.interval, "network.steps")

    def of(self, network: FixedNetwork, *, adapted: bool = False) -> dict[str, Any]:
        """The mechanism, and what it costs in a query; with ``adapted`` each brings biases, a register a neuron."""
        bias = network.neurons * adapted
        return {
            "mechanism": "LIFReset",
            "what": "Lava's LIFReset sets u and v of exc and inh to 0 in the first step of each presentation",
            "reset_interval": network.interval,
            "reset_offset": 1,
            "writes_per_query": 3 * network.inputs * network.bias_input + bias,
            **_always(network, bias, adapted),
        }


@dataclass(frozen=True)
class EmbeddedWrites:
    """Writes of the chips' embedded processors, after the last silent step."""

    def check(self, network: FixedNetwork) -> None:
        """Refuse nothing: a processor writes whenever it is time."""

    def of(self, network: FixedNetwork, *, adapted: bool = False) -> dict[str, Any]:
        """The mechanism, and what it costs in a query; with ``adapted`` each brings biases, a register a neuron."""
        neurons, inputs = network.neurons, network.inputs * network.bias_input
        bias = neurons * adapted
        return {
            "mechanism": "embedded writes",
            "what": "an embedded processor of each chip writes v = 0 of its exc compartments and of their counters "
            "after the last silent step; currents have no memory, and inhibitory neurons and relays are at 0 by then",
            "exc_writes_per_query": neurons,
            "counter_reads_per_query": neurons,
            "counter_writes_per_query": neurons,
            "input_writes_per_query": 3 * inputs,
            "writes_per_query": 2 * neurons + 3 * inputs + bias,
            **_always(network, bias, adapted),
        }


Clearing = LifReset | EmbeddedWrites
