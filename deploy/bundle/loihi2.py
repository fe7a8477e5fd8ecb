"""The network part of a Loihi 2 bundle: the parameters of Lava's library Processes, written, read and simulated.

Intel's compiler places Lava's Dense, Sparse, LIF and LIFReset on the chip, so a bundle holds what they are constructed
with: ``network/weights.npy`` as Dense takes them, ``network/bias.npy``, the mantissas of the neurons' biases, and
``network/parameters.json`` with Lava's names for everything else.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import check_reset
from lava_vpr.deploy.boards.plan import RELAY_THRESHOLD, RELAY_WEIGHT
from lava_vpr.deploy.bundle import effort
from lava_vpr.deploy.bundle.core_files import BundlePlayer, BundleSpikes
from lava_vpr.deploy.bundle.folder import AGAIN, ReadBundle, array_bytes, json_bytes
from lava_vpr.engine.general.lif import LifParameters
from lava_vpr.engine.general.simulation import INPUTS, GeneralNetwork, Population, Synapses, simulate as run_general
from lava_vpr.engine.inference import fixed
from lava_vpr.engine.inference.biases import LEVEL, THRESHOLD, bias_registers
from lava_vpr.engine.inference.fixed import SCALARS, FixedNetwork
from lava_vpr.engine.rates import draw_trains
from lava_vpr.errors import BundleError, NetworkLimitError
from lava_vpr.loihi import NO_MEMORY_DECAY, WEIGHT_BITS
from lava_vpr.settings.ranges import whole

WEIGHTS, BIAS, PARAMETERS = "network/weights.npy", "network/bias.npy", "network/parameters.json"

CHUNK = 32
"""Presentations that are simulated in one go; more take more memory, fewer are slower."""

EXC, INH, RELAYS = 0, 1, 2


def parameters_of(network: FixedNetwork) -> dict[str, Any]:
    """What the wiring needs besides weights and biases, by the names of Lava's arguments.

    ``excite`` and ``inhibit`` are synapses to exc, from the inputs and from the root; ``relay`` those to inhibitory
    neurons and relays; ``exc`` and ``inh`` are LIFReset, the latter of inhibitory neurons and relays; ``inputs`` is LIF
    or None (injected spikes). ``weight`` is that of every synapse there is. Leaf i of ``leaves`` listens to the neurons
    from i ``fan_in`` on, the root to the leaves; without any the root listens to exc. ``relayed``: injected spikes go
    through one relay an input. ``level`` is the membrane beyond which inputs of regular trains spike, None for others.

    Raises:
        NetworkLimitError: the network overflows Loihi's registers, or cannot be reset after each presentation.
    """
    network.check()
    check_reset(network.interval, "network.steps")
    check_decay(network)
    _, bits, exponent = network.stored
    _, bias_exponent = network.bias_registers
    reset = {"reset_interval": network.interval, "reset_offset": 1}
    return {
        "network": {"inputs": network.inputs, "neurons": network.neurons, **network.scalars},
        "steps": network.steps,
        "silent_steps": network.silent_steps,
        "level": LEVEL if network.regular else None,
        "inputs": {"du": NO_MEMORY_DECAY, "dv": 0, "vth": THRESHOLD} if network.bias_input else None,
        "relayed": int(network.relayed),
        "leaves": network.leaves,
        "fan_in": fixed.FAN_IN,
        "excite": {
            "num_weight_bits": bits,
            "weight_exp": exponent,
            "sign_mode": "MIXED" if network.signed else "EXCITATORY",
        },
        "exc": {
            "du": NO_MEMORY_DECAY,
            "dv": network.decay,
            "vth": network.threshold,
            "bias_exp": bias_exponent,
            **reset,
        },
        "relay": {
            "weight": RELAY_WEIGHT,
            "num_weight_bits": WEIGHT_BITS,
            "weight_exp": 0,
            "sign_mode": "EXCITATORY",
        },
        "inh": {"du": NO_MEMORY_DECAY, "dv": NO_MEMORY_DECAY, "vth": RELAY_THRESHOLD, **reset},
        "inhibit": {
            "weight": -network.inhibition,
            "num_weight_bits": WEIGHT_BITS,
            "weight_exp": network.inhibition_exponent,
            "sign_mode": "INHIBITORY",
        },
    }


def check_decay(network: FixedNetwork) -> None:
    """Refuse a decay that LIFReset does not take.

    Raises:
        NetworkLimitError: naming the setting.
    """
    if network.decay > NO_MEMORY_DECAY:
        raise NetworkLimitError(
            f"decay {network.decay} does not fit Loihi 2's 0..{NO_MEMORY_DECAY}; train with network.tau_membrane "
            "above 1"
        )


def network_files(network: FixedNetwork) -> dict[str, bytes]:
    """Files of a bundle that hold ``network``, by name.

    Raises:
        NetworkLimitError: the network overflows Loihi's registers.
    """
    parameters = parameters_of(network)
    return {
        WEIGHTS: array_bytes(network.stored[0].astype(np.int16)),
        BIAS: array_bytes(network.bias_registers[0]),
        PARAMETERS: json_bytes(parameters),
    }


def network_of(files: Mapping[str, bytes], path: Path = Path()) -> FixedNetwork:
    """The network that the files of a bundle describe: the inverse of `network_files`.

    Args:
        files: Content by name; others than `WEIGHTS`, `BIAS` and `PARAMETERS` are not looked at.
        path: The bundle's folder, for messages.
    Raises:
        BundleError: they are missing, of another kind, or contradict each other.
    """
    bundle = ReadBundle(path, {}, dict(files))
    weights, parameters = bundle.array(WEIGHTS, np.int16, ("neurons", "inputs")), bundle.json(PARAMETERS)
    if 0 in weights.shape:
        raise BundleError(f"{bundle.at(WEIGHTS)}: is empty, {weights.shape}; {AGAIN}")
    bias = bundle.array(BIAS, np.int32, weights.shape[:1])
    try:
        numbers = {name: parameters["network"][name] for name in SCALARS}
        exponent, spare = parameters["exc"]["bias_exp"], WEIGHT_BITS - numbers["bits"]
        if not all(whole(number) and 0 <= number < 1 << 31 for number in (exponent, spare, *numbers.values())):
            raise ValueError
        network = FixedNetwork.of_scalars(np.ascontiguousarray((weights >> spare).T), bias << exponent, numbers)
        files = network_files(network)
    except (KeyError, TypeError, ValueError, NetworkLimitError) as error:
        reason = f" ({error})" if isinstance(error, NetworkLimitError) else ""
        raise BundleError(
            f"{bundle.at(PARAMETERS)}: describes no network that Loihi 2 can run{reason}; {AGAIN}"
        ) from None
    bundle.demand(files)
    return network


def general_network(
    weights: NDArray[np.int16],
    bias: NDArray[np.int32],
    parameters: Mapping[str, Any],
    exponents: NDArray[np.int32] | None = None,
) -> GeneralNetwork:
    """The Processes of a bundle as populations 0 (exc), 1 (inh: leaves, then the root) and 2 (relays, if there are).

    Args:
        weights: Weights as Dense takes them, int16 (neurons, inputs).
        bias: Mantissas of the biases, int32 (neurons,).
        parameters: The result of `parameters_of`; inputs are spikes, whether injected or those of input compartments.
        exponents: Of presentations whose biases, (n, neurons), differ, int32 (n,); None: as the parameters say.
    """
    (n, inputs), leaves, one = weights.shape, parameters["leaves"], parameters["relay"]["weight"]
    inh = leaves + 1
    listen, gather, take = np.zeros((n, inh), np.int32), np.zeros((inh, inh), np.int32), np.zeros((inh, n), np.int32)
    listen[np.arange(n), np.arange(n) // parameters["fan_in"] if leaves else 0] = one
    gather[:leaves, -1], take[-1] = one, parameters["inhibit"]["weight"]
    own = parameters["exc"] if exponents is None else {**parameters["exc"], "bias_exp": exponents[:, None]}
    populations = [_population(n, own, bias), _population(inh, parameters["inh"])]
    synapses = [
        _synapses(RELAYS if parameters["relayed"] else INPUTS, EXC, weights.T, parameters["excite"]),
        _synapses(EXC, INH, listen, parameters["relay"]),
        _synapses(INH, EXC, take, parameters["inhibit"]),
    ]
    if leaves:
        synapses.append(_synapses(INH, INH, gather, parameters["relay"]))
    if parameters["relayed"]:
        populations.append(_population(inputs, parameters["inh"]))
        synapses.append(_synapses(INPUTS, RELAYS, one * np.eye(inputs, dtype=np.int32), parameters["relay"]))
    return GeneralNetwork(inputs, tuple(populations), tuple(synapses))


def _synapses(source: int, target: int, weights: NDArray[Any], described: Mapping[str, Any]) -> Synapses:
    """Synapses with the weights (pre, post) and the format that the parameters describe."""
    sign = described["sign_mode"].lower()
    return Synapses(source, target, weights, described["num_weight_bits"], described["weight_exp"], sign)


def _population(n: int, lif: Mapping[str, Any], bias: NDArray[np.int32] | int = 0) -> Population:
    """A LIFReset of ``n`` neurons, whose step of reset is the first of each interval."""
    return Population(
        np.full(n, lif["vth"], np.int32),
        bias,
        lif.get("bias_exp", 0),
        LifParameters(du=lif["du"], dv=lif["dv"]),
        lif["reset_interval"],
    )


def simulate(
    network: FixedNetwork,
    rates: NDArray[np.uint16],
    keys: NDArray[np.uint64],
    bias: NDArray[np.int32] | None = None,
) -> BundleSpikes:
    """Present every image to the network as a bundle holds it, by the general engine.

    Presentations follow each other in one run that LIFReset divides, as on the board.

    Args:
        network: From `network_of`, which sees that it is what the files say.
        rates: Spikes a step in units of 2^-16, uint16 (n, inputs).
        keys: One key per presentation, uint64 (n,).
        bias: Biases of each presentation in units of v, int32 (n, neurons); None: always the bundle's.
    Returns:
        Spikes of exc, of inh (leaves, then the root) and of the inputs, uint8 (n, interval, each).
    Raises:
        NetworkLimitError: the network overflows Loihi's registers, or the rates have another number of inputs.
    """
    if network.relayed:  # one to one as the general engine takes them: dense, in 4 bytes, twice
        effort.check("simulation_bytes", 8 * network.inputs**2, f"the relays of {network.inputs:,} inputs")
    if rates.ndim != 2 or rates.shape[1] != network.inputs:
        raise NetworkLimitError(
            f"rates are {rates.shape}, but the bundle's network has {network.inputs} inputs; encode them again"
        )
    weights, parameters = network.stored[0].astype(np.int16), parameters_of(network)
    general = general_network(weights, network.bias_registers[0], parameters)
    n, interval = len(rates), network.interval
    exc = np.zeros((n, interval, network.neurons), np.uint8)
    inh = np.zeros((n, interval, network.inhibitory), np.uint8)
    inputs = draw_trains(rates, keys, network.steps, interval, regular=network.regular)
    for start in range(0, n, CHUNK):
        part = slice(start, start + CHUNK)
        if bias is not None:
            mantissas, exponents = bias_registers(bias[part])
            general = general_network(weights, mantissas, parameters, exponents)
        recording = run_general(general, inputs[part].reshape(-1, network.inputs).astype(bool))
        exc[part] = recording.spikes[EXC].reshape(-1, interval, network.neurons)
        inh[part] = recording.spikes[INH].reshape(-1, interval, network.inhibitory)
    return BundleSpikes(exc, inh, inputs)


def player(bundle: ReadBundle) -> BundlePlayer:
    """A simulation of the Processes of a bundle; its files are read once."""
    network = network_of(bundle.files, bundle.path)
    return lambda rates, keys, bias=None: simulate(network, rates, keys, bias)
