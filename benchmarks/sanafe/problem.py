"""A plan and some queries as the JSON that `benchmarks.sanafe.worker` sets up in SANA-FE.

    {"columns", "rows", "tile_cores": of the mesh; "tiles": number of the last tile in use, and one more,
     "port_units": inputs whose spikes are injected, "port_takes_time": whether sending them does,
     "steps", "silent_steps",
     "groups": [{"name", "tile", "core": within its tile, "size", "plays": a train, "attributes": of the soma,
                 "own_biases": [[index, bias]] that stay}],
     "synapses": [{"from", "to": groups, "kind": "dense" | "sparse", "pre", "post", "weights"}],
     "queries": [{"trains": [[group, index, [0 | 1, ...]]],
                  "biases": [[group, index, bias, potential]] that are 0 in the silent steps,
                  "own_biases": [[group, index, bias]] that replace those of the groups}]}

Groups stand in the order of each core's compartments. A unit of weight, threshold, bias and potential is 2^6 of v.
SANA-FE's soma computes v' = trunc(v keep) + bias + sum with doubles that hold every number of ours exactly, so its exc
and inh spikes are its own and come out equal. The soma neither wraps u nor clips v: a deployed network cannot
make u wrap, and v is only clipped where inhibition drives it down to -2^23. Its Python interface turns floats into 32
bits: the floats handed over have at most 24 digits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.boards.board import Mesh
from lava_vpr.deploy.boards.plan import RELAY_THRESHOLD, RELAY_WEIGHT, CorePlan, Plan, PopulationName, PopulationPart
from lava_vpr.engine.inference import biases, fixed
from lava_vpr.engine.presentations import Trains
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.loihi import DECAY_BITS, INPUT_SHIFT

PORT = "port"
"""Group of the injected inputs."""

Synapses = NDArray[np.bool_]


def group_name(core: int, part: int) -> str:
    """The name of the group for a part of a core, by their numbers in the plan."""
    return f"{core}.{part}"


def mesh_of(plan: Plan, trains: Trains) -> Mesh:
    """The mesh of the board, where SANA-FE can be asked about ``plan`` and its ``trains``.

    Raises:
        BackendUnavailableError: a board other than Loihi 1's, or trains that lack spikes.
    """
    if plan.board.mesh is None or plan.board.constants is None:
        raise BackendUnavailableError(f"SANA-FE's architecture is Loihi 1, not {plan.board.title}")
    if trains.inputs is None or trains.inh is None:
        raise BackendUnavailableError("a cross-check needs the spikes of inputs and inhibitory neurons, too")
    return plan.board.mesh


def without_counters(plan: Plan) -> Plan:
    """``plan`` without the counters of its excitatory neurons, which SANA-FE is not asked about.

    It would send one message to a core for both synapses of a spike, where Loihi sends one for each axon.
    """
    cores = tuple(
        replace(core, parts=tuple(part for part in core.parts if part.population != "counters")) for core in plan.cores
    )
    return replace(plan, board=replace(plan.board, counters=False), cores=cores)


def _attributes(plan: Plan, part: PopulationPart) -> dict[str, float]:
    """Threshold and decay of a part's somata."""
    unity = 1 << DECAY_BITS
    threshold, decay = RELAY_THRESHOLD, unity - 1
    if part.population == "exc":
        threshold, decay = plan.network.threshold, plan.network.decay
    elif part.population == "inputs" and plan.network.bias_input:
        threshold, decay = biases.THRESHOLD, 0
    return {"threshold": threshold, "leak_decay": (unity - decay) / unity}


def _own_biases(plan: Plan, part: PopulationPart) -> list[list[float]]:
    """What the neurons of a part gain in every step: index and bias, of those that have one."""
    bias = plan.network.bias[part.first : part.first + part.size] if part.population == "exc" else np.zeros(0)
    return [[int(i), float(bias[i]) / (1 << INPUT_SHIFT)] for i in np.flatnonzero(bias)]


