"""NetX: the network as the HDF5 file that ``lava.lib.dl.netx.hdf5.Network`` of lava-dl loads, written and read.

    input -> dense_rec: the excitatory neurons and, behind them, the inhibitory one, as one recurrent population

A population of NetX shares its threshold and its decay. The inhibitory neuron works with those of the others, because
any excitatory spike alone lifts it over the threshold, and nothing else reaches it. A population takes injected spikes
a step later, and hears of its own a step later: that is the network of at most `DIRECT` neurons.

NetX counts biases in the unit of weights (its bias_exp is 6), the chip 64 times finer. So everything is doubled as
often as 8-bit synapses with a sign hold it, and biases are rounded to what is left. `held` is the network that a file
holds: the loaded file spikes as that one does, bit for bit.

Source: lava-dl 0.6.0, ``lava/lib/dl/netx/hdf5.py`` (create_dense, get_neuron_params) and ``utils.py``
(optimize_weight_bits).
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.fixed import DIRECT, FixedNetwork
from lava_vpr.errors import NetworkLimitError, brief
from lava_vpr.exchange.drawn import STEP_UNIT, Drawn, UnfitNetwork, inhibition_of, packed_references
from lava_vpr.exchange.formats import FileOptions
from lava_vpr.exchange.nir_writing import FORMAT, container_of
from lava_vpr.loihi import DECAY_UNITY, INPUT_SHIFT, SIGNED_WEIGHT_LIMIT, WEIGHT_BITS
from lava_vpr.model import IntegerModel

SAID = (
    "the last neuron of the population is the inhibitory one, all others are excitatory; a presentation is 'interval' "
    "steps, of which the first 'steps' have input, and all states are 0 at its start (reset_interval)"
)


def held(network: FixedNetwork) -> FixedNetwork:
    """The network that a file of ``network`` holds: a multiple of it by a power of two, with rounded biases.

    Raises:
        NetworkLimitError: NetX has no place for it, naming need, limit and remedy.
    """
    if network.neurons > DIRECT:
        raise NetworkLimitError(
            f"{network.neurons:,} neurons take relays or several inhibitory neurons, and NetX holds one population of "
            f"at most {DIRECT:,}; export a smaller map (lava-vpr remove), or to NIR"
        )
    doublings = WEIGHT_BITS - 1 - network.bits
    while doublings >= 0 and max(network.threshold << doublings, network.lateral << doublings) >= SIGNED_WEIGHT_LIMIT:
        doublings -= 1
    if doublings < 0:
        raise NetworkLimitError(
            f"threshold {network.threshold} and inhibition {network.lateral} are synapses in NetX, which must stay "
            f"below {SIGNED_WEIGHT_LIMIT} with {network.bits}-bit weights; use fewer weight bits"
        )
    made = replace(
        network,
        weights=(network.weights << doublings).astype(np.int16),
        bits=network.bits + doublings,
        signed=True,
        threshold=network.threshold << doublings,
        inhibition=network.lateral << doublings,
        inhibition_exponent=0,
    )
    most = made.highest_bias >> INPUT_SHIFT
    counted = np.minimum((network.bias << doublings) + STEP_UNIT // 2 >> INPUT_SHIFT, most)
    made = replace(made, bias=(counted << INPUT_SHIFT).astype(np.int32))
    made.check()
    return made


def content(model: IntegerModel, options: FileOptions) -> tuple[bytes, tuple[str, ...]]:
    """The content of a file with the network of ``model``, and what it does not hold as the model does, for people.

    Args:
        model: The model.
        options: Whether the file takes along all of the model that the network does not say.
    Raises:
        NetworkLimitError: NetX has no place for the network.
    """
    network = held(model.network)
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        _fill(file, network)
        own: dict[str, Any] = {"format": FORMAT, "says": SAID, "steps": network.steps, "interval": network.interval}
        if options.references:
            own["references"] = np.frombuffer(container_of(model), np.uint8)
        for name, value in own.items():
            file[f"lava_vpr/{name}"] = value
    return buffer.getvalue(), _notes(model.network, network)


def _notes(wanted: FixedNetwork, made: FixedNetwork) -> tuple[str, ...]:
    """What `held` changed."""
    factor = made.threshold // wanted.threshold
    change = int(np.abs(made.bias - wanted.bias * factor).max(initial=0))
    notes = ["everything is in units of 1/" + str(factor) + " of a weight"] if factor > 1 else []
    if change:
        share = 100 * change / (made.threshold << INPUT_SHIFT)
        notes.append(
            f"NetX counts biases in whole weights: they are rounded, by {share:.2g} % of the threshold at most"
        )
    return tuple(notes)


def _fill(file: h5py.File, network: FixedNetwork) -> None:
    """Write the layers, as lava-dl's own exports have them."""
    n = network.neurons
    weight, recurrent = np.zeros((n + 1, network.inputs), np.int16), np.zeros((n + 1, n + 1), np.int16)
    weight[:n] = network.weights.T
    recurrent[n, :n], recurrent[:n, n] = network.threshold + 1, -network.lateral
    values: dict[str, Any] = {
        "0/shape": [network.inputs],
        "1/shape": [n + 1],
        "1/inFeatures": network.inputs,
        "1/outFeatures": n + 1,
        "1/bias": np.append(network.bias >> INPUT_SHIFT, 0).astype(np.int32),
        "1/neuron/iDecay": DECAY_UNITY,
        "1/neuron/vDecay": network.decay,
        "1/neuron/vThMant": network.threshold,
        "1/neuron/refDelay": 1,
        "1/neuron/gradedSpike": False,
    }
    for name, value in values.items():
        file[f"layer/{name}"] = value
    for name, array in (("weight", weight), ("weight_rec", recurrent)):
        file.create_dataset(f"layer/1/{name}", data=array, compression="gzip", shuffle=True)
    for name, word in (("0/type", b"input"), ("1/type", b"dense_rec"), ("1/neuron/type", b"CUBA")):
        file.create_dataset(f"layer/{name}", (1,), "S10", [word])


