"""The network part of a Loihi 2 bundle: the parameters of Lava's library Processes, written, read and simulated.

Intel's compiler places Lava's Dense, Sparse, LIF and LIFReset on the chip, so a bundle holds what they are constructed
with: ``network/weights.npy`` as Dense takes them and ``network/parameters.json`` with Lava's names for everything else.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.plan import RELAY_THRESHOLD, RELAY_WEIGHT
from lava_vpr.deploy.bundle import effort
from lava_vpr.deploy.bundle.core_files import Player, Spikes
from lava_vpr.deploy.bundle.folder import AGAIN, Bundle, array_bytes, json_bytes, same_json
from lava_vpr.encoding import draw_trains
from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.general.simulation import INPUTS, GeneralNetwork, Population, Synapses
from lava_vpr.engine.general.simulation import simulate as run_general
from lava_vpr.engine.inference.bias_input import THRESHOLD
from lava_vpr.engine.inference.fixed import SCALARS, FixedNetwork
from lava_vpr.errors import BundleError, NetworkLimitError, brief
from lava_vpr.loihi import NO_MEMORY_DECAY, WEIGHT_BITS
from lava_vpr.ranges import whole

WEIGHTS, PARAMETERS = "network/weights.npy", "network/parameters.json"

CHUNK = 32
"""Presentations that are simulated in one go; more take more memory, fewer are slower."""

EXC, INH = 0, 1


def parameters_of(network: FixedNetwork) -> dict[str, Any]:
    """What the wiring needs besides the weights, by the names of Lava's arguments.

    ``excite`` and ``inhibit`` are Dense, ``relay`` is Sparse, ``exc`` and ``inh`` are LIFReset, ``inputs`` is LIF or
    None (injected spikes); ``weight`` is that of every synapse there is: relay one to one, inhibit to all others.

    Raises:
        NetworkLimitError: the network overflows Loihi's registers.
    """
    network.check()
    if network.decay > NO_MEMORY_DECAY:
        raise NetworkLimitError(
            f"decay {network.decay} does not fit Loihi 2's 0..{NO_MEMORY_DECAY}; train with network.tau_membrane "
            "above 1"
        )
    _, bits, exponent = network.stored
    reset = {"reset_interval": network.interval, "reset_offset": 1}
    return {
        "network": {"inputs": network.inputs, "neurons": network.neurons, **network.scalars},
        "steps": network.steps,
        "silent_steps": network.silent_steps,
        "inputs": {"du": NO_MEMORY_DECAY, "dv": 0, "vth": THRESHOLD} if network.bias_input else None,
        "excite": {"num_weight_bits": bits, "weight_exp": exponent},
        "exc": {"du": NO_MEMORY_DECAY, "dv": network.decay, "vth": network.threshold, **reset},
        "relay": {"weight": RELAY_WEIGHT, "num_weight_bits": WEIGHT_BITS, "weight_exp": 0},
        "inh": {"du": NO_MEMORY_DECAY, "dv": NO_MEMORY_DECAY, "vth": RELAY_THRESHOLD, **reset},
        "inhibit": {
            "weight": -network.inhibition,
            "num_weight_bits": WEIGHT_BITS,
            "weight_exp": network.inhibition_exponent,
        },
    }


def network_files(network: FixedNetwork) -> dict[str, bytes]:
    """Files of a bundle that hold ``network``, by name.

    Raises:
        NetworkLimitError: the network overflows Loihi's registers.
    """
    parameters = parameters_of(network)
    return {WEIGHTS: array_bytes(network.stored[0].astype(np.uint8)), PARAMETERS: json_bytes(parameters)}


def network_of(files: Mapping[str, bytes], path: Path = Path()) -> FixedNetwork:
    """The network that the files of a bundle describe: the inverse of `network_files`.

    Args:
        files: Content by name; others than `WEIGHTS` and `PARAMETERS` are not looked at.
        path: The bundle's folder, for messages.
    Raises:
        BundleError: they are missing, of another kind, or contradict each other.
    """
    bundle = Bundle(path, {}, dict(files))
    weights, parameters = bundle.array(WEIGHTS, np.uint8, ("neurons", "inputs")), bundle.json(PARAMETERS)
    if 0 in weights.shape:
        raise BundleError(f"{bundle.at(WEIGHTS)}: is empty, {weights.shape}; {AGAIN}")
    try:
        numbers = {name: parameters["network"][name] for name in SCALARS}
        bits = parameters["excite"]["num_weight_bits"]
        if not all(whole(number) and 0 <= number < 1 << 31 for number in (bits, *numbers.values())):
            raise ValueError
        spare = WEIGHT_BITS - bits
        if not 0 <= spare < WEIGHT_BITS:
            raise ValueError
        network = FixedNetwork.of_scalars(np.ascontiguousarray((weights >> spare).T), numbers)
        expected = parameters_of(network)
    except (KeyError, TypeError, ValueError, NetworkLimitError) as error:
        reason = f" ({error})" if isinstance(error, NetworkLimitError) else ""
        raise BundleError(
            f"{bundle.at(PARAMETERS)}: describes no network that Loihi 2 can run{reason}; {AGAIN}"
        ) from None
    for name in sorted({*expected, *parameters}):
        held = name in expected and name in parameters
        if not held or not same_json(parameters[name], expected[name]):
            raise BundleError(f"{bundle.at(PARAMETERS)}: {brief(name)} contradicts the rest of the bundle; {AGAIN}")
    if not np.array_equal(network.stored[0], weights):
        raise BundleError(f"{bundle.at(WEIGHTS)}: holds more than the {WEIGHT_BITS - spare} bits of a weight; {AGAIN}")
    return network


def general_network(weights: NDArray[np.uint8], parameters: dict[str, Any]) -> GeneralNetwork:
    """The Processes of a bundle as populations 0 (exc) and 1 (inh) of the general engine.

    Args:
        weights: Weights as Dense takes them, uint8 (neurons, inputs).
        parameters: The result of `parameters_of`; inputs are spikes, whether injected or those of input compartments.
    """
    n = len(weights)
    others = parameters["inhibit"]["weight"] * (1 - np.eye(n, dtype=np.int32))
    one_to_one = parameters["relay"]["weight"] * np.eye(n, dtype=np.int32)
    excite, relay, inhibit = (parameters[name] for name in ("excite", "relay", "inhibit"))
    return GeneralNetwork(
        inputs=weights.shape[1],
        populations=(_population(n, parameters["exc"]), _population(n, parameters["inh"])),
        synapses=(
            Synapses(INPUTS, EXC, weights.T, excite["num_weight_bits"], excite["weight_exp"]),
            Synapses(EXC, INH, one_to_one, relay["num_weight_bits"], relay["weight_exp"]),
            Synapses(INH, EXC, others, inhibit["num_weight_bits"], inhibit["weight_exp"], "inhibitory"),
        ),
    )


def _population(n: int, lif: dict[str, int]) -> Population:
    """A LIFReset of ``n`` neurons, whose step of reset is the first of each interval."""
    return Population(
        np.full(n, lif["vth"], np.int32),
        parameters=LifParameters(du=lif["du"], dv=lif["dv"]),
        reset_interval=lif["reset_interval"],
    )


def simulate(network: FixedNetwork, rates: NDArray[np.uint16], keys: NDArray[np.uint64]) -> Spikes:
    """Present every image to the network as a bundle holds it, by the general engine.

    Presentations follow each other in one run that LIFReset divides, as on the board.

    Args:
        network: From `network_of`, which sees that it is what the files say.
        rates: Spikes a step in units of 2^-16, uint16 (n, inputs).
        keys: One key per presentation, uint64 (n,).
    Returns:
        Spikes of exc and inh, uint8 (n, steps + 3, neurons), and of the inputs, uint8 (n, steps + 3, inputs).
    Raises:
        NetworkLimitError: the network overflows Loihi's registers, or the rates have another number of inputs.
    """
    # Lateral weights, dense as in Lava's Dense, four times: all, one to one, and as synapses read them.
    effort.check("simulation_bytes", 16 * network.neurons**2, f"the lateral weights of {network.neurons:,} neurons")
    weights, parameters = network.stored[0].astype(np.uint8), parameters_of(network)
    general = general_network(weights, parameters)
    n, steps = len(rates), parameters["steps"]
    interval, (neurons, size) = steps + parameters["silent_steps"], weights.shape
    if rates.ndim != 2 or rates.shape[1] != size:
        raise NetworkLimitError(
            f"rates are {rates.shape}, but the bundle's network has {size} inputs; encode them anew"
        )
    exc, inh = np.zeros((n, interval, neurons), np.uint8), np.zeros((n, interval, neurons), np.uint8)
    inputs = draw_trains(rates, keys, steps, interval, bias_input=parameters["inputs"] is not None)
    for start in range(0, n, CHUNK):
        part = slice(start, start + CHUNK)
        recording = run_general(general, inputs[part].reshape(-1, size).astype(bool))
        exc[part] = recording.spikes[EXC].reshape(-1, interval, neurons)
        inh[part] = recording.spikes[INH].reshape(-1, interval, neurons)
    return Spikes(exc, inh, inputs)


def player(bundle: Bundle) -> Player:
    """A simulation of the Processes of a bundle; its files are read once."""
    network = network_of(bundle.files, bundle.path)
    return lambda rates, keys: simulate(network, rates, keys)
