"""A NIR graph of the shape that `lava_vpr.exchange.nir_writing` gives it, read from a file of anybody.

Neurons may be LIF, IF, or CubaLIF whose current has no memory (tau_syn of one step). The recurrent edge may be missing:
then nothing inhibits.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import nir
import numpy as np
from numpy.typing import NDArray

from lava_vpr.engine.inference.fixed import FAN_IN, SCALARS, inhibitory_depth
from lava_vpr.errors import brief, said
from lava_vpr.exchange.drawn import Drawn, UnfitNetwork, inhibition_of, packed_references
from lava_vpr.exchange.nir_writing import FORMAT
from lava_vpr.loihi import WEIGHT_EXPONENT_LIMIT, WEIGHT_LIMIT
from lava_vpr.settings.ranges import real, whole
from lava_vpr.storage.reading import parse_json

_NEURONS = ("LIF", "IF", "CubaLIF")
_LINEAR = ("Affine", "Linear")


class _Neurons(NamedTuple):
    """The constants of a population, the same for every neuron.

    Attributes:
        decay: Share of a membrane that is lost in a step.
        gain: What an input of 1 adds to the membrane in a step.
        threshold: The threshold.
        leak: What the membrane gains in every step from v_leak.
    """

    decay: float
    gain: float
    threshold: float
    leak: float


def network(file: Mapping[str, Any], time_step: float) -> Drawn:
    """The network in the content of a NIR file.

    Args:
        file: As `lava_vpr.storage.hdf5.read` reads it.
        time_step: Seconds of a step, where the file does not say.
    Raises:
        Unfit: it is no NIR graph, or none of this shape.
    """
    return network_of(_graph(file), time_step)


def _graph(file: Mapping[str, Any]) -> nir.NIRGraph:
    """The graph in a file's contents, its types checked by NIR's own package.

    Raises:
        Unfit: there is none, or it has nodes that are none of this network.
    """
    node = file.get("node")
    if not isinstance(node, dict) or node.get("type") != "NIRGraph":
        raise UnfitNetwork("is none: the file has no node of type NIRGraph")
    nodes, edges = node.get("nodes"), node.get("edges")
    if not isinstance(nodes, dict) or not isinstance(edges, np.ndarray) or edges.ndim != 2 or edges.shape[1] != 2:
        raise UnfitNetwork("has no nodes or no edges")
    for name, part in nodes.items():
        kind = part.get("type") if isinstance(part, dict) else None
        if kind not in ("Input", "Output", *_NEURONS, *_LINEAR):
            raise UnfitNetwork(f"has {brief(kind)}, node {brief(name)}")
        part.pop("metadata", None)
        _check_numbers(name, part)
    try:
        return nir.NIRGraph.from_dict(
            {name: node[name] for name in ("type", "nodes", "edges", "metadata") if name in node}
        )
    except (ValueError, TypeError, KeyError, AssertionError, AttributeError, IndexError, NotImplementedError) as error:
        raise UnfitNetwork(f"is not accepted by NIR's own package ({said(error)})") from None


def _check_numbers(name: str, part: dict[str, Any]) -> None:
    """Refuse a node with values that are not numbers, or not finite; make each an array of floats.

    Raises:
        Unfit: naming node and value.
    """
    for key, value in part.items():
        if key == "type":
            continue
        array = np.asarray(value)
        if array.dtype.kind not in "fiu":
            raise UnfitNetwork(f"has no numbers as {brief(key)} of node {brief(name)}")
        if not np.isfinite(array).all():
            raise UnfitNetwork(f"has NaN or infinity in {brief(key)} of node {brief(name)}")
        part[key] = array.astype(np.int64) if key == "shape" else array.astype(np.float64)


def network_of(graph: nir.NIRGraph, time_step: float) -> Drawn:
    """The network that ``graph`` draws.

    Raises:
        Unfit: it is none of this shape.
    """
    synapses, neurons, recurrent = _parts(graph)
    kept = graph.metadata if graph.metadata.get("format") == FORMAT else {}
    step = kept.get("time_step", time_step)
    if not real(step) or not step > 0:
        raise UnfitNetwork(f"has a time_step of {brief(step)}")
    constants = _constants(neurons, float(step))
    weights = synapses.weight * constants.gain
    bias = getattr(synapses, "bias", np.zeros(len(weights))) * constants.gain + constants.leak
    if weights.ndim != 2 or bias.shape != (len(weights),):
        raise UnfitNetwork(f"has synapses of shape {weights.shape} with biases of shape {bias.shape}")
    inhibition, excitatory = 0.0, len(weights)
    if recurrent is not None:
        if getattr(recurrent, "bias", np.zeros(1)).any():
            raise UnfitNetwork("has biases in its recurrent edge")
        excitatory = excitatory_of(len(weights))
        matrix = recurrent.weight * constants.gain
        inhibition = inhibition_of(matrix, weights, bias, constants.threshold, excitatory)
    return Drawn(
        weights=weights[:excitatory].T,
        bias=bias[:excitatory],
        threshold=constants.threshold,
        decay=constants.decay,
        inhibition=inhibition,
        **_kept(kept),
    )


def _kept(kept: Mapping[str, Any]) -> dict[str, Any]:
    """What our own metadata add; nothing for a graph of another program.

    Raises:
        Unfit: they are invalid.
    """
    if not kept:
        return {}
    unit, checksum = kept.get("weight_unit"), kept.get("digest")
    if not isinstance(unit, float) or not real(unit) or not unit > 0 or not isinstance(checksum, str):
        raise UnfitNetwork(f"has metadata 'weight_unit' {brief(unit)} and 'digest' {brief(checksum)}")
    own = {"unit": unit, "scalars": _scalars(kept.get("network")), "digest": checksum}
    return own | {"references": packed_references(kept)}


def _scalars(text: object) -> dict[str, int]:
    """`FixedNetwork.scalars` of our own metadata, those that are used within their ranges.

    Raises:
        Unfit: they are invalid.
    """
    try:
        scalars = parse_json(text) if isinstance(text, str) else None
    except ValueError:
        scalars = None
    if isinstance(scalars, dict) and set(scalars) == set(SCALARS) and all(map(whole, scalars.values())):
        ranges = {"bits": (1, 8), "inhibition": (0, WEIGHT_LIMIT), "inhibition_exponent": (0, WEIGHT_EXPONENT_LIMIT)}
        if all(least <= scalars[name] <= most for name, (least, most) in ranges.items()):
            return scalars
    raise UnfitNetwork(f"has metadata 'network' {brief(text)}")


def _parts(graph: nir.NIRGraph) -> tuple[Any, Any, Any]:
    """Synapses, neurons, and the recurrent edge or None.

    Raises:
        Unfit: nodes or edges are missing or too many.
    """
    kinds = {name: type(node).__name__ for name, node in graph.nodes.items()}
    inputs, outputs = (_of(kinds, (kind,)) for kind in ("Input", "Output"))
    neurons, linear = _of(kinds, _NEURONS), _of(kinds, _LINEAR)
    if not (len(inputs) == len(neurons) == 1 and len(outputs) <= 1 and 1 <= len(linear) <= 2):
        raise UnfitNetwork(f"has the nodes {brief(sorted(kinds.values()))}")
    neuron, edges = neurons[0], set(graph.edges)
    first = [name for name in linear if (inputs[0], name) in edges]
    recurrent = [name for name in linear if name not in first]
    wanted = {(inputs[0], name) for name in first} | {(name, neuron) for name in linear}
    wanted |= {(neuron, name) for name in (*recurrent, *outputs)}
    if len(first) != 1 or edges != wanted:
        raise UnfitNetwork(f"has the edges {brief(sorted(edges))}")
    return graph.nodes[first[0]], graph.nodes[neuron], graph.nodes[recurrent[0]] if recurrent else None


def _of(kinds: Mapping[str, str], wanted: Iterable[str]) -> list[str]:
    """The names of the nodes of the ``wanted`` kinds."""
    return [name for name, kind in kinds.items() if kind in wanted]


def _constants(node: Any, step: float) -> _Neurons:
    """The constants of a population under forward Euler with ``step`` seconds.

    Raises:
        Unfit: neurons differ, reset to other than 0, keep a current, or the step is longer than a time constant.
    """
    if _one(node.v_reset, "v_reset") != 0:
        raise UnfitNetwork("resets membranes to other than 0")
    r, threshold = _one(node.r, "r"), _one(node.v_threshold, "v_threshold")
    if isinstance(node, nir.IF):
        return _Neurons(0.0, r * step, threshold, 0.0)
    tau, gain = _one(node.tau_mem if isinstance(node, nir.CubaLIF) else node.tau, "tau"), r
    if isinstance(node, nir.CubaLIF):
        if not math.isclose(_one(node.tau_syn, "tau_syn"), step, rel_tol=1e-6):
            raise UnfitNetwork("keeps currents from step to step (tau_syn is not one step), which these neurons cannot")
        gain *= _one(node.w_in, "w_in")
    if not tau >= step * (1 - 1e-9):
        raise UnfitNetwork(f"has a time constant of {tau:g} s, less than a step of {step:g} s; say --time-step")
    decay = min(1.0, step / tau)
    gain *= decay
    gain = 1.0 if math.isclose(gain, 1.0, rel_tol=1e-12) else gain  # which the rounding of a quotient keeps it from
    return _Neurons(decay if decay > 1e-8 else 0.0, gain, threshold, _one(node.v_leak, "v_leak") * decay)


def _one(values: NDArray[np.float64], name: str) -> float:
    """The one value that all neurons have.

    Raises:
        Unfit: they differ, or there is none.
    """
    if np.size(values) == 0 or not (values == np.ravel(values)[0]).all():
        raise UnfitNetwork(f"has neurons that differ in {name}")
    return float(np.ravel(values)[0])


def excitatory_of(size: int) -> int:
    """Excitatory neurons of a population of ``size``: all but the inhibitory ones that so many need.

    Raises:
        Unfit: no number of neurons makes a population of that size.
    """
    leaves = 0 if inhibitory_depth(size - 1) == 1 else -(-(size - 1) // (FAN_IN + 1))
    neurons = size - 1 - leaves
    if neurons < 1 or leaves != (0 if inhibitory_depth(neurons) == 1 else -(-neurons // FAN_IN)):
        raise UnfitNetwork(f"has a population of {size}, which no number of neurons and their inhibitory ones make")
    return neurons