def _layer(file: Mapping[str, Any]) -> Mapping[str, Any]:
    """The one layer with synapses."""
    layers = file.get("layer")
    if not isinstance(layers, dict) or not layers or not all(isinstance(layer, dict) for layer in layers.values()):
        raise UnfitNetwork("has no layers")
    kinds = {name: _word(layer) for name, layer in layers.items()}
    (*others, name) = sorted(kinds)
    if kinds[name] not in ("dense", "dense_rec") or len(others) > 1 or any(kinds[one] != "input" for one in others):
        raise UnfitNetwork(f"has layers {brief([kinds[one] for one in sorted(kinds)])}")
    layer = layers[name]
    if any("neuron" in layers[one] for one in others):
        raise UnfitNetwork("has neurons in its input layer")
    if "delay" in layer:
        raise UnfitNetwork("has synaptic delays")
    return dict(layer)


def _word(part: Mapping[str, Any]) -> str:
    """The ``type`` of a layer or neuron, a text or an array of one."""
    value = np.asarray(part.get("type", "none"), object).ravel()
    return str(value[0]) if value.size == 1 else "none"


def _numbers(part: Mapping[str, Any], name: str, axes: int) -> NDArray[np.float64]:
    """The array ``name`` of so many axes, of whole numbers."""
    array = np.asarray(part.get(name, []))
    if array.dtype.kind not in "fiu" or array.ndim != axes or array.size == 0:
        raise UnfitNetwork(f"has no {name} of {axes} axes" if axes else f"has no number {name}")
    values = array.astype(np.float64)
    if not (np.isfinite(values) & (values == np.trunc(values)) & (np.abs(values) < 1 << 24)).all():
        raise UnfitNetwork(f"has a {name} that is no whole number of 24 bits")
    return values


def network(file: Mapping[str, Any], time_step: float = 0.0) -> Drawn:
    """The network in the content of a file: one dense layer, recurrent or not, behind its input.

    Args:
        file: As `lava_vpr.storage.hdf5.read` reads it, with what our own export keeps beside the layers.
        time_step: Not used: NetX counts steps.
    Raises:
        Unfit: it holds no network of this shape.
    """
    layer, own = _layer(file), file.get("lava_vpr")
    neuron = layer.get("neuron")
    if not isinstance(neuron, dict) or _word(neuron) not in ("CUBA", "LOIHI"):
        raise UnfitNetwork("has no CUBA neurons")
    current, decay = _numbers(neuron, "iDecay", 0), _numbers(neuron, "vDecay", 0)
    if current != DECAY_UNITY or not 0 <= decay <= DECAY_UNITY:
        raise UnfitNetwork(f"has decays {int(current)} and {int(decay)}; currents must last a step ({DECAY_UNITY})")
    weight, threshold = _numbers(layer, "weight", 2), float(_numbers(neuron, "vThMant", 0))
    bias = _numbers(layer, "bias", 1) if "bias" in layer else np.zeros(len(weight))
    if bias.shape != (len(weight),):
        raise UnfitNetwork(f"has {len(bias)} biases for {len(weight)} neurons")
    taken = 0.0
    if _word(layer) == "dense_rec":
        recurrent = _numbers(layer, "weight_rec", 2)
        if recurrent.shape != (len(weight), len(weight)) or len(weight) < 2:
            raise UnfitNetwork(f"has recurrent weights of shape {recurrent.shape} for {len(weight)} neurons")
        taken = inhibition_of(recurrent, weight, bias, threshold, len(weight) - 1)
        weight, bias = weight[:-1], bias[:-1]
    kept = own if isinstance(own, dict) and own.get("format") == FORMAT else {}
    return Drawn(
        weights=weight.T * STEP_UNIT,
        bias=bias * STEP_UNIT,
        threshold=threshold * STEP_UNIT,
        decay=float(decay) / DECAY_UNITY,
        inhibition=taken * STEP_UNIT,
        unit=float(STEP_UNIT),
        references=packed_references(kept),
    )
