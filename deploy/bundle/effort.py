"""The cost of simulating a bundle in memory and operations, checked against limits before it runs."""

from __future__ import annotations

from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.errors import NetworkLimitError
from lava_vpr.storage.limits import excess, limit

REMEDY = ", or run it on --backend host"


def spike_bytes(network: FixedNetwork) -> int:
    """Bytes of every spike of one presentation: one for each neuron and input in every step."""
    return network.interval * (network.neurons + network.inhibitory + network.inputs)


def together(network: FixedNetwork, most: int) -> int:
    """How many presentations, ``most`` or fewer, are simulated at once, so that memory suffices.

    Raises:
        NetworkLimitError: one presentation is beyond a limit.
    """
    each = 2 * spike_bytes(network)  # as they are recorded, and as they are returned
    # Every input to every neuron, every neuron to an inhibitory one, and the root to every neuron; relays of inputs.
    operations = network.interval * (network.neurons * (network.inputs + 2) + network.inputs)
    for name, amount in (("simulation_bytes", each), ("simulation_operations", operations)):
        check(name, amount, f"a query of {network.steps:,} steps to {network.neurons:,} neurons")
    return max(1, min(most, limit("simulation_bytes") // each))


def check(name: str, amount: int, what: str) -> None:
    """Refuse to simulate what takes an ``amount`` beyond the limit ``name``.

    Raises:
        NetworkLimitError: naming ``what``, the amount and the limit.
    """
    beyond = excess(name, amount)
    if beyond is not None:
        raise NetworkLimitError(f"to simulate {what} takes {beyond}{REMEDY}")