def _groups(plan: Plan, mesh: Mesh) -> list[dict[str, Any]]:
    """Groups of all parts, and of the port."""
    groups = []
    for k, core in enumerate(plan.cores):
        tile, inside = divmod(core.core, mesh.tile_cores)
        place = {"tile": core.chip * mesh.columns * mesh.rows + tile, "core": inside}
        for i in sorted(range(len(core.parts)), key=lambda i: core.parts[i].compartment):
            part = core.parts[i]
            group = {"name": group_name(k, i), "size": part.size, "plays": False, "attributes": _attributes(plan, part)}
            groups.append(group | place | {"own_biases": _own_biases(plan, part)})
    if not plan.network.bias_input:
        port = {"name": PORT, "tile": 0, "core": mesh.tile_cores, "size": plan.network.inputs, "plays": True}
        groups.append(port | {"attributes": {}, "own_biases": []})
    return [group for group in groups if group["size"]]


def _rows(source: str, target: str, stored: Synapses, weights: NDArray[np.int64], dense: Synapses) -> list[Any]:
    """Synapses from one group to another.

    Args:
        source, target: Their names.
        stored: Which synapses there are, bool (sources, targets).
        weights: Int64, same shape.
        dense: Rows stored dense, bool (sources,).
    """
    rows = []
    for kind, synapses in (("dense", stored & dense[:, None]), ("sparse", stored & ~dense[:, None])):
        pre, post = np.nonzero(synapses)
        if pre.size:
            values = weights[pre, post].tolist()
            row = {"from": source, "to": target, "kind": kind, "pre": pre.tolist(), "post": post.tolist()}
            rows.append(row | {"weights": values})
    return rows


def _to_exc(plan: Plan, core: CorePlan, part: PopulationPart, target: str) -> list[Any]:
    """Synapses of the inputs and the root to the excitatory neurons of ``part``."""
    network, neurons = plan.network, slice(part.first, part.first + part.size)
    weights = network.weights[:, neurons].astype(np.int64)
    present = weights != 0
    # A row without any weight is not stored, not even dense.
    stored = present | (core.dense_inputs & present.any(axis=1))[:, None]
    rows = [] if network.input_compartments else _rows(PORT, target, stored, weights, core.dense_inputs)
    for name, sender in _parts(plan, "inputs"):
        senders = slice(sender.first, sender.first + sender.size)
        rows += _rows(name, target, stored[senders], weights[senders], core.dense_inputs[senders])
    for name, sender in _parts(plan, "inh"):
        root = np.arange(sender.first, sender.first + sender.size) == network.inhibitory - 1
        pulled = np.repeat(root[:, None], part.size, axis=1) & (network.inhibition > 0)
        rows += _rows(name, target, pulled, np.full(pulled.shape, -network.lateral), np.zeros(root.size, np.bool_))
    return rows


def _parts(plan: Plan, population: PopulationName) -> Iterator[tuple[str, PopulationPart]]:
    """The parts of a population, with the names of their groups."""
    for k, core in enumerate(plan.cores):
        for i, part in enumerate(core.parts):
            if part.population == population:
                yield group_name(k, i), part


def _listening(
    plan: Plan, source: str, sender: PopulationPart, heard_by: NDArray[np.int64], listener: PopulationName
) -> list[Any]:
    """Single synapses that make a neuron of ``listener`` spike; ``heard_by`` has its number for each of ``sender``."""
    rows = []
    for target, part in _parts(plan, listener):
        synapses = heard_by[:, None] == np.arange(part.first, part.first + part.size)
        rows += _rows(source, target, synapses, np.full(synapses.shape, RELAY_WEIGHT), np.zeros(sender.size, np.bool_))
    return rows


def _synapses(plan: Plan) -> list[Any]:
    """The synapses of all connections of the plan."""
    network, rows = plan.network, []
    for k, core in enumerate(plan.cores):
        for i, part in enumerate(core.parts):
            if part.population == "exc":
                rows += _to_exc(plan, core, part, group_name(k, i))
    root = network.inhibitory - 1
    for name, part in _parts(plan, "exc"):
        numbers = np.arange(part.first, part.first + part.size)
        rows += _listening(plan, name, part, numbers // fixed.FAN_IN if network.leaves else 0 * numbers, "inh")
    for name, part in _parts(plan, "inh"):
        numbers = np.arange(part.first, part.first + part.size)
        rows += _listening(plan, name, part, np.where(numbers < root, root, -1), "inh")
    if network.relayed:
        port = PopulationPart("inputs", 0, network.inputs, 0)
        rows += _listening(plan, PORT, port, np.arange(network.inputs), "inputs")
    return rows


def bias_and_membrane(train: NDArray[Any]) -> tuple[int, int]:
    """A bias and a first membrane, in units of v, with which an input compartment gives ``train`` (steps,).

    Trains do not tell the bias that made them. Energy and time do not depend on it: a compartment with any bias, or a
    membrane, is updated in every step.

    Raises:
        BackendUnavailableError: no bias gives this train.
    """
    times = np.flatnonzero(train)
    if not times.size:
        return 0, 1
    first = int(times[0])
    gaps = set(np.diff(times).tolist()) or {max(first + 1, train.size - first)}
    gap = gaps.pop()
    bias = biases.LEVEL + 1 if gap == 1 else biases.LEVEL // (gap - 1)
    if gaps or first >= gap or (times.size > 1 and biases.LEVEL // bias + 1 != gap):
        raise BackendUnavailableError("spikes of an input compartment that no bias gives; the trains are not regular")
    return bias, biases.LEVEL - first * bias


def _query(plan: Plan, inputs: NDArray[np.uint8], own: NDArray[np.int32] | None) -> dict[str, Any]:
    """The trains and biases that play in one query; ``inputs`` (interval, inputs), ``own`` biases (neurons,)."""
    trains, biases, unit = [], [], 1 << INPUT_SHIFT
    if not plan.network.bias_input:
        for j in np.flatnonzero(inputs.any(axis=0)).tolist():
            last = int(np.flatnonzero(inputs[:, j])[-1])
            trains.append([PORT, j, inputs[: last + 1, j].astype(int).tolist()])
    for name, part in _parts(plan, "inputs"):
        for n in range(part.size if plan.network.bias_input else 0):
            bias, membrane = bias_and_membrane(inputs[: plan.network.steps, part.first + n])
            biases.append([name, n, bias / unit, membrane / unit])
    of_exc = () if own is None else _parts(plan, "exc")
    owned = [[name, n, float(own[part.first + n]) / unit] for name, part in of_exc for n in range(part.size)]
    return {"trains": trains, "biases": biases, "own_biases": owned}


def problem_of(
    plan: Plan, trains: Trains, *, input_core: bool = True, bias: NDArray[np.int32] | None = None
) -> dict[str, Any]:
    """The JSON of a plan and its queries, as the module's docstring describes it.

    Args:
        plan: Where the network stands, on a Loihi 1 board.
        trains: Every spike.
        input_core: Sending injected spikes takes the port the time that it takes any core; else none.
        bias: Biases of the neurons in each query, int32 (n, neurons); None: always the network's.
    Raises:
        BackendUnavailableError: SANA-FE cannot be asked this.
    """
    mesh, plan = mesh_of(plan, trains), without_counters(plan)
    groups = _groups(plan, mesh)
    queries = () if trains.inputs is None else trains.inputs
    return {
        "columns": plan.board.chips * mesh.columns,
        "rows": mesh.rows,
        "tile_cores": mesh.tile_cores,
        "tiles": max(group["tile"] for group in groups) + 1,
        "port_units": 0 if plan.network.bias_input else plan.network.inputs,
        "port_takes_time": input_core,
        "steps": plan.network.steps,
        "silent_steps": plan.network.silent_steps,
        "groups": groups,
        "synapses": _synapses(plan),
        "queries": [_query(plan, inputs, None if bias is None else bias[q]) for q, inputs in enumerate(queries)],
    }
